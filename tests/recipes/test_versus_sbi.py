"""The comparison with sbi: its table from outcomes made up here, and one job of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from onlinebayes.runs import BadInput, ResultTable
from recipes.studies import versus_sbi


def _compared(ours: float, theirs: float) -> versus_sbi.Result:
    """A job in which all truths are told apart alike, but for a hundredth of a nat."""
    result = {"density": [theirs, theirs], "our density": [ours - 0.01, ours + 0.01], "coverage": 0.1}
    seconds = {"fit": 9.0, "our fit": 2.0, "draws": 1.0, "our draws": 0.5, "log_prob": 6.0, "our log_prob": 1.0}
    return {**result, "our coverage": 0.02, **seconds}


def test_ours_is_held_against_the_best_of_sbi_on_our_features() -> None:
    densities = {"mdn": 1.0, "nsf": 1.8, "nsf raw": 5.0}
    jobs = {("pendulum", 2000, 1, method): _compared(2.0, theirs) for method, theirs in densities.items()}
    table = versus_sbi.tabled(jobs, ResultTable("versus-sbi", "make versus-sbi", [1]))
    rows = {row.name: row for row in table.rows}
    ahead = rows["pendulum, 2000 simulations: ours above sbi nsf"]
    assert ahead.value == pytest.approx(0.2)
    assert ahead.holds is False, ".3 nats are asked for"
    fitting = rows["pendulum, 2000 simulations: fitting, sbi mdn over ours"]
    assert (fitting.value, fitting.holds) == (4.5, True)
    assert rows["pendulum, 2000 simulations: 1e6 draws, sbi mdn over ours"].holds is False
    assert rows["pendulum, 2000 simulations: 1e6 draws, sbi nsf raw over ours"].holds is None


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(BadInput, match="mnd is unknown; known: mdn, maf"):
        versus_sbi.Study(methods=("mnd",))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # sbi's own
def test_sbi_is_compared_and_a_second_start_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sbi", reason="sbi is one of the peers")
    study = versus_sbi.Study(
        tasks=("pendulum",),
        budgets=(200,),
        seeds=(1,),
        methods=("mdn",),
        points=10_000,
        out=str(tmp_path / "out"),
        results=tmp_path / "results",
    )
    assert versus_sbi.main(study) == 0
    rows = json.loads((study.results / "versus-sbi.json").read_text(encoding="utf-8"))["rows"]
    ahead = next(row for row in rows if row["name"] == "pendulum, 200 simulations: ours above sbi mdn")
    assert ahead["value"] > 0
    monkeypatch.delattr(versus_sbi, "own")
    assert versus_sbi.main(study) == 0, "nothing is done twice"
