"""Conformance checks for planners, for the tests of those you write yourself.

    check_planner(lambda: MyPlanner(...), make_env, belief, another_belief)

| check      | what it asks                                                                              |
|------------|-------------------------------------------------------------------------------------------|
| acts       | as a policy in an environment that resets itself and in a ``Collector``, within the specs |
| batch      | each environment of a batch gets the action that it would get alone                       |
| beginnings | ``is_init`` makes a row plan anew, and leaves the other rows alone                        |
| belief     | another belief leads to another action                                                    |
| resumes    | ``state_dict`` decides all actions that follow, to the last bit                           |
| copies     | a deep copy acts alike, and is left alone by what its original is told                    |
| random     | the global random numbers stay where they are                                             |
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import cast

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, InitTracker, TransformedEnv

from onlinebayes.transforms import Distribution

STEPS = 6


def check_planner(
    make: Callable[[], TensorDictModuleBase],
    make_env: Callable[[], EnvBase],
    belief: Distribution,
    other: Distribution,
) -> None:
    """Run every check.

    Args:
        make: a fresh planner without a belief; the same seed each time.
        make_env: a fresh environment of at least two worlds, whose episodes end within a few steps.
        belief, other: two that ask for different plans.

    Raises:
        AssertionError: of the first check that fails.
    """

    def told(by: Distribution) -> TensorDictModuleBase:
        planner = make()
        planner.set_belief(by)
        return planner

    seen = cast(TensorDict, make_env().reset()).select(*make().in_keys)
    _check_acts(told(belief), make_env)
    _check_batch(lambda: told(belief), seen)
    _check_beginnings(told(belief), seen)
    assert not torch.equal(_act(told(belief), seen), _act(told(other), seen)), "the belief changes nothing"
    _check_resumes(told(belief), told(other), seen)
    _check_copies(told(belief), other, seen)
    before = torch.get_rng_state()
    _act(told(belief), seen)
    assert torch.equal(before, torch.get_rng_state()), "planning draws from the global random numbers"


def _act(planner: TensorDictModuleBase, seen: TensorDictBase, init: Tensor | None = None) -> Tensor:
    given = seen.clone()
    if init is not None:
        given.set("is_init", init)
    return planner(given).get(planner.out_keys[0]).clone()


def _check_acts(planner: TensorDictModuleBase, make_env: Callable[[], EnvBase]) -> None:
    env = TransformedEnv(make_env(), InitTracker())
    data = env.rollout(STEPS, planner, break_when_any_done=False)
    frames = env.batch_size.numel() * STEPS
    collector = Collector(env, planner, frames_per_batch=frames, total_frames=frames, track_traj_ids=False)
    for batch in (data, *collector):
        action = batch.get(planner.out_keys[0])
        spec = env.full_action_spec[env.action_key]
        assert all(spec.is_in(action[:, k]) for k in range(STEPS)), "an action leaves the environment's spec"
    collector.shutdown()


def _check_batch(make: Callable[[], TensorDictModuleBase], seen: TensorDictBase) -> None:
    together, alone = make(), [make() for _ in range(len(seen))]
    for _ in range(2):
        each = torch.cat([_act(planner, seen[i : i + 1]) for i, planner in enumerate(alone)])
        assert torch.allclose(_act(together, seen), each, atol=1e-5), "a batch is planned otherwise than one by one"


def _check_beginnings(planner: TensorDictModuleBase, seen: TensorDictBase) -> None:
    init = torch.zeros(len(seen), 1, dtype=torch.bool)
    _act(planner, seen, ~init)
    init[0] = True
    anew, some, none = (copy.deepcopy(planner) for _ in range(3))
    all_anew, some_anew, kept = _act(anew, seen, init | True), _act(some, seen, init), _act(none, seen, init & False)
    assert torch.allclose(some_anew[0], all_anew[0], atol=1e-6), "a row that begins keeps its old plan"
    assert torch.allclose(some_anew[1:], kept[1:], atol=1e-6), "a row that goes on lost its plan"


def _check_resumes(first: TensorDictModuleBase, second: TensorDictModuleBase, seen: TensorDictBase) -> None:
    _act(first, seen)
    second.load_state_dict(first.state_dict())
    for _ in range(2):
        assert torch.equal(_act(first, seen), _act(second, seen)), "a resumed planner goes another way"


def _check_copies(planner: TensorDictModuleBase, other: Distribution, seen: TensorDictBase) -> None:
    copied, again = copy.deepcopy(planner), copy.deepcopy(planner)
    wanted = _act(planner, seen)
    assert torch.equal(_act(copied, seen), wanted), "a copy acts otherwise"
    planner.set_belief(other)
    _act(planner, seen)
    assert torch.equal(_act(again, seen), wanted), "what the original is told reaches its copy"
