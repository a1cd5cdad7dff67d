"""The recipe of a pendulum that takes up a load, and the table of the study of changes."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.inference import History, RunLengths
from onlinebayes.inference.changing import Change
from onlinebayes.inference.run_length import Hazard
from onlinebayes.runs import BadInput
from recipes.changing_machine import ChangingSettings, TakesUpALoad, main
from recipes.pendulum import SPACE
from recipes.studies import change as study


class Always:
    """A real system that says which it is."""

    def __init__(self, value: float) -> None:
        self.value = value

    def run(self, policy, steps: int) -> TensorDict:
        return TensorDict({"is": torch.full((1, steps), self.value)}, [1, steps])

    def state_dict(self):
        return {}

    def load_state_dict(self, state) -> None:
        pass


def test_the_load_comes_after_some_trajectories_and_not_again_after_a_stop() -> None:
    machine = TakesUpALoad(Always(0.3), Always(0.7), 2)
    seen = [float(machine.run(None, 1)["is"]) for _ in range(3)]
    assert seen == pytest.approx([0.3, 0.3, 0.7])
    again = TakesUpALoad(Always(0.3), Always(0.7), 2)
    again.load_state_dict(machine.state_dict())
    assert float(again.run(None, 1)["is"]) == pytest.approx(0.7)


def test_a_machine_without_a_trajectory_is_refused() -> None:
    with pytest.raises(BadInput, match="0 trajectories before"):
        ChangingSettings(before=0)


def test_small_jumps_are_a_fifth_of_the_prior_and_stay_in_it() -> None:
    draw = torch.Generator().manual_seed(0)
    theta = SPACE.from_unit(torch.rand(200, 2, generator=draw, dtype=torch.float64))
    moved = study.moved(theta, SPACE, draw)
    away = SPACE.to_unit(moved) - SPACE.to_unit(theta)
    inside = SPACE.contains(moved)
    assert inside.all()
    assert torch.allclose(away.norm(dim=1), torch.tensor(0.2).double())


def test_what_is_said_has_a_kind() -> None:
    lengths = RunLengths(Hazard(), 4)
    some = (Change(2, 0.99),)
    assert study.verdict(History(lengths)) == "the same"
    assert study.verdict(History(lengths, some)) == "changed"
    assert study.verdict(History(lengths, (Change(2, 0.99, within=True),))) == "changed within"
    assert study.verdict(History(lengths, (), (0.01,) * 4)) == "lacks an effect"
    assert study.verdict(History(lengths, some, (0.01,) * 4)) == "either"


def test_the_table_judges_regions_alarms_and_widths() -> None:
    pairs = {
        f"{kind} {way}": [0.5] * 9 + [0.99] for kind in ("region", "density") for way in ("together", "alone", "ours")
    }
    found = {
        "cartpole, drawn": {**pairs, "said": [[3]] * 9 + [[]]},
        "cartpole, small": {**pairs, "region ours": [0.99] * 10, "said": [[]] * 10},
        "cartpole, same": {"said": [[5], [7]] + [[]] * 18, "wider": [1.01] * 20, "inside": [True] * 20},
        "pendulum, words": {"stay": ["the same", "the same", "changed"]},
    }
    rows = {row.name: row for row in study.tabled(found, "make change").rows}
    assert rows["cartpole, a new machine, ours: truths in the 95 % region"].holds
    assert rows["cartpole, a small jump, ours: truths in the 95 % region"].holds is False
    assert (
        rows["cartpole, a new machine: changes said after three trajectories, at the right place within one"].value
        == 0.9
    )
    assert rows["cartpole, no change: false alarms in 20 runs of 30"].holds is False
    assert rows["cartpole, no change: width beside all together, median and largest"].holds
    assert rows["pendulums that stay: what is said of 3"].value == "2 the same, 1 changed"


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_the_log_says_when_the_load_came(tmp_path) -> None:
    """A run this short says so on five seeds of six (0 to 5): none of three does once in two hundred times."""
    runs = (ChangingSettings(seed=seed, short=True, before=2, after=3, out=str(tmp_path)) for seed in range(3))
    assert any(main(each) == 0 for each in runs)
