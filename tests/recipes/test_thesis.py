"""The page about the thesis says what the result files hold; its tables come from jobs; its network is as printed."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
import torch

from onlinebayes.inference import fit
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import ResultTable
from recipes.studies.table_systems import SYSTEMS
from recipes.studies.thesis import columns, page, rows, table_4_1
from recipes.studies.thesis.published import PublishedNetwork

DOCS = Path(__file__).parents[2] / "docs"


def test_the_pages_figures_are_those_of_the_result_files() -> None:
    text = (DOCS / "thesis.md").read_text(encoding="utf-8")
    assert len(page.FIGURE.findall(text)) > 20
    assert page.wrong(text, DOCS / "results") == []


def test_the_pages_tables_are_up_to_date() -> None:
    text = (DOCS / "thesis.md").read_text(encoding="utf-8")
    assert set(page.TABLES) == {found[1] for found in page.BLOCK.findall(text)}
    assert page.filled(text, DOCS / "results") == text, "run `make thesis-page`, which writes them anew"


def test_a_figure_that_is_not_in_its_file_is_told(tmp_path: Path) -> None:
    table = ResultTable("study", "make study", [1])
    table.add("a row", 1.2345)
    table.add("said", "yes")
    table.write(tmp_path)

    def told(figure: str, row: str = "a row", name: str = "study") -> list[str]:
        return page.wrong(f'before [{figure}](results/{name}.md "{row}") after', tmp_path)

    assert told("1.23") == told("1.2") == told("1") == told("yes", "said") == []
    assert told("1.24") == ["study, a row: 1.24 is told, 1.2345 stands there"]
    assert told("no", "said") == ["study, said: no is told, 'yes' stands there"]
    assert told("1.23", "b") == ["study has no row 'b'"]
    assert told("1.23", name="other") == ["other has no row 'a row'"]
    assert told("much") == ["study, a row: 'much' is no number"]


def test_rows_come_from_the_jobs_that_are_there() -> None:
    found: dict[rows.Job, dict[str, object]] = {
        ("4.1", "CartPole", 0.01, seed): {"length": {"filter": 3.0 + seed, "ceiling": 5.2}, "mass": {"filter": 2.0}}
        for seed in (2, 3, 4)
    }
    found["loop", "Pendulum", 0.0, 2] = {"LSTM in the loop": 4.3}
    first, second = rows.tables(found, "make thesis", [2, 3])
    told = {row.name: (row.value, row.goal, row.holds) for row in first.rows}
    assert told["CartPole length, noise 1 %: filter"][0] == 6.0
    assert told["CartPole length, noise 1 %: the filter's median"] == (6.0, "at most 0.3 below the ceiling", True)
    assert told["CartPole mass, noise 1 %: the filter's median"] == (2.0, "above 0.973, the thesis's best", True)
    assert told["CartPole length, thesis: epsilon-free"][0] == -0.211
    assert not any(name.startswith("Pendulum") for name in told)
    assert [row.value for row in second.rows if row.name == "Pendulum, noise 0 %: LSTM in the loop"] == [4.3]
    assert rows.tables({}, "make thesis", []) == []


def test_a_filter_below_the_ceiling_misses_its_goal() -> None:
    table = ResultTable("thesis-4.1", "make thesis", [2])
    rows.add_goal(table, "head", "CartPole length", {"filter": [4.8], "ceiling": [5.2]}, -0.2)
    rows.add_goal(table, "head", "Acrobot L2", {"filter": [-0.3], "ceiling": [0.0]}, -0.148)
    rows.add_goal(table, "head", "Acrobot L2", {"filter": [0.04], "ceiling": [0.0]}, -0.148)
    rows.add_goal(table, "head", "Pendulum dt", {"LSTM": [4.8]}, 3.199)
    assert [row.holds for row in table.rows] == [False, False, True]


def test_a_table_shows_ours_and_the_thesiss(tmp_path: Path) -> None:
    table = ResultTable("thesis-5.1", "make thesis", [2])
    for name, value in (("noise 0 %: LSTM in the loop", 5.25), ("noise 1 %: ceiling", 4.0), ("the prior", 0.21)):
        table.add(f"Pendulum, {name}" if "noise" in name else f"Pendulum: {name}", value)
    table.write(tmp_path)
    *_, without, noisy = page.densities("5.1", tmp_path)
    assert without.startswith("| Pendulum | 0.21 | 0 % | - | - | - (3.33) |")
    assert without.endswith("| - | - | 5.25 (4.08) |")
    assert noisy.startswith("| Pendulum | 0.21 | 1 % |")
    assert noisy.endswith("| - | 4.00 | - |")


def test_the_published_network_is_the_printed_mixture() -> None:
    torch.manual_seed(0)
    space = ParameterSpace({"a": Parameter(0.0, 2.0, "m"), "b": Parameter(-1.0, 1.0, "kg")})
    network, x = PublishedNetwork(space, 3, components=4).double(), torch.randn(5, 3).double()
    found = network.distribution(x)
    (w1, b1), (w2, b2) = ((layer.weight, layer.bias) for layer in (network.trunk[0], network.trunk[2]))
    phi = torch.tanh(torch.tanh(x @ w1.T + b1) @ w2.T + b2)
    z = (phi @ network.variance.weight.T + network.variance.bias).unflatten(-1, (4, 2))
    variance = torch.where(z <= 0, z.exp(), z + 1)
    torch.testing.assert_close(found.scale_tril @ found.scale_tril.mT, torch.diag_embed(variance), atol=1e-7, rtol=0)
    torch.testing.assert_close(found.log_weights.exp().sum(-1), torch.ones(5).double())
    assert sum(len(layer.bias) for layer in (network.trunk[0], network.trunk[2])) == 48


def test_the_pendulums_ceiling_is_that_of_a_known_start() -> None:
    system, draw = SYSTEMS["Pendulum"], torch.Generator().manual_seed(0)
    truth = system.space.vector(system.truth)[None]
    before = torch.Generator().set_state(draw.get_state())
    true = system.simulate(truth, draw, rollouts=1, noise=0.05)[0]
    clean = system.simulate(truth, before, rollouts=1)[0]
    torch.testing.assert_close(clean["action"], true["action"])
    found = table_4_1.timestep_density(clean, true, 0.05)
    finer = table_4_1.timestep_density(clean[:, :5], true[:, :5], 0.05)
    # Fifty noisy steps tell the timestep to a fraction of a per cent, five steps less: 1 / (sqrt(2 pi) sd).
    assert 5 < found < 14
    assert finer < found


@pytest.mark.slow
def test_every_column_gives_a_density(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"ALONE": 150, "BATCH": 250, "CHECKED": 20, "CHOSEN_BY": 60, "FEATURES": 60}.items():
        monkeypatch.setattr(columns, name, value)
    for name, train in {"TRAIN": 30, "CHOOSE": 2, "LSTM_TRAIN": 3}.items():
        monkeypatch.setattr(columns, name, partial(fit, epochs=train, batch_size=50, learning_rate=4e-3))
    monkeypatch.setattr(table_4_1, "SIMULATIONS", 200)
    found = table_4_1.judged("Pendulum", 0.01, 2)["dt"]
    assert set(found) == {*columns.COLUMNS, columns.TEN_AS_ONE, columns.CEILING}
    # The prior has 1.24 nats. One seed, repeatable; of 1000 simulations the network knows 3.5.
    assert found["network as published"] > 1.5
    assert all(value < found["ceiling"] for value in found.values() if value != found["ceiling"])
