"""The conformance checks themselves: each must refuse a simulator or an effect that breaks the rule it is there for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ActuatorDelay, ConstantLoad, ViscousFriction
from onlinebayes.simulators.mujoco import NATIVE, MujocoSimulator
from onlinebayes.simulators.mujoco.native.joints import Load
from onlinebayes.simulators.testing import check_effect, check_simulator
from tests.simulators.models import SLIDE

SPACE = ParameterSpace({"body.carriage.mass": Parameter(1.0, 4.0, "kg"), "joint.rail.damping": Parameter(0.0, 2.0)})


class IgnoresTheMask(MujocoSimulator):
    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        return super().reset(theta, state, None)


class KeepsTheTheta(MujocoSimulator):
    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        return super().reset(self.theta if mask is not None else theta, state, mask)


class ForgetsItsPast(MujocoSimulator):
    @property
    def state(self) -> TensorDict:
        state = super().state
        return state.exclude("effects")

    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        super().reset(theta, state, mask)
        return self.state

    def step(self, inputs: TensorDictBase) -> TensorDict:
        super().step(inputs)
        return self.state


class HidesItsFailures(MujocoSimulator):
    @property
    def failed(self) -> Tensor:
        return torch.zeros(self.worlds, dtype=torch.bool)


class MarksEverythingValid(MujocoSimulator):
    def rollout(self, theta: Tensor, state: TensorDictBase, inputs: TensorDictBase, times: Tensor) -> TensorDict:
        rolled = super().rollout(theta, state, inputs, times)
        return rolled.set("valid", torch.ones_like(rolled["valid"]))


class RollsOutOneTimestepLate(MujocoSimulator):
    def rollout(self, theta: Tensor, state: TensorDictBase, inputs: TensorDictBase, times: Tensor) -> TensorDict:
        return super().rollout(theta, state, inputs, times - self.timestep)


class MixesItsWorlds(MujocoSimulator):
    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        return super().reset(theta.mean(0).expand_as(theta).contiguous(), state, mask)


class IgnoresAParameter(MujocoSimulator):
    def rollout(self, theta: Tensor, state: TensorDictBase, inputs: TensorDictBase, times: Tensor) -> TensorDict:
        return super().rollout(theta.index_fill(1, torch.tensor([1]), 0.0), state, inputs, times)

    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        super().reset(theta.index_fill(1, torch.tensor([1]), 0.0), state, mask)
        self._theta = theta.clone() if mask is None else torch.where(mask[:, None], theta, self._theta)
        return self.state


class Drifts(MujocoSimulator):
    def step(self, inputs: TensorDictBase) -> TensorDict:
        inputs = inputs.clone()
        inputs["command"] += 1e-9 * np.random.default_rng().standard_normal()
        return super().step(inputs)


class HandsOutItsMemory(MujocoSimulator):
    @property
    def state(self) -> TensorDict:
        columns = self._system.record.unpack(torch.from_numpy(self._worlds._record))
        return TensorDict(columns, batch_size=[self.worlds])


@pytest.mark.parametrize(
    ("broken", "says"),
    [
        (IgnoresTheMask, "outside the mask"),
        (KeepsTheTheta, "the new theta"),
        (HidesItsFailures, r"failed is \[False, False"),
        (MarksEverythingValid, "valid does not fall"),
        (RollsOutOneTimestepLate, "a rollout against its steps"),
        (MixesItsWorlds, "a rollout against its steps"),
        (IgnoresAParameter, r"joint\.rail\.damping changes nothing"),
        (Drifts, "the same inputs twice"),
        (HandsOutItsMemory, "a view of the simulator's memory"),
    ],
)
def test_a_broken_simulator_is_refused(broken: type[MujocoSimulator], says: str) -> None:
    check_simulator(MujocoSimulator(SLIDE, SPACE))
    with pytest.raises(AssertionError, match=says):
        check_simulator(broken(SLIDE, SPACE))


def test_a_state_that_is_not_complete_is_refused() -> None:
    delayed = (ActuatorDelay("motor", Parameter(0.0, 0.02, "s")),)
    check_simulator(MujocoSimulator(SLIDE, SPACE, effects=delayed))
    with pytest.raises(AssertionError, match="a rollout against its steps: the keys differ"):
        check_simulator(ForgetsItsPast(SLIDE, SPACE, effects=delayed))


def test_a_scale_that_makes_worlds_fail_is_named() -> None:
    with pytest.raises(AssertionError, match="lower scale"):
        check_simulator(MujocoSimulator(SLIDE, SPACE), scale=1e15)


@dataclass(frozen=True)
class AlwaysOn(ConstantLoad):
    """Its term adds a little at the neutral value."""


@dataclass(frozen=True)
class NeverOn(ConstantLoad):
    """Its term writes nothing."""


class Scaled(Load):
    def __init__(self, factor: float, offset: float) -> None:
        self.factor, self.offset = factor, offset

    def write(self, model, fields, effect: ConstantLoad, parameters: Mapping[str, np.ndarray]) -> None:
        super().write(model, fields, effect, {"load": self.factor * parameters["load"] + self.offset})


NATIVE |= {AlwaysOn: Scaled(1.0, 1e-12), NeverOn: Scaled(0.0, 0.0)}


@dataclass(frozen=True)
class NeutralElsewhere(ViscousFriction):
    @property
    def neutral(self) -> Mapping[str, float]:
        return {"damping": -1.0}


@dataclass(frozen=True)
class StartsOutside(ViscousFriction):
    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        return ({"damping": 1e9},)


@dataclass(frozen=True)
class Amnesiac(ActuatorDelay):
    def trace(self, parameters: Mapping[str, Tensor], state: TensorDict | None, command: Tensor, timestep: float):
        trace = super().trace(parameters, state, command, timestep)
        return None if trace is None else trace.apply(lambda x: x.flip(1))


@pytest.mark.parametrize(
    ("broken", "says"),
    [
        (AlwaysOn("rail", Parameter(-1.0, 1.0, "N")), "at its neutral value"),
        (NeverOn("rail", Parameter(-1.0, 1.0, "N")), "changes nothing"),
        (NeutralElsewhere("rail", Parameter(0.0, 1.0)), "neutral is out of bounds"),
        (StartsOutside("rail", Parameter(0.0, 1.0)), "start .* is out of bounds"),
        (Amnesiac("motor", Parameter(0.0, 0.02, "s")), "a rollout against its steps"),
    ],
    ids=lambda x: type(x).__name__,
)
def test_a_broken_effect_is_refused(broken, says: str) -> None:
    with pytest.raises(AssertionError, match=says):
        check_effect(MujocoSimulator(SLIDE, SPACE), broken)
