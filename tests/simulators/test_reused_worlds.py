"""Rollouts that share worlds give what new worlds would, to the last bit, and write theta once."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any
from weakref import WeakSet

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.embeddings import Rows, SimulatorFilter
from onlinebayes.inference import Box
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import side_by_side
from onlinebayes.runs.side_by_side import CORES
from onlinebayes.simulators.effects import ActuatorDelay, StribeckFriction
from onlinebayes.simulators.mujoco import MujocoSimulator, reused
from onlinebayes.simulators.mujoco.worlds import Worlds
from tests.simulators.models import ARM, SLIDE
from tests.simulators.test_force_stage import SCALES
from tests.simulators.test_mujoco import ARM_SPACE

MASS = ParameterSpace({"body.carriage.mass": Parameter(0.5, 3.0, "kg")})


def arm() -> MujocoSimulator:
    return MujocoSimulator(ARM, ARM_SPACE, threads=2)


def rubbing() -> MujocoSimulator:
    return MujocoSimulator(SLIDE).with_effect(StribeckFriction.scaled("rail", SCALES))


def without_parameters() -> MujocoSimulator:
    return MujocoSimulator(SLIDE)


def late() -> MujocoSimulator:
    return MujocoSimulator(SLIDE).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.02, "s")))


def drawn(simulator: MujocoSimulator, worlds: int = 5, steps: int = 3) -> tuple[Tensor, TensorDict, TensorDict, Tensor]:
    """Theta, states and commands of some short rollouts; one actuator is off in a part of some of them."""
    theta = simulator.parameters.from_unit(torch.rand(worlds, len(simulator.parameters)).double())
    model = simulator.model
    state = TensorDict({"qpos": 0.1 * torch.randn(worlds, model.nq).double()}, [worlds])
    state["qvel"] = torch.randn(worlds, model.nv).double()
    inputs = TensorDict({"command": torch.randn(worlds, steps, model.nu).double()}, [worlds, steps])
    return theta, state, inputs, simulator.dt * torch.arange(1, steps + 1).double()


def same(one: TensorDict, other: TensorDict) -> bool:
    keys = set(one.keys(True, True))
    return keys == set(other.keys(True, True)) and all(torch.equal(one[key], other[key]) for key in keys)


@pytest.mark.parametrize("make", [arm, rubbing, late, without_parameters])
def test_shared_worlds_are_as_good_as_new(make: Callable[[], MujocoSimulator]) -> None:
    simulator = make()
    theta, state, inputs, times = drawn(simulator)
    off = inputs.clone()
    off["enable"] = torch.ones_like(inputs["command"])
    off["enable"][1::2, 1:] = 0
    wild = state.clone()
    wild["qvel"][0] = 1e300
    for begin, told in ((state, inputs), (state, off), (wild, inputs), (state, inputs)):
        begin, told = begin.clone(), told.clone()
        new = make().rollout(theta, begin, told, times)
        assert same(simulator.rollout(theta, begin, told, times), new)
    assert same(simulator.rollout(theta[:2], state[:2], inputs[:2], times), new[:2])


def test_worlds_that_refuse_their_theta_refuse_it_again() -> None:
    simulator = arm()
    theta, state, inputs, times = drawn(simulator)
    theta[2, simulator.parameters.index("body.fore.mass")] = -1.0
    found = [simulator.rollout(theta, state, inputs, times) for _ in range(2)]
    assert same(*found)


def test_few_are_kept_and_none_of_long_rollouts(monkeypatch: pytest.MonkeyPatch) -> None:
    """All systems together, and a system that is gone leaves none: a process that asks many models would fill up."""
    alive: WeakSet[Worlds] = WeakSet()
    begin = Worlds.__init__

    def counted(self: Worlds, *args: Any) -> None:
        alive.add(self)
        begin(self, *args)

    monkeypatch.setattr(Worlds, "__init__", counted)
    for _ in range(2):
        simulator = arm()
        for _ in range(2 * reused.KEPT):
            simulator.rollout(*drawn(simulator))
    own = 1
    assert len(alive) == reused.KEPT + own
    simulator.rollout(*drawn(simulator, steps=reused.SHORT + 1))
    assert len(alive) == reused.KEPT + own


@pytest.mark.timeout(60)
def test_a_fork_frees_nothing_of_its_parents(monkeypatch: pytest.MonkeyPatch) -> None:
    """Worlds wait for the end of their threads, which a fork has not: it would wait for ever."""
    monkeypatch.setenv(CORES, "2")
    held = [arm()]
    for _ in range(reused.KEPT):
        held[0].rollout(*drawn(held[0]))

    def many() -> int:
        other = held[0] = arm()
        for _ in range(2 * reused.KEPT):
            other.rollout(*drawn(other))
        return os.getpid()

    assert len(set(side_by_side([many, many]))) == 2


def state_of(observation: Tensor) -> TensorDict:
    q, v = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": q, "qvel": v}, batch_size=observation.shape[:1])


def test_a_filter_writes_theta_once_and_steps_all_its_worlds_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    simulator = MujocoSimulator(SLIDE, MASS)
    model = SimulatorFilter(
        simulator,
        Box.whole(simulator.parameters),
        2,
        state=state_of,
        command=lambda action: action,
        observe=lambda state: torch.cat([state["qpos"], state["qvel"]], -1),
    )
    rows, steps = 7, 30
    seen = torch.randn(rows, steps, 2).double()
    told = Rows(seen[:, 0], torch.randn(rows, steps, 1).double(), seen, torch.ones(rows, steps, dtype=torch.bool))
    written, stepped = [], []
    write, record = Worlds.write_theta, Worlds.record
    monkeypatch.setattr(Worlds, "write_theta", lambda self, theta: written.append(len(theta)) or write(self, theta))
    monkeypatch.setattr(Worlds, "record", lambda self, ctrl: stepped.append(self.worlds) or record(self, ctrl))
    model(told, torch.rand(rows, 1).double())
    worlds = rows * (1 + 2 + 1)  # the mean, displaced by each value of the state and by theta
    assert written == [worlds]
    assert stepped == [worlds] * steps
