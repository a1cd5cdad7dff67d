"""States that satisfy a model's equality constraints: closed loops, and joints that are geared together.

    q <- q (+) -J^+ c(q)   until it stays;      v <- v - J^+ J v

c and J are MuJoCo's own rows of the active ``<equality>`` constraints (``efc_pos``, ``efc_J``; its documentation,
"Computation: constraint model") and (+) is ``mj_integratePos``: Gauss and Newton's way to the nearest state. Where some
coordinates are known, J has the columns of the others. A state beside the constraints would be pulled back by a soft
spring, which no machine has.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Bool, Float

TYING = tuple(int(getattr(mujoco.mjtEq, f"mjEQ_{kind}")) for kind in ("CONNECT", "WELD", "JOINT"))
STAYS = 1e-11  # [m, rad]
MOST_STEPS = 50
RANK = 1e-6  # of the largest singular value: constraints may be redundant
DETERMINED = 1e-3  # of the largest singular value
RIGID = ([0.01, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0])  # solref, solimp
APPROACH = 50  # steps from the model's own pose to a path's first row


def tied(model: mujoco.MjModel) -> list[int]:
    """Numbers of the active equality constraints between bodies or joints."""
    return [i for i in range(model.neq) if model.eq_active0[i] and model.eq_type[i] in TYING]


def soft(spec: mujoco.MjSpec) -> list[mujoco.MjsEquality]:
    """The active constraints between bodies or joints that are as soft as MuJoCo makes them where nothing is said.

    With its ``solimp`` of 0.9 a tenth of what would pull a loop apart is let through, and the springs that take care of
    it need 20 ms: a slider-crank erred by radians. Who gave them numbers meant a belt, or a gear that gives way.
    """
    fresh = mujoco.MjSpec().add_equality()
    return [
        tie
        for tie in spec.equalities
        if tie.active
        and int(tie.type) in TYING
        and np.array_equal(tie.solref, fresh.solref)
        and np.array_equal(tie.solimp, fresh.solimp)
    ]


def rigid(spec: mujoco.MjSpec) -> mujoco.MjSpec | None:
    """A copy in which the constraints of :func:`soft` are rigid; None where there are none."""
    spec = spec.copy()
    ties = soft(spec)
    for tie in ties:
        tie.solref, tie.solimp = RIGID
    return spec if ties else None


class Closure:
    """The equality constraints of one model.

    Args:
        model: the compiled model; its free parameters are taken to leave the constraints as they are.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        off = mujoco.mjtDisableBit
        for bit in (off.mjDSBL_CONTACT, off.mjDSBL_LIMIT, off.mjDSBL_FRICTIONLOSS):
            self._model.opt.disableflags |= int(bit)
        self._model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
        self._data = mujoco.MjData(self._model)

    def nearest(
        self, qpos: Float[np.ndarray, "N nq"], qvel: Float[np.ndarray, "N nv"]
    ) -> tuple[Float[np.ndarray, "N nq"], Float[np.ndarray, "N nv"]]:
        """The states on the constraints that are nearest to these; where none is found, where the search ended.

        Args:
            qpos, qvel: states [m, rad; m/s, rad/s].
        """
        qpos, qvel = qpos.copy(), qvel.copy()
        for q, v in zip(qpos, qvel, strict=True):
            J = self._close(q, range(self._model.nv))
            v -= np.linalg.pinv(J, rcond=RANK) @ (J @ v)
        return qpos, qvel

    def follow(
        self, path: Float[np.ndarray, "T nq"], known: Sequence[int]
    ) -> tuple[Float[np.ndarray, "T nq"], Bool[np.ndarray, " T"]]:
        """The other coordinates along a path of the known ones, and the rows in which these determine them.

        The mechanism is moved from the model's own pose to the first row and on from row to row, so that it stays
        assembled as it was. Models of slides and hinges only.

        Args:
            path: positions; what is not known is overwritten [m, rad].
            known: numbers of the coordinates that were measured.
        """
        others = [j for j in range(self._model.nv) if j not in known]
        full, determined = path.copy(), np.ones(len(path), dtype=bool)
        if not others:  # all were measured
            return full, determined
        q = self._model.qpos0.copy()
        for share in np.linspace(0.0, 1.0, APPROACH, endpoint=False):
            q[known] = self._model.qpos0[known] + share * (path[0, known] - self._model.qpos0[known])
            self._close(q, others)
        for t, row in enumerate(path):
            q[known] = row[known]
            size = np.linalg.svd(self._close(q, others)[:, others], compute_uv=False)
            determined[t] = len(size) >= len(others) and size[len(others) - 1] > DETERMINED * size[0]
            full[t, others] = q[others]
        return full, determined

    def _close(self, q: Float[np.ndarray, " nq"], moving: Sequence[int]) -> Float[np.ndarray, "E nv"]:
        """Moves some coordinates of ``q`` onto the constraints; returns J there."""
        for _ in range(MOST_STEPS):
            self._data.qpos[:] = q
            mujoco.mj_fwdPosition(self._model, self._data)
            J = self._data.efc_J.reshape(-1, self._model.nv)[: self._data.ne].copy()
            step = np.zeros(self._model.nv)
            step[list(moving)] = -np.linalg.pinv(J[:, list(moving)], rcond=RANK) @ self._data.efc_pos[: self._data.ne]
            if np.abs(step).max() <= STAYS:
                break
            mujoco.mj_integratePos(self._model, q, step, 1.0)
        return J
