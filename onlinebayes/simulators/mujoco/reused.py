"""Worlds that short rollouts share as long as they ask for the same theta, in the place of new ones each time.

A filter takes one step after the other from states of its own, all under one theta. To make M worlds anew, write theta
into them and derive the model's constants (``mj_setConst``) takes longer than their step.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from weakref import WeakKeyDictionary

import numpy as np

from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.mujoco.worlds import Worlds

KEPT = 4
"""Sets of worlds of a system that are kept: as many as a large batch is divided into."""

SHORT = 32
"""Timesteps of a rollout up to which its worlds are kept; a longer one costs more than its worlds do."""

Key = tuple[int, int, int, bytes]
"""Process, threads, worlds, theta: a process that was forked has no threads of its parent's."""

_KEPT: WeakKeyDictionary[MujocoSystem, OrderedDict[Key, tuple[Worlds, np.ndarray]]] = WeakKeyDictionary()


@contextmanager
def worlds_at(system: MujocoSystem, theta: np.ndarray, threads: int, steps: int) -> Iterator[Worlds]:
    """Worlds (M,) with theta (M, P) written, in the state in which new ones are; nobody else has them meanwhile.

    Args:
        system: of the worlds.
        theta: parameters.
        threads: that step them, 0 for all cores.
        steps: timesteps that they are wanted for.
    """
    key, kept = (os.getpid(), threads, len(theta), theta.tobytes()), _KEPT.setdefault(system, OrderedDict())
    worlds, refused = kept.pop(key, (None, np.zeros(0, dtype=bool)))
    if worlds is None:
        worlds = Worlds(system, len(theta), threads)
        worlds.write_theta(theta)
        refused = worlds.failed.copy()
    else:
        worlds.begin_again(refused)
    yield worlds
    if steps <= SHORT:
        kept[key] = worlds, refused
        while len(kept) > KEPT:
            kept.popitem(last=False)
