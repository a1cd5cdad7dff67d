"""Conformance checks for transforms, modelled on the list that TorchRL sets its own transforms.

| check               | TorchRL's ``TransformBase``                     | what it asks                               |
|---------------------|-------------------------------------------------|--------------------------------------------|
| ``check_single``    | ``single_trans_env_check``                      | specs hold alone and in a composition      |
| ``check_serial``    | ``serial_trans_env_check``                      | several transformed environments in series |
| ``check_batched``   | ``trans_serial_env_check``                      | one transform over several environments    |
| ``check_parallel``  | ``parallel_trans_`` and ``trans_parallel_env_check`` | the same in processes of their own    |
| ``check_rollout``   | ``transform_env``                               | data match the specs over partial resets   |
| ``check_collector`` |                                                 | the same through a ``Collector``           |
| ``check_module``    | ``transform_no_env``, ``transform_model``       | a module without an environment            |
| ``check_buffer``    | ``transform_rb``                                | a replay buffer's transform                |
| ``check_inverse``   | ``transform_inverse``                           | what a policy wrote arrives, unchanged     |

Each takes factories, for a transform belongs to one environment; the environment should end episodes within 60 random
steps, so that resets are partial. ``check_transform`` runs them all but the processes, which take 20 s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import torch
from tensordict import TensorDictBase
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import (
    Compose,
    EnvBase,
    ParallelEnv,
    RewardSum,
    SerialEnv,
    Transform,
    TransformedEnv,
    check_env_specs,
)

from onlinebayes.runs import torch_threads_kept

MakeEnv = Callable[[], EnvBase]
MakeTransform = Callable[[], Transform]
STEPS = 60


@contextmanager
def _leaving_all_as_it_was() -> Iterator[None]:
    """Put torch's threads and random numbers back."""
    with torch_threads_kept(), torch.random.fork_rng(devices=[]):
        yield


@_leaving_all_as_it_was()
def check_transform(
    make_env: MakeEnv, make_transform: MakeTransform, example: Callable[[], TensorDictBase] | None = None
) -> None:
    """Run every check that needs no processes.

    Args:
        make_env: gives a new base environment.
        make_transform: gives a new transform.
        example: data (B, T) for the transform as a module; without it that is skipped.

    Raises:
        AssertionError: of the first check that fails.
    """
    check_single(make_env, make_transform)
    check_serial(make_env, make_transform)
    check_batched(make_env, make_transform)
    check_rollout(make_env, make_transform)
    check_collector(make_env, make_transform)
    check_inverse(make_env, make_transform)
    if example is not None:
        check_module(make_transform, example)
        check_buffer(make_transform, example)


