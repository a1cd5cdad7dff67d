"""The skid-steer study: a drive whose robot changes on the way, and when its goals hold."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase

from onlinebayes.runs import ResultTable
from recipes.studies import skid_steer
from recipes.studies.skid_steer_drives import STEPS, drive
from recipes.studies.skid_steer_figures import drives


class Straight(TensorDictModuleBase):
    """All wheels at 1 rad/s; counts beginnings."""

    in_keys, out_keys = ["observation"], ["action"]

    def forward(self, tensordict):
        self.began = getattr(self, "began", 0) + int(tensordict["is_init"].all())
        return tensordict.set("action", torch.ones(*tensordict.batch_size, 2))


def test_a_drive_goes_on_where_the_robot_changes() -> None:
    policy = Straight()
    slow, fast = skid_steer.truth_at(0.2, 0.05), skid_steer.truth_at(0.2, 0.1)
    found = drive(policy, [slow, fast], seed=0, worlds=2)
    assert policy.began == 1
    assert found.cost.shape == (2, 2 * STEPS)
    step = found.pose[0, :, 1].diff()
    assert torch.allclose(step[: STEPS - 1], torch.tensor(0.005, dtype=torch.float64))
    assert torch.allclose(step[STEPS - 1 :], torch.tensor(0.01, dtype=torch.float64))
    assert float(found.cost[0, STEPS - 1]) == pytest.approx(10 * ((1 + 1.0**2) ** 0.5 - 1) ** 2 + 10 * 0.1**2)


def case(prior: float, first: float, second: float, truth: float) -> dict:
    costs = dict(zip(skid_steer.BELIEFS, (prior, first, second, truth), strict=True))
    made = {name: {"cost": [cost, cost * 1.01], "density": 1.0} for name, cost in costs.items()}
    return {
        name: {**each, "curve": [cost] * 3, "path": [[1, 0]] * 3}
        for (name, cost), each in zip(costs.items(), made.values(), strict=True)
    }


@pytest.mark.parametrize(
    ("costs", "held"),
    [
        ((0.13, 0.0139, 0.0139, 0.01), [True, True, True]),
        ((0.13, 0.0141, 0.0139, 0.01), [False, True, True]),
        ((0.08, 0.0139, 0.0139, 0.01), [True, False, True]),
        ((0.13, 0.0139, 0.02, 0.01), [True, True, False]),
    ],
)
def test_goals_of_table_5_2(costs: tuple[float, ...], held: list[bool]) -> None:
    table = ResultTable("skid-steer", "make skid-steer", (2,))
    skid_steer.table_5_2(table, 0.2, [case(*costs)])
    assert [row.holds for row in table.rows if row.holds is not None] == held


def test_goals_of_the_loop_and_of_the_load() -> None:
    table = ResultTable("skid-steer", "make skid-steer", (2,))
    slow = {"late": 0.01, "truth late": 0.01, "density": 9.0, "rates": [9.0] * 20, "rates by the clock": [3.0] * 20}
    skid_steer.loop_rows(table, 0.2, {**slow, "plans alone": [50.0] * 9})
    costs = {"follows": [1, 1, 1.6], "knows": [1, 1, 1.0], "stays": [1, 1, 3], "before": [1, 1, 9]}
    skid_steer.change_rows(table, "load in front", {**costs, "said": "it changed", "rates": [11.0] * 20})
    assert [row.holds for row in table.rows if row.holds is not None] == [False, False, True]


@pytest.mark.slow
def test_figure_5_4(tmp_path: Path) -> None:
    figure = drives(case(0.13, 0.02, 0.02, 0.01), skid_steer.truth_at(0.2))
    figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_each_window_is_handed_on() -> None:
    class Counting:
        def __init__(self, seen: int = 0) -> None:
            self.seen = seen

        def update(self, window):
            return Counting(self.seen + len(window))

    following = skid_steer.Following(Counting())  # type: ignore[arg-type]
    for _ in range(3):
        following(TensorDict(batch_size=[1, 5]))
    assert following.belief.seen == 3
