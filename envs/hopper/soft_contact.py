"""MuJoCo's soft contact as a spring and a damper, for engines that ask for these.

With every other force a contact would accelerate by a_0; MuJoCo lets it accelerate, at depth r, by

    a = (1 - d) a_0 + d (- k r - b r'),        k = 1 / (d tc dr)^2,   b = 2 / (d tc)

with ``solref = (tc, dr)`` and an impedance d that does not depend on the depth. A mass m on a spring and damper returns
as fast from an impact with

    stiffness   K = d k m  [N/m],        relaxation time   b / k  [s],        damping   K b / k  [N s/m]

The one thing that differs is a_0: a weight sinks 1 / (1 - d) times as deep. m is MuJoCo's own approximation,
1 / ``body_invweight0``. A contact begins where the distance is the sum of both geoms' margins.
Source: MuJoCo documentation, Computation, "Constraint model".
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class SoftContact:
    """A linear spring and damper in one contact.

    Attributes:
        stiffness: K [N/m].
        relaxation: of the damper, b / k [s].
        margin: distance at which the geom begins to touch [m].
    """

    stiffness: float
    relaxation: float
    margin: float = 0.0


def soft_contact(model: mujoco.MjModel, geom: str) -> SoftContact:
    """Of a geom on the fixed floor, whose softness the geom itself states.

    Raises:
        BadInput: the impedance depends on the depth, or ``solref`` gives stiffness and damping directly.
    """
    part = model.geom(geom)
    (constant, ratio), (least, most) = part.solref, part.solimp[:2]
    if least != most or constant <= 0:
        raise BadInput(
            f"geom '{geom}' has solref {part.solref.tolist()}, solimp {part.solimp.tolist()}",
            "needs solref = (time constant, damping ratio) and an impedance that is the same at all depths",
        )
    stiffness, damping = 1 / (most * constant * ratio) ** 2, 2 / (most * constant)
    (body,) = part.bodyid
    inverse_mass = float(model.body_invweight0[body, 0])
    return SoftContact(
        stiffness=float(most * stiffness / inverse_mass),
        relaxation=float(damping / stiffness),
        margin=float(part.margin[0]),
    )