def check_single(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """TorchRL's ``check_env_specs`` on the transformed environment, alone and in a ``Compose``."""
    check_env_specs(TransformedEnv(make_env(), make_transform()))
    check_env_specs(TransformedEnv(make_env(), Compose(make_transform(), RewardSum())))


@_leaving_all_as_it_was()
def check_serial(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """Two transformed environments one after the other."""
    _check_nested(SerialEnv(2, partial(_transformed, make_env, make_transform)))


@_leaving_all_as_it_was()
def check_batched(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """One transform over two environments."""
    _check_nested(TransformedEnv(SerialEnv(2, make_env), make_transform()))


@_leaving_all_as_it_was()
def check_parallel(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """As ``check_serial`` and ``check_batched``, in processes; the factories must be functions of a module."""
    _check_nested(ParallelEnv(2, partial(_transformed, make_env, make_transform)))
    _check_nested(TransformedEnv(ParallelEnv(2, make_env), make_transform()))


def check_rollout(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """Specs hold at every step of a rollout with partial resets, and on the transform's keys after a reset too."""
    env = TransformedEnv(make_env(), make_transform())
    _check_data(env, env.rollout(STEPS, break_when_any_done=False))


def check_collector(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """Specs hold for what a ``Collector`` gives, auto-reset on, over two batches."""
    env = TransformedEnv(make_env(), make_transform())
    frames = env.batch_size.numel() * STEPS
    collector = Collector(env, frames_per_batch=frames, total_frames=2 * frames, track_traj_ids=False)
    for batch in collector:
        _check_data(env, batch)
    collector.shutdown()


def check_module(make_transform: MakeTransform, example: Callable[[], TensorDictBase]) -> None:
    """As a module and in a ``Sequential`` it gives the same kind of data as alone, and keeps the batch size."""
    data = example()
    alone = make_transform()(example())
    chained = nn.Sequential(make_transform(), Compose(make_transform()))(example())
    assert alone.batch_size == data.batch_size, "forward changed the batch size"
    assert chained.batch_size == data.batch_size, "forward in a Sequential changed the batch size"
    missing = set(alone.keys(True, True)) ^ set(chained.keys(True, True))
    assert not missing, f"forward twice gives other keys than once: {sorted(map(str, missing))}"


def check_buffer(make_transform: MakeTransform, example: Callable[[], TensorDictBase]) -> None:
    """Data stored in a replay buffer come out of it with what the module would write."""
    data = example()
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(len(data)), transform=make_transform(), batch_size=2)
    buffer.extend(data)
    sample = buffer.sample()
    missing = set(make_transform()(example()).keys(True, True)) - set(sample.keys(True, True))
    assert not missing, f"a buffer's sample lacks {sorted(map(str, missing))}"


def check_inverse(make_env: MakeEnv, make_transform: MakeTransform) -> None:
    """Check that a policy's action reaches the environment within its specs, and is unchanged for the caller."""
    env = TransformedEnv(make_env(), make_transform())
    given = env.rand_action(env.reset())
    before = given.clone()
    env.step(given)
    for key in before.keys(True, True):
        assert torch.equal(before[key], given[key]), f"a step changed '{key}' of the tensordict it was given"
    inner = env.transform.inv(before.clone())
    for key in env.base_env.action_keys:
        value = inner.get(key)
        assert env.base_env.full_action_spec[key].is_in(value), f"'{key}' leaves the base environment's spec"


def _transformed(make_env: MakeEnv, make_transform: MakeTransform) -> EnvBase:
    return TransformedEnv(make_env(), make_transform())


def _check_nested(env: EnvBase) -> None:
    try:
        check_env_specs(env)
        _check_data(env, env.rollout(STEPS, break_when_any_done=False))
    finally:
        env.close(raise_if_closed=False)


def _check_data(env: EnvBase, data: TensorDictBase) -> None:
    """Every leaf of the observation and done specs stands at the root and under "next", within its spec."""
    done = data["next", "done"]
    assert bool(done.any()), f"no episode ended within {STEPS} steps: give an environment that resets sooner"
    time = data.ndim - 1
    for step in data.unbind(time):
        for side in (step, step["next"]):
            for key, spec in env.full_observation_spec.items(True, True):
                value = side.get(key)
                assert value is not None, f"'{key}' is in the specs and not in the data"
                assert spec.is_in(value), f"'{key}' of shape {tuple(value.shape)}, {value.dtype} leaves its spec"
    # The observation before step k + 1 is the one after step k, unless that world was reset in between.
    shared = [key for key in env.full_observation_spec.keys(True, True) if key in data["next"].keys(True, True)]
    ended = done.any(-1)
    for key in shared:
        before, after = data[key].movedim(time, 0)[1:], data["next", key].movedim(time, 0)[:-1]
        kept = ~ended.movedim(time, 0)[:-1]
        assert torch.equal(before[kept], after[kept]), f"'{key}' of a world that did not reset was changed"


__all__ = [
    "STEPS",
    "check_batched",
    "check_buffer",
    "check_collector",
    "check_inverse",
    "check_module",
    "check_parallel",
    "check_rollout",
    "check_serial",
    "check_single",
    "check_transform",
]
