"""Worlds that short rollouts share as long as they ask for the same theta, in the place of new ones each time.

A filter takes one step after the other from states of its own, all under one theta. To make M worlds anew, write theta
into them and derive the model's constants (``mj_setConst``) takes longer than their step.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.mujoco.worlds import Worlds

KEPT = 4
"""Sets of worlds that are kept, of all systems together: as many as a large batch is divided into."""

SHORT = 32
"""Timesteps of a rollout up to which its worlds are kept; a longer one costs more than its worlds do."""

Key = tuple[int, int, int, int, bytes]
"""Process, system, threads, worlds, theta: a process that was forked has no threads of its parent's.

A set of worlds holds its system, so that no other system has that ``id`` while the set is kept.
"""

_KEPT: OrderedDict[Key, tuple[Worlds, np.ndarray]] = OrderedDict()


@contextmanager
def worlds_at(system: MujocoSystem, theta: np.ndarray, threads: int, steps: int) -> Iterator[Worlds]:
    """Worlds (M,) with theta (M, P) written, in the state in which new ones are; nobody else has them meanwhile.

    Args:
        system: of the worlds.
        theta: parameters.
        threads: that step them, 0 for all cores.
        steps: timesteps that they are wanted for.
    """
    key = (os.getpid(), id(system), threads, len(theta), theta.tobytes())
    worlds, refused = _KEPT.pop(key, (None, np.zeros(0, dtype=bool)))
    if worlds is None:
        worlds = Worlds(system, len(theta), threads)
        worlds.write_theta(theta)
        refused = worlds.failed.copy()
    else:
        worlds.begin_again(refused)
    yield worlds
    if steps <= SHORT:
        _KEPT[key] = worlds, refused
        while len(_KEPT) > KEPT:
            _KEPT.popitem(last=False)
