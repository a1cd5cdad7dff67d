"""Trajectories cut into windows: every step stands in one of them, and an estimator of sets sees them as sets."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.inference import BoxUniform, FitReport, Windowed
from onlinebayes.inference.windowed import windows
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput

PRIOR = BoxUniform(ParameterSpace({"mass": Parameter(0.0, 1.0, "kg")}))


def numbered(number: int, length: int) -> TensorDict:
    """Each step's observation says which it is."""
    seen = torch.arange(1.0, number * length + 1).reshape(number, length, 1)
    return TensorDict({"observation": seen, "next": {"observation": seen + 0.5}}, [number, length])


class Told:
    """An estimator that remembers what it is given."""

    space, box = PRIOR.space, PRIOR.box

    def __init__(self) -> None:
        self.shapes: list[torch.Size] = []

    def fit(self, simulations, groups=None, *, generator):
        self.shapes += [simulations.batch_size, groups.batch_size]
        self.simulations = simulations
        return FitReport()

    def condition(self, trajectories):
        self.shapes.append(trajectories.batch_size)
        return PRIOR

    def each(self, groups):
        self.shapes.append(groups.batch_size)
        return PRIOR


def test_windows_hold_every_step_once_in_order_and_mask_what_is_missing() -> None:
    cut = windows(numbered(2, 5), 3)
    assert cut["observation"][..., 0].tolist() == [[1, 2, 3], [4, 5, 0], [6, 7, 8], [9, 10, 0]]
    assert cut["next", "observation"][0, :, 0].tolist() == [1.5, 2.5, 3.5]
    assert cut["mask"].tolist() == [[True] * 3, [True, True, False]] * 2
    told = numbered(1, 3).set("mask", torch.tensor([[True, False, False]]))
    assert windows(told, 2)["mask"].tolist() == [[True, False], [False, False]]
    assert "mask" not in numbered(1, 3)


def test_the_estimator_within_sees_sets_of_windows() -> None:
    told = Told()
    made = Windowed(told, 3)
    groups = torch.stack([numbered(4, 5)] * 2, 1)
    made.fit(numbered(7, 5), groups, generator=torch.Generator())
    made.condition(numbered(3, 6))
    made.each(groups)
    assert [tuple(shape) for shape in told.shapes] == [(7, 2, 3), (4, 4, 3), (6, 3), (4, 4, 3)]
    assert told.simulations["observation"][1, 0, :, 0].tolist() == [6, 7, 8], "a set's windows are one trajectory's"
    assert made.box is PRIOR.box


def test_windows_have_a_step() -> None:
    with pytest.raises(BadInput, match="at least one step"):
        Windowed(Told(), 0)
