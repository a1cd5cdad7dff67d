"""All ten inertial parameters of a body as numbers that may take any value: ``body.x.inertial[i]``, 0 as in the model.

    J = [[S, m c], [m c', m]],    S = integral of x x' dm over the body, in its frame    (pseudo-inertia, 4 x 4)
    J(phi) = U0 V V' U0',   U0 U0' = J of the model,
             [ exp d1   s12     s13    t1 ]
    V = e^a  [   0     exp d2   s23    t2 ],     phi = (a, d1, d2, d3, s12, s23, s13, t1, t2, t3)
             [   0       0     exp d3  t3 ]
             [   0       0       0      1 ]

Every phi is a body that mass can be laid out to: J stays positive definite, which bounds on mass, centre and moments
one by one do not see to (Wensing, Kim and Slotine 2018; log-Cholesky parameters: Rucker and Wensing 2022). Taken
relative to the model's own, 0.1 is ten per cent or so whatever the body: ``a`` scales all of it (mass by e^2a), ``d``
stretch it, ``s`` shear it, ``t`` move the centre, by the body's own radius of gyration.
"""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from onlinebayes.runs import BadInput

ARRAY = "body_inertial"
"""The array (nbody, 10) that stands for the four below; MuJoCo does not have it."""
FIELDS = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
SIZE = 10
_SHEARS = ((0, 1), (1, 2), (0, 2))


def own(model: mujoco.MjModel) -> Float[np.ndarray, "bodies 10"]:
    """phi of the model as it is: nothing."""
    return np.zeros((model.nbody, SIZE))


def bodies(model: mujoco.MjModel, cells: Iterable[tuple[str, str, tuple[int | slice, ...]]]) -> list[int]:
    """Ids of the bodies of which parameters set :data:`ARRAY`.

    Args:
        model: the compiled model.
        cells: address, array and index of everything that parameters set.

    Raises:
        BadInput: a mass, a centre or a moment of such a body is free as well.
    """
    rows = np.arange(model.nbody)
    mine = [cell for cell in cells if cell[1] == ARRAY or cell[1] in FIELDS]
    places = [(name, array, int(i)) for name, array, index in mine for i in np.atleast_1d(rows[index[0]])]
    found = {body: name for name, array, body in places if array == ARRAY}
    for name, array, body in places:
        if array != ARRAY and body in found:
            raise BadInput(f"'{name}' and '{found[body]}' are the same body's inertia", "leave one of them out")
    return sorted(found)


def factor(model: mujoco.MjModel, body: int) -> Float[np.ndarray, "4 4"]:
    """U0 of one body, upper triangular.

    Raises:
        BadInput: the body is a point, a line or a plane, whose J is singular.
    """
    m, c = float(model.body_mass[body]), model.body_ipos[body]
    R = Rotation.from_quat(model.body_iquat[body], scalar_first=True).as_matrix()
    moments = model.body_inertia[body]
    J = np.empty((4, 4))
    J[:3, :3] = R @ np.diag(moments.sum() / 2 - moments) @ R.T + m * np.outer(c, c)
    J[:3, 3] = J[3, :3] = m * c
    J[3, 3] = m
    try:
        return np.linalg.cholesky(J[::-1, ::-1])[::-1, ::-1]
    except np.linalg.LinAlgError:
        name = model.body(body).name
        problem = f"body '{name}' of {m:g} kg with moments of {moments.tolist()} kg m2 is a point, a line or a plane"
        raise BadInput(
            problem,
            f"give it some extent in every direction, or free body.{name}.mass, .inertia[i] and .ipos[i]",
        ) from None


def write(fields: dict[str, np.ndarray], factors: dict[int, Float[np.ndarray, "4 4"]]) -> None:
    """Take :data:`ARRAY` out of the fields (N, bodies, ..), and set mass, centre and moments of these bodies by it.

    Worlds in which phi is 0 keep the model's own to the last bit.
    """
    phi = fields.pop(ARRAY)
    for body, U in factors.items():
        moved = phi[:, body].any(-1)
        if not moved.any():
            continue
        half = U @ _steps(phi[moved, body])
        J = half @ half.mT
        mass, centre = J[:, 3, 3], J[:, :3, 3] / J[:, 3, 3, None]
        about = J[:, :3, :3] - mass[:, None, None] * centre[:, :, None] * centre[:, None, :]
        spread, axes = np.linalg.eigh(about)
        axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, no reflection
        fields["body_mass"][moved, body] = mass
        fields["body_ipos"][moved, body] = centre
        fields["body_iquat"][moved, body] = Rotation.from_matrix(axes).as_quat(scalar_first=True)
        fields["body_inertia"][moved, body] = spread.sum(-1, keepdims=True) - spread


def _steps(phi: Float[np.ndarray, "N 10"]) -> Float[np.ndarray, "N 4 4"]:
    """V of each phi."""
    V = np.zeros((len(phi), 4, 4))
    V[:, [0, 1, 2], [0, 1, 2]] = np.exp(phi[:, 1:4])
    for k, (row, column) in enumerate(_SHEARS):
        V[:, row, column] = phi[:, 4 + k]
    V[:, :3, 3], V[:, 3, 3] = phi[:, 7:], 1.0
    return np.exp(phi[:, :1, None]) * V
