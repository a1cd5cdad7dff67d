"""The state of an environment and its collector, so that a run that was stopped goes on to the last bit.

An environment of another kind, a robot or a Gymnasium game, cannot give its state: then only the transforms'
state is kept, and the run goes on from fresh episodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase, TransformedEnv

from onlinebayes.simulators import SimulatorEnv


def env_state(env: EnvBase) -> dict[str, Any]:
    """State of the worlds and of every transform above them."""
    base = env.base_env if isinstance(env, TransformedEnv) else env
    return {
        "worlds": base.get_extra_state() if isinstance(base, SimulatorEnv) else None,
        "transforms": dict(env.transform.state_dict()) if isinstance(env, TransformedEnv) else {},
    }


def load_env_state(env: EnvBase, state: Mapping[str, Any]) -> None:
    """Stand where :func:`env_state` was taken."""
    base = env.base_env if isinstance(env, TransformedEnv) else env
    if state["worlds"] is not None and isinstance(base, SimulatorEnv):
        base.set_extra_state(state["worlds"])
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


def load_collector_state(collector: Any, state: Mapping[str, Any]) -> None:
    """The next batch is the one that would have come; fresh episodes where the worlds cannot say where they stood."""
    load_env_state(collector.env, state["env"])
    if state["env"]["worlds"] is None:
        # What was carried belongs to worlds that are gone.
        collector.reset()
        return
    device = None if collector._carrier_has_no_device else collector.env.device
    carried = TensorDict(dict(state["carried"]), batch_size=collector.env.batch_size, device=device)
    collector._carrier = carried.unflatten_keys("\n")
    collector._frames, collector._iter = state["frames"], state["batches"]
    if collector.track_traj_ids:
        collector._traj_pool.load_state_dict(state["episodes"])
