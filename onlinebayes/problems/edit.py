"""``[model_edit]`` and ``[actuators]`` of a problem file: how the model differs from its file, what commands mean.

| key                          | does                                                                            |
|------------------------------|---------------------------------------------------------------------------------|
| ``weld = ["base"]``          | takes the joints of these bodies away (:mod:`.welding`)                         |
| ``timestep``, ``integrator`` | replace those of ``<option>``                                                   |
| ``input``                    | what a command is; refused where the model's actuator takes something else      |
| ``gravity_compensation``     | the drive carries the weight: ``gravcomp = 1`` on every body its joint moves    |

MuJoCo compensates a body's weight at every joint that moves it, so that ``gravity_compensation`` needs all of these.
"""

from __future__ import annotations

import mujoco

from onlinebayes.problems.section import Section
from onlinebayes.problems.welding import ON_JOINTS, weld
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.mujoco.addresses import names
from onlinebayes.simulators.mujoco.model import compile_spec

INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}
INPUTS = ("force", "voltage", "position", "velocity")
INSTEAD = {
    "force": "a <motor>",
    "voltage": "a <motor> whose gear is force per volt, or a <dcmotor>",
    "position": "a <position> with its kp",
    "velocity": "a <velocity> with its kv",
}


def edited(spec: mujoco.MjSpec, edit: Section, actuators: Section) -> mujoco.MjSpec:
    """The spec as the problem file wants it.

    Args:
        spec: of the model; not changed.
        edit: ``[model_edit]``.
        actuators: ``[actuators]``.

    Raises:
        BadInput: a body or actuator that is not there, a value that makes no sense, an input that the actuator does
            not take.
    """
    spec = spec.copy()
    with edit.at("weld"):
        weld(spec, edit.texts("weld", ()))
    if (timestep := edit.number("timestep")) is not None:
        if timestep <= 0:
            raise edit.error("timestep", f"{timestep:g} s is no step", "give a positive time in seconds")
        spec.option.timestep = timestep
    if "integrator" in edit:
        if (name := edit.text("integrator")) not in INTEGRATORS:
            raise edit.error("integrator", f"'{name}' is unknown", f"use {', '.join(INTEGRATORS)}")
        spec.option.integrator = INTEGRATORS[name]
    model = compile_spec(spec)
    compensating = []
    for name in actuators.values:
        table = actuators.section(name, ("input", "gravity_compensation"))
        with actuators.at(name):
            i = _known(names(model, "actuator"), name, "actuator")
        if "input" in table:
            _check_input(table, model, i)
        if table.flag("gravity_compensation"):
            compensating.append(i)
    if compensating:
        _compensate(spec, model, compensating, actuators)
    return spec


def edits(section: Section) -> Section:
    """``[model_edit]``, its keys checked."""
    return section.section("model_edit", ("weld", "timestep", "integrator"))


def _check_input(table: Section, model: mujoco.MjModel, i: int) -> None:
    wanted = table.text("input")
    if wanted not in INPUTS:
        raise table.error("input", f"'{wanted}' is unknown", f"use {', '.join(INPUTS)}")
    taken = _takes(model, i)
    if wanted not in taken:
        problem = f"the model's actuator takes a {' or '.join(taken)}, not a {wanted}"
        raise table.error("input", problem, f"make it {INSTEAD[wanted]} in the model")


def _takes(model: mujoco.MjModel, i: int) -> tuple[str, ...]:
    """Return the possible meanings of an actuator's command, by the bias of its force, f = gain u + bias(q, v)."""
    bias, integrates = model.actuator_biastype[i], model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_INTEGRATOR
    if bias == mujoco.mjtBias.mjBIAS_NONE:
        return ("force", "voltage")
    if bias == mujoco.mjtBias.mjBIAS_DCMOTOR:
        return ("voltage",)
    if bias != mujoco.mjtBias.mjBIAS_AFFINE:
        return ("command of its own kind",)
    _, position, velocity = model.actuator_biasprm[i, :3]
    if position != 0:
        return ("velocity",) if integrates else ("position",)
    servo = velocity != 0 and model.actuator_gainprm[i, 0] == -velocity
    return ("velocity",) if servo else ("force", "voltage")


def _compensate(spec: mujoco.MjSpec, model: mujoco.MjModel, chosen: list[int], section: Section) -> None:
    """gravcomp = 1 on every body that the joints of these actuators move."""
    joints: set[int] = set()
    for i in chosen:
        if mujoco.mjtTrn(model.actuator_trntype[i]) not in ON_JOINTS:
            raise section.error(model.actuator(i).name, "it does not act on a joint", "leave gravity_compensation out")
        joints.add(int(model.actuator_trnid[i, 0]))
    moved = [b for b in range(1, model.nbody) if joints & set(_moving(model, b))]
    for b in moved:
        if missing := [j for j in _moving(model, b) if j not in joints]:
            raise section.error(
                model.actuator(chosen[0]).name,
                f"joint '{model.joint(missing[0]).name}' moves body '{model.body(b).name}' too and is not compensated",
                "set gravity_compensation at every joint of the chain, or body.<name>.gravcomp in the model",
            )
    bodies = {body.id: body for body in spec.bodies}
    for b in moved:
        bodies[b].gravcomp = 1.0


def _moving(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints between a body and the world."""
    found: list[int] = []
    while body > 0:
        first = int(model.body_jntadr[body])
        found += range(first, first + int(model.body_jntnum[body]))
        body = int(model.body_parentid[body])
    return found


def _known(known: list[str] | tuple[str, ...], name: str, kind: str) -> int:
    if name in known:
        return known.index(name)
    raise BadInput(f"the model has no {kind} '{name}'", nearest(name, known))
