"""Joints that nobody measured, where constraints of the model tie them to those that were: worked out row by row.

    c(q) = 0,   q = (measured, others)      ->      others(t) from measured(t)

A four-bar linkage has one encoder and three joints. The others' positions enter as if they were measured: what shows
in them shows in the encoder, too, and which of their readings an instrument would spoil nobody can tell.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import torch
from tensordict import TensorDict

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.simulators.identifiable import Identifiable


def follow(simulator: Identifiable, have: Collection[str]) -> set[str]:
    """The positions that constraints tie to those among ``have``, ``qpos.<joint>``, in the model's own pose."""
    names = [name for name in simulator.signals if name.startswith("qpos.")]
    known = [j for j, name in enumerate(names) if name in have]
    if not known:
        return set()
    pose = simulator.constrained_positions(simulator.state["qpos"][:1], known)[0]
    return {names[j] for j in pose.isfinite().nonzero()[:, 0].tolist() if j not in known}


def completed(simulator: Identifiable, measurement: Measurement) -> tuple[Measurement, tuple[str, ...]]:
    """The measurement with the positions that follow from it, and a note that names them.

    Args:
        simulator: the model.
        measurement: of at least one joint's position; joints without a signal are worked out where they can be.
    """
    joints = [name.removeprefix("qpos.") for name in simulator.signals if name.startswith("qpos.")]
    names = [signal.name for signal in measurement.signals]
    known = [j for j, joint in enumerate(joints) if f"qpos.{joint}" in names]
    lacking = [j for j, joint in enumerate(joints) if not {f"qpos.{joint}", f"qvel.{joint}"} & set(names)]
    if not (known and lacking):
        return measurement, ()
    data = measurement.data
    columns = [names.index(f"qpos.{joints[j]}") for j in known]
    rows = data["measured"][..., columns].all(-1) & data["mask"]
    value = data["signal"].new_zeros(*rows.shape, len(joints))
    for r in range(len(rows)):
        if not bool(rows[r].any()):
            continue
        path = value.new_zeros(int(rows[r].sum()), len(joints))
        path[:, known] = data["signal"][r][rows[r]][:, columns]
        value[r, rows[r]] = simulator.constrained_positions(path, known)
    seen = rows[..., None] & torch.isfinite(value)
    tied = [j for j in lacking if bool(seen[..., j].any())]
    if not tied:
        return measurement, ()
    more = TensorDict(
        {
            **data,
            "signal": torch.cat([data["signal"], torch.where(seen, value, 0.0)[..., tied]], -1),
            "measured": torch.cat([data["measured"], seen[..., tied]], -1),
        },
        batch_size=data.batch_size,
        device=data.device,
    )
    kinds = simulator.joint_kinds
    signals = tuple(Signal(f"qpos.{joints[j]}", "m" if kinds.get(joints[j]) == "slide" else "rad") for j in tied)
    told = ", ".join(signal.name for signal in signals)
    note = f"not measured, and worked out from what was by the model's <equality>: {told}"
    return replace(measurement, data=more, signals=(*measurement.signals, *signals)), (note,)
