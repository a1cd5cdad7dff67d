"""Compared methods, each ``fit(task) -> Fitted``: the engineer's model alone, ``refine`` with all candidates, sysid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import refine
from onlinebayes.identification import Windows, rollout, sensor_readings
from onlinebayes.simulators.identifiable import Identifiable
from recipes.studies.versus_sysid.task import Fitted, Task


def base(task: Task) -> Fitted:
    """The engineer's model, its free parameters fitted as criticism fits them, nothing added."""
    return Fitted((), partial(replayed, task.simulator, task.base_theta))


def ours(task: Task) -> Fitted:
    """As a user of the command line gets it; the first accepted effect claims what it is said to be equal to, too."""
    result = refine(task.simulator, task.measurement, holdout=task.holdout, selection=task.selection)
    equal = {c.effect: c.indistinguishable_from for c in result.candidates}
    claims = tuple(frozenset({key, *equal.get(key, ())}) for key in result.accepted)
    return Fitted(claims, partial(replayed, result.final.simulator, result.final.theta))


def sysid(task: Task) -> Fitted:
    """``mujoco.sysid``, imported where it is asked for: it is one of the peers."""
    from recipes.studies.versus_sysid.sysid import fit

    return fit(task)


METHODS: Mapping[str, Callable[[Task], Fitted]] = {"base": base, "ours": ours, "sysid": sysid}


def replayed(model: Identifiable, theta: Float[Tensor, " P"], windows: Windows) -> Float[Tensor, "W K S"]:
    """Signals of a model over windows; nan from the row on in which it diverged."""
    trajectory = rollout(model, windows, theta[None], windows.start[None])
    signals = sensor_readings(model, windows, theta[None], windows.start[None], trajectory)[0]
    valid = trajectory["valid"][0, ..., None] & torch.isfinite(signals)
    return torch.where(valid, signals, torch.nan)
