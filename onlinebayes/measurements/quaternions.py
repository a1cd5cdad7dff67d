"""Measured orientations on the unit sphere, without jumps of sign: q and -q are the same orientation.

    q_i <- s_i q_i / |q_i|,   s_i = sign(q_i . q_{i-1}),   i over the rows that were measured

A free joint's ``qpos`` holds its quaternion (w, x, y, z) at ``.3`` to ``.6``, a ball joint's at ``.0`` to ``.3``:
MuJoCo's order, https://mujoco.readthedocs.io/en/stable/modeling.html (frame orientations).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Int

from onlinebayes.runs import BadInput

LOOSEST = 0.1
"""The largest distance of a logged quaternion's norm from 1: rounding and slow filters, not another quantity."""


def quaternions(signals: Iterable[str]) -> tuple[tuple[str, str, str, str], ...]:
    """The signals that are quaternions (w, x, y, z): seven parts of ``qpos.<joint>`` make a free joint, four a ball.

    Unless each has a velocity: hinges called ``leg.0`` to ``leg.3`` have four, a ball joint has three.

    Args:
        signals: all of the model's, velocities among them.
    """
    signals = set(signals)
    joints = sorted({name.rpartition(".")[0] for name in signals if name.startswith("qpos.")})
    found = []
    for joint in joints:
        parts = [k for k in range(8) if f"{joint}.{k}" in signals]
        first = {7: 3, 4: 0}.get(len(parts))
        scalar = f"qvel.{joint.removeprefix('qpos.')}.{len(parts) - 1}" in signals
        if first is not None and parts == list(range(len(parts))) and not scalar:
            w, x, y, z = (f"{joint}.{first + k}" for k in range(4))
            found.append((w, x, y, z))
    return tuple(found)


def normalised(
    values: Mapping[str, np.ndarray],
    quaternion: tuple[str, str, str, str],
    where: str,
    rows: Int[np.ndarray, " T"],
) -> dict[str, np.ndarray]:
    """One run's quaternion with norm 1 and without jumps of sign.

    Args:
        values: signal -> (T,), nan where not measured.
        quaternion: its four signals.
        where, rows: for the message.

    Raises:
        BadInput: only some of its four parts were measured in a row, or its norm is not near 1.
    """
    given = [name for name in quaternion if name in values]
    if not given:
        return {}
    if len(given) < 4:
        lacking = next(name for name in quaternion if name not in values)
        raise BadInput(
            f"no column '{lacking}'", f"a quaternion has all four parts: {', '.join(quaternion)}", where=where
        )
    q = np.stack([values[name] for name in quaternion], -1)
    known = ~np.isnan(q)
    if (wrong := np.flatnonzero(known.any(-1) & ~known.all(-1))).size:
        raise BadInput(
            "only some parts of a quaternion",
            "measure all four in a row, or none",
            where=f"{where}, row {rows[wrong[0]]}, column '{quaternion[0]}'",
        )
    measured = known.all(-1)
    norm = np.linalg.norm(q[measured], axis=-1)
    if (wrong := np.flatnonzero(~(np.abs(norm - 1.0) <= LOOSEST))).size:
        raise BadInput(
            f"a quaternion of norm {norm[wrong[0]]:g}",
            "write unit quaternions w, x, y, z",
            where=f"{where}, row {rows[np.flatnonzero(measured)[wrong[0]]]}, column '{quaternion[0]}'",
        )
    unit = q[measured] / norm[:, None]
    turns = np.einsum("ij,ij->i", unit[1:], unit[:-1]) < 0
    unit[1:] *= np.where(np.cumsum(turns) % 2, -1.0, 1.0)[:, None]
    q[measured] = unit
    return dict(zip(quaternion, q.T, strict=True))
