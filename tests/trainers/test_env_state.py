"""A collector that is built anew goes on to the last bit where another one stood."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from torchrl.collectors import Collector
from torchrl.envs import RewardSum, StepCounter, TransformedEnv, VecNormV2

from envs.hopper import PHYSICAL, HopperTask, hopper
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import Checkpoints, random_state, seed_everything, set_random_state
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers.env_state import collector_state, load_collector_state
from onlinebayes.transforms import ParameterRandomization, SensorNoise

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
WORLDS, STEPS = 6, 8


def pendulum() -> SimulatorEnv:
    return SimulatorEnv(Pendulum(SPACE, WORLDS), PendulumTask(horizon=11), seed=3)


def hopping() -> SimulatorEnv:
    return SimulatorEnv(hopper(PHYSICAL, WORLDS, threads=1), HopperTask(horizon=13), seed=3)


def out_of_step(collector: Collector) -> None:
    """Let each world stand at another step of its episode, so that they reset one by one."""
    collector.env.base_env._steps += torch.arange(WORLDS, dtype=torch.int32)


@contextmanager
def collecting(make: Callable[[], SimulatorEnv], *extra: Callable[[], Any], **settings: Any) -> Iterator[Collector]:
    """A stochastic policy in randomised worlds behind noisy sensors."""
    seed_everything(0)
    base = make()
    env = TransformedEnv(base, ParameterRandomization(BoxUniform(base.simulator.parameters)))
    env.append_transform(SensorNoise(torch.full((base.task.observation_size,), 0.01), seed=5))
    for transform in extra:
        env.append_transform(transform())
    policy = ppo(base.observation_spec_unbatched, base.action_spec_unbatched).policy
    batches = {"frames_per_batch": WORLDS * STEPS, "total_frames": -1, "trust_policy": True, **settings}
    collector = Collector(env, policy, auto_register_policy_transforms=False, **batches)
    try:
        yield collector
    finally:
        collector.shutdown()


def differing(first: TensorDictBase, second: TensorDictBase) -> list[object]:
    """Keys of what is not the same to the last bit."""
    keys = set(first.keys(True, True))
    assert keys == set(second.keys(True, True))
    return [key for key in keys if not torch.equal(first[key], second[key])]


CASES: dict[str, tuple[tuple[Callable[[], Any], ...], dict[str, Any]]] = {
    "as the library builds it": ((), {"track_traj_ids": False}),
    "with trajectory numbers": ((), {}),
    "counted and summed": ((StepCounter, RewardSum), {}),
    "normalised": ((lambda: VecNormV2(["observation"]),), {"track_traj_ids": False}),
    "random at first": ((), {"init_random_frames": 3 * WORLDS * STEPS}),
}


@pytest.mark.filterwarnings("ignore:Support of VecNormV2:UserWarning")
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("make", [pendulum, hopping])
@pytest.mark.parametrize("case", CASES)
def test_a_new_collector_goes_on_to_the_last_bit(case: str, make: Callable[[], SimulatorEnv], tmp_path: Path) -> None:
    extra, settings = CASES[case]
    with collecting(make, *extra, **settings) as collector:
        collector.reset()
        out_of_step(collector)
        for _ in range(2):
            collector.next()
        Checkpoints(tmp_path, "test").save({"collector": collector_state(collector), "random": random_state()})
        expected = [collector.next() for _ in range(3)]
    assert any(batch["next", "done"].any() for batch in expected)
    assert not all(batch["next", "done"].all(0).any() for batch in expected), "worlds reset one by one"
    with collecting(make, *extra, **settings) as collector:
        random.random(), torch.rand(3)
        saved = Checkpoints(tmp_path, "test").load().state
        load_collector_state(collector, saved["collector"])
        set_random_state(saved["random"])
        found = [collector.next() for _ in range(3)]
    assert [differing(*pair) for pair in zip(expected, found, strict=True)] == [[], [], []]


@pytest.mark.usefixtures("without_shape_checks")
def test_a_collector_that_has_been_running_goes_back_too(tmp_path: Path) -> None:
    with collecting(pendulum, StepCounter) as collector:
        collector.next()
        state = {"collector": collector_state(collector), "random": random_state()}
        Checkpoints(tmp_path, "test").save(state)
        expected = [collector.next() for _ in range(3)]
        saved = Checkpoints(tmp_path, "test").load().state
        load_collector_state(collector, saved["collector"])
        set_random_state(saved["random"])
        assert [differing(a, collector.next()) for a in expected] == [[], [], []]
