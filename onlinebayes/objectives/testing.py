"""Conformance checks for objectives, for the tests of those you write yourself.

    check_objective(lambda: my_objective(*specs), make_env)

| check     | what it asks                                                                                   |
|-----------|------------------------------------------------------------------------------------------------|
| acts      | its actions lie within the environment's action spec                                            |
| learns    | an update of a collector's batch gives finite losses, moves weights and leaves the batch as it was |
| goes on   | from a saved state the next update is the same to the last bit                                  |
| numbers   | a NaN or an infinity in any entry of the batch is refused and nothing is learnt, or is not read |

The last one goes through every leaf of the batch: observations, those after the step, actions, rewards, log-densities
and whatever else a policy writes.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.envs import EnvBase

from onlinebayes.objectives.base import Objective
from onlinebayes.runs import BadInput

Make = Callable[[], Objective]
MakeEnv = Callable[[], EnvBase]
STEPS = 32


def check_objective(make: Make, make_env: MakeEnv, *, steps: int = STEPS) -> None:
    """Run every check.

    Args:
        make: a new objective for the environment's specs, small enough to learn in a moment.
        make_env: a new environment, batch size (N,), with the transforms that the policy needs.
        steps: T of a batch.

    Raises:
        AssertionError: of the first check that fails.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        assert isinstance(make(), Objective), f"{type(make()).__name__} lacks a member of the protocol"
        data = check_acts(make(), make_env(), steps)
        check_learns(make(), data)
        check_goes_on(make, data)
        check_numbers(make, data)


def check_acts(objective: Objective, env: EnvBase, steps: int = STEPS) -> TensorDictBase:
    """Actions lie within the spec; returns the batch (N, T) that was collected."""
    frames = env.batch_size.numel() * steps
    collector = Collector(
        env, objective.policy, frames_per_batch=frames, total_frames=frames, auto_register_policy_transforms=False
    )
    data = next(iter(collector))
    for key in env.action_keys:
        for step in data.unbind(1):
            assert env.full_action_spec[key].is_in(step[key]), f"an action {key!r} leaves the environment's spec"
    collector.shutdown()
    return data


def check_learns(objective: Objective, data: TensorDictBase) -> None:
    """Losses are finite, weights move, the batch stays."""
    before, batch = saved(objective), data.clone()
    losses = objective.update(batch)
    assert torch.tensor(list(losses.values())).isfinite().all(), f"a loss is not finite: {losses}"
    assert not same(before, saved(objective)), "an update moves nothing"
    for key in data.keys(True, True):
        assert torch.equal(batch[key], data[key]), f"an update changes {key!r} of the batch that it was given"


def check_goes_on(make: Make, data: TensorDictBase) -> None:
    """Check that a loaded objective learns on exactly as the saved one."""
    first, second = make(), make()
    first.update(data.clone())
    second.load_state_dict(saved(first))
    for objective in (first, second):
        torch.manual_seed(1)
        objective.update(data.clone())
    assert same(saved(first), saved(second)), "an update after load_state_dict is not the one after state_dict"


def check_numbers(make: Make, data: TensorDictBase) -> None:
    """A value that is no finite number, in any leaf of the batch, is refused or not read."""
    objective = make()
    objective.update(data.clone())
    begun = saved(objective)
    expected = learnt(objective, begun, data)
    for key in [key for key, value in data.items(True, True) if value.is_floating_point()]:
        for value in (torch.nan, torch.inf):
            try:
                found = learnt(objective, begun, poisoned(data, key, value))
            except Exception as error:
                raise AssertionError(f"{value} in {key!r} ends in {type(error).__name__}: {error}") from error
            assert same(found, begun) or same(found, expected), f"it learns from {value} in {key!r}"


def learnt(objective: Objective, begun: Mapping[str, Any], data: TensorDictBase) -> dict[str, Any]:
    """State after an update from a state; where the batch is refused that is the state as the objective then has it."""
    objective.load_state_dict(copy.deepcopy(dict(begun)))
    torch.manual_seed(2)
    with contextlib.suppress(BadInput):
        objective.update(data.clone())
    return saved(objective)


def poisoned(data: TensorDictBase, key: Any, value: float) -> TensorDictBase:
    """The batch with one number in another's place."""
    values = data[key].clone(memory_format=torch.contiguous_format)
    values.view(-1)[values.numel() // 2] = value
    return data.clone().set(key, values)


def saved(objective: Objective) -> dict[str, Any]:
    """A copy of its state."""
    return copy.deepcopy(objective.state_dict())


def same(first: Any, second: Any) -> bool:
    """Check whether two states are equal to the last bit; a NaN equals none."""
    one, other = dict(leaves(first)), dict(leaves(second))
    return one.keys() == other.keys() and all(
        torch.equal(value, other[path]) if isinstance(value, Tensor) else value == other[path]
        for path, value in one.items()
    )


def leaves(state: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Every value of a nested state with the way to it."""
    if isinstance(state, Mapping):
        for key, value in state.items():
            yield from leaves(value, (*path, key))
    elif isinstance(state, list | tuple):
        for i, value in enumerate(state):
            yield from leaves(value, (*path, i))
    else:
        yield path, state


__all__ = ["check_acts", "check_goes_on", "check_learns", "check_numbers", "check_objective"]
