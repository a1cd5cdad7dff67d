r"""Dry friction that sticks: a box-constrained solve for the velocities at the end of a step.

    v+ = v_free + M^{-1} p,    |p_i| <= h F_i,    v+_i = 0 where |p_i| < h F_i,    p_i = -h F_i sign(v+_i) elsewhere

p is the impulse of friction over the step of h seconds. This is time-stepping with Coulomb's law made implicit in the
velocity (Moreau 1988; Stewart and Trinkle 1996), solved by projected Gauss-Seidel; one joint is solved exactly in one
sweep. A joint whose load stays below F stays at rest exactly, without drift.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

SWEEPS = 100  # at most, where several joints rub; the error falls by the square of their coupling in each


def stick(
    free: Float[Tensor, "J N"],
    inverse_mass: Float[Tensor, "J R N"],
    bound: Float[Tensor, "R N"],
    joints: Sequence[int],
) -> Float[Tensor, "J N"]:
    """Velocities after a step with dry friction.

    Args:
        free: velocities after the step without friction, v_free (J, N) [m/s, rad/s].
        inverse_mass: columns of M^{-1} of the joints that rub (J, R, N) [1/kg, 1/(kg m^2)].
        bound: largest impulse of friction at each of them, h F >= 0 (R, N) [N s, N m s].
        joints: index of each of the R joints that rub.
    """
    velocity = free
    impulse = torch.zeros_like(bound)
    for _ in range(1 if len(joints) == 1 else SWEEPS):
        before = impulse
        for i, joint in enumerate(joints):
            wanted = impulse[i] - velocity[joint] / inverse_mass[joint, i]
            # minimum and maximum rather than clamp: bounds are tensors, and a bound of zero leaves zero.
            allowed = torch.maximum(torch.minimum(wanted, bound[i]), -bound[i])
            velocity = velocity + inverse_mass[:, i] * (allowed - impulse[i])
            impulse = torch.cat((impulse[:i], allowed[None], impulse[i + 1 :]))
        if bool(((impulse - before).abs() <= 8 * torch.finfo(bound.dtype).eps * bound).all()):
            break
    stuck = impulse.abs() < bound
    rows = list(velocity.unbind(0))
    for i, joint in enumerate(joints):
        rows[joint] = torch.where(stuck[i], torch.zeros_like(rows[joint]), rows[joint])
    return torch.stack(rows)
