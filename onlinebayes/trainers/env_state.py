"""The state of an environment and its collector, so that a run that was stopped goes on to the last bit.

An environment of another kind, a robot or a Gymnasium game, cannot say where it stands in an episode. What can be told
of it is kept: the transforms' state, the random numbers of Gymnasium's and dm_control's worlds, and what a collector
has counted. Trajectories that begin with a reset are the same to the last bit then; a policy's episodes begin anew.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase, SerialEnv, TransformedEnv

from onlinebayes.simulators import SimulatorEnv


def stands(env: EnvBase) -> bool:
    """Check whether an environment can say where its worlds stand in their episodes."""
    return isinstance(env.base_env if isinstance(env, TransformedEnv) else env, SimulatorEnv)


def env_state(env: EnvBase) -> dict[str, Any]:
    """State of the worlds and of every transform above them."""
    base = env.base_env if isinstance(env, TransformedEnv) else env
    return {
        "worlds": base.get_extra_state() if isinstance(base, SimulatorEnv) else None,
        "random": [_told(numbers) for numbers in _random_numbers(base)],
        "transforms": dict(env.transform.state_dict()) if isinstance(env, TransformedEnv) else {},
    }


def load_env_state(env: EnvBase, state: Mapping[str, Any]) -> None:
    """Stand where :func:`env_state` was taken."""
    base = env.base_env if isinstance(env, TransformedEnv) else env
    if state["worlds"] is not None and isinstance(base, SimulatorEnv):
        base.set_extra_state(state["worlds"])
    for numbers, told in zip(_random_numbers(base), state.get("random", ()), strict=False):
        _go_on(numbers, told)
    if isinstance(env, TransformedEnv):
        env.transform.load_state_dict(dict(state["transforms"]))


def collector_state(collector: Any) -> dict[str, Any]:
    """State of a collector's environment, what it carries from one batch to the next, and what it has counted."""
    carried: TensorDictBase = collector._carrier
    return {
        "env": env_state(collector.env),
        "carried": dict(carried.flatten_keys("\n").clone().items()),
        "frames": collector._frames,
        "batches": collector._iter,
        "episodes": collector._traj_pool.state_dict() if collector.track_traj_ids else None,
    }


def load_collector_state(collector: Any, state: Mapping[str, Any]) -> bool:
    """The next batch is the one that would have come; False where it has to begin with a reset.

    What was carried belongs to worlds that are gone, where these cannot say where they stood.
    """
    load_env_state(collector.env, state["env"])
    known = state["env"]["worlds"] is not None
    if known:
        device = None if collector._carrier_has_no_device else collector.env.device
        carried = TensorDict(dict(state["carried"]), batch_size=collector.env.batch_size, device=device)
        collector._carrier = carried.unflatten_keys("\n")
    collector._frames, collector._iter = state["frames"], state["batches"]
    if collector.track_traj_ids:
        collector._traj_pool.load_state_dict(state["episodes"])
    return known


Numbers = np.random.Generator | np.random.RandomState


def _random_numbers(env: EnvBase) -> Iterator[Numbers]:
    """Those that the worlds of this process draw from, world by world, where they are found."""
    while isinstance(env, TransformedEnv):
        env = env.base_env
    if isinstance(env, SerialEnv):
        if not env.is_closed:
            for world in env._envs:
                yield from _random_numbers(world)
        return
    inner = env.__dict__.get("_env", env)
    inner = getattr(inner, "unwrapped", inner)
    for holder, name in ((inner, "np_random"), (getattr(inner, "task", None), "random")):
        numbers = getattr(holder, name, None)
        if isinstance(numbers, Numbers):
            yield numbers


def _told(numbers: Numbers) -> str:
    """Where they stand; whole numbers of 128 bits are text."""
    if isinstance(numbers, np.random.Generator):
        return json.dumps(numbers.bit_generator.state)
    kind, keys, position, has_gauss, cached = numbers.get_state(legacy=True)
    return json.dumps([str(kind), np.asarray(keys).tolist(), position, has_gauss, cached])


def _go_on(numbers: Numbers, told: str) -> None:
    """Draw on from there."""
    state = json.loads(told)
    if isinstance(numbers, np.random.Generator):
        numbers.bit_generator.state = state
    else:
        numbers.set_state((state[0], np.array(state[1], dtype=np.uint32), *state[2:]))
