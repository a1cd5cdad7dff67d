"""What ``refine`` has fitted ``posterior`` does not fit again."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from onlinebayes.criticism import Criticism, kept_fit, prepare, refine
from onlinebayes.identification import unwrap
from onlinebayes.parameters import Parameter
from onlinebayes.posterior import posterior_of_log
from onlinebayes.runs import FolderMemo
from onlinebayes.simulators.effects import ConstantLoad
from tests.criticism.rigs import measure, model

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
HELD = ["run5"]


@pytest.fixture(scope="module")
def memo(tmp_path_factory: pytest.TempPathFactory) -> FolderMemo:
    return FolderMemo(Path(tmp_path_factory.mktemp("memo")))


@pytest.fixture(scope="module")
def refined(memo: FolderMemo) -> Criticism:
    found = refine(model(), measure({LOAD: (0.5,)}), holdout=HELD, candidates=["constant_load"], memo=memo)
    assert found.accepted == (LOAD.key,)
    return found


def test_the_posterior_of_the_refined_model_fits_nothing(refined: Criticism, memo: FolderMemo) -> None:
    said: list[str] = []
    mended = model().with_effect(unwrap(refined.final.simulator).effects[0])
    found = posterior_of_log(mended, measure({LOAD: (0.5,)}), holdout=HELD, memo=memo, progress=said.append)
    assert not any(line.startswith(("fitting", "choosing")) for line in said)
    for name, value in found.parameters.items():
        assert value.fitted == pytest.approx(refined.parameters[name].mean, rel=1e-9)


def test_another_log_or_model_is_another_question(refined: Criticism, memo: FolderMemo) -> None:
    (effect,) = unwrap(refined.final.simulator).effects

    def kept(effect: ConstantLoad, load: float) -> object:
        task = prepare(model().with_effect(effect), measure({LOAD: (load,)}), HELD, None, None)
        return kept_fit(task.simulator, task.fit_runs, memo)

    assert kept(effect, 0.5) is not None
    assert kept(effect, 0.51) is None
    assert kept(dataclasses.replace(effect, load=Parameter(-4.0, 5.0, "N")), 0.5) is None
