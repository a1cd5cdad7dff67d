"""A second physics engine is nine small methods; learning works in it as in the others."""

from __future__ import annotations

import copy

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import TransformedEnv, check_env_specs

from envs.pendulum import Pendulum, PendulumTask
from envs.reach import PHYSICAL, arm
from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator, SimulatorEnv
from onlinebayes.simulators.testing import check_engine
from onlinebayes.transforms import ParameterRandomization

SPACE = ParameterSpace({"mass": Parameter(0.5, 2.0, "kg"), "damping": Parameter(0.1, 1.0, "N s/m")})


class Sled(Simulator):
    """A mass on a rail: an engine of its own, with nothing that learning does not need."""

    def __init__(self, worlds: int = 1) -> None:
        self.parameters, self.worlds, self.dt = SPACE, worlds, 0.1
        self.device, self.dtype = torch.device("cpu"), torch.float64
        self.reset(self.nominal.expand(worlds, -1))

    @property
    def nominal(self):
        return torch.tensor([1.0, 0.5], dtype=torch.float64)

    @property
    def theta(self):
        return self._theta.clone()

    @property
    def state(self):
        return TensorDict({"qpos": self._x.clone(), "qvel": self._v.clone()}, (self.worlds,))

    @property
    def failed(self):
        return torch.zeros(self.worlds, dtype=torch.bool)

    def reset(self, theta, state=None, mask=None):
        x = torch.zeros(self.worlds, 1).double() if state is None else state["qpos"]
        v = torch.zeros(self.worlds, 1).double() if state is None else state["qvel"]
        keep = None if mask is None else ~mask[:, None]
        self._theta = theta.clone() if keep is None else torch.where(keep, self._theta, theta)
        self._x = x.clone() if keep is None else torch.where(keep, self._x, x)
        self._v = v.clone() if keep is None else torch.where(keep, self._v, v)
        return self.state

    def step(self, inputs):
        mass, damping = self._theta[:, :1], self._theta[:, 1:]
        self._v = self._v + self.dt * (inputs["command"] - damping * self._v) / mass
        self._x = self._x + self.dt * self._v
        return self.state

    def rollout(self, theta, state, inputs, times):
        other = Sled(len(theta))
        other.reset(theta, state)
        path = [other.step(TensorDict({"command": row}, (len(theta),))) for row in inputs["command"].unbind(1)]
        return torch.stack(path, 1).set("valid", torch.ones(len(theta), len(path), dtype=torch.bool))

    def with_worlds(self, worlds):
        return Sled(worlds)

    def with_effect(self, effect):
        raise BadInput(f"{effect.key} has no form here", "use another engine")


def public(kind: type) -> set[str]:
    return {name for name in (*vars(kind), *kind.__annotations__) if not name.startswith("_")}


def test_the_base_class_asks_for_little() -> None:
    assert len(public(Simulator) - {"device", "dtype"}) <= 12
    assert len(Simulator.__abstractmethods__) <= 10
    assert Sled().__class__.__abstractmethods__ == frozenset()


@pytest.mark.parametrize(
    "make", [Sled, lambda: Pendulum(["length", "mass"]), lambda: arm(PHYSICAL.subspace(["body.fore.mass"]), threads=1)]
)
def test_an_engine_conforms(make) -> None:
    simulator = make()
    check_engine(simulator, 3 if len(simulator.state["qpos"][0]) == 3 else 1, atol=1e-9)


def test_a_broken_engine_is_caught() -> None:
    class Forgetful(Sled):
        def with_worlds(self, worlds):
            return Forgetful(worlds)

        def step(self, inputs):
            self._theta = self.nominal.expand(self.worlds, -1).clone()
            return super().step(inputs)

    class Careless(Sled):
        def with_worlds(self, worlds):
            return Careless(worlds)

        def reset(self, theta, state=None, mask=None):
            return super().reset(theta, state)

    for broken, message in ((Forgetful, "not what reset was given"), (Careless, "do not reset")):
        with pytest.raises(AssertionError, match=message):
            check_engine(broken(), 1)


def test_policies_and_copies_need_no_more() -> None:
    env = TransformedEnv(SimulatorEnv(Sled(3), PushTask()), ParameterRandomization(BoxUniform(SPACE)))
    check_env_specs(env)
    data = env.rollout(8, break_when_any_done=False)
    assert SPACE.contains(data["theta"]).all()
    other = copy.deepcopy(env.base_env)
    assert (other.simulator.state == env.base_env.simulator.state).all()


class PushTask(PendulumTask):
    """Any task will do: the pendulum's looks at one coordinate too."""

    def __init__(self) -> None:
        super().__init__(horizon=5)
