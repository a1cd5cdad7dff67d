"""Specs that differ from a model's own by one known thing: an option, its weight, a payload fixed to it."""

from __future__ import annotations

import mujoco

from onlinebayes.runs import BadInput, nearest

JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))  # transmissions to a joint


def gravity_compensated(spec: mujoco.MjSpec, model: mujoco.MjModel) -> mujoco.MjSpec | None:
    """A copy with ``gravcomp = 1`` on every body; None unless the actuators drive each of the joints.

    Args:
        spec, model: the source, and what it compiles to.
    """
    if not all(kind in JOINTS for kind in model.actuator_trntype.tolist()):
        return None
    driven = set(model.actuator_trnid[:, 0].tolist())
    lifted = bool(model.opt.gravity.any()) and not bool((model.body_gravcomp[1:] == 1).all())
    if not lifted or driven != set(range(model.njnt)):
        return None
    spec = spec.copy()
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    return spec


def with_option(spec: mujoco.MjSpec, name: str, value: float | mujoco.mjtIntegrator) -> mujoco.MjSpec:
    """A copy with another value of one of MJCF's options, e.g. ``timestep``."""
    spec = spec.copy()
    setattr(spec.option, name, value)
    return spec


def laden(spec: mujoco.MjSpec, model: mujoco.MjModel, body: str, mass: float) -> mujoco.MjSpec:
    """A copy with a point mass [kg] at a body's centre of mass.

    Args:
        spec, model: the source, and what it compiles to.
        body: which carries it.
        mass: of the payload [kg].

    Raises:
        BadInput: there is no such body.
    """
    known = [model.body(k).name for k in range(1, model.nbody)]
    if body not in known:
        raise BadInput(f"the model has no body '{body}'", nearest(body, known))
    spec = spec.copy()
    spec.compiler.fusestatic = False  # would add it to the body's own mass
    centre = model.body(body).ipos
    # Welded on, so that a free mass of the body itself stays what it is; MuJoCo adds the two up.
    point = spec.body(body).add_body(name=f"payload@{body}", pos=centre, mass=mass, inertia=[1e-9 * mass] * 3)
    point.ipos, point.explicitinertial = [0.0] * 3, True  # without an ipos MuJoCo takes the pos, once more
    return spec
