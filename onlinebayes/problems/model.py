"""The ``model`` of a problem file -> a simulator: an MJCF file, or a factory of the user's own."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection
from pathlib import Path

import mujoco

from onlinebayes.parameters import ParameterSpace
from onlinebayes.problems.edit import edited, edits
from onlinebayes.problems.factory import from_factory
from onlinebayes.problems.parameters import NEVER_NEGATIVE, Declared, field_of
from onlinebayes.problems.section import Section
from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import Extensible
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.addresses import resolve, written_out
from onlinebayes.simulators.mujoco.model import compile_spec, load_spec

RATES = {"qpos": "", "qvel": "/s"}


def build_simulator(
    top: Section, folder: Path, parameters: Declared, columns: Collection[str] = ()
) -> tuple[Identifiable, Declared]:
    """The simulator whose free parameters are those of the file, and the file's parameters with globs written out.

    Args:
        top: the problem file; its ``model`` is the path of an MJCF file relative to ``folder``, or a factory (see
            :mod:`.factory`).
        folder: where the problem file lies.
        parameters: addresses and bounds.
        columns: names that the tables and ``[signals]`` use; the sensors among them become signals.

    Raises:
        BadInput: no such model or factory, one that does not compile or run, or unknown addresses.
    """
    model = top.text("model")
    factory = ":" in model and not model.endswith(".xml")
    with top.at("model"):
        if not factory and not (folder / model).is_file():
            raise BadInput(f"no such file: {folder / model}", "give an MJCF file, or 'package.module:factory'")
        made = (
            from_factory(model, parameters.space) if factory else load_spec(folder / model, root=_root(folder, model))
        )
        if isinstance(made, mujoco.MjSpec):
            compile_spec(made)  # not a copy, which leaves out what names nothing: a motor at a joint that is not there
    edit, actuators = edits(top), top.section("actuators")
    if isinstance(made, Identifiable):
        _check_made(top, made, parameters)
        if isinstance(made, MujocoSimulator):
            with top.at("measurements"):
                made = made.with_columns(columns)
        return made, parameters
    spec = edited(made, edit, actuators)
    compiled = compile_spec(spec.copy())
    parameters = parameters.expanded(lambda name: written_out(compiled, name), top.section("parameters"))
    space = _with_units(top, compiled, parameters)
    with top.at("parameters"):
        simulator = MujocoSimulator(spec, space)
    with top.at("measurements"):
        simulator = simulator.with_columns(columns)  # after the globs: they mean elements of the user's model
    for name, value in zip(simulator.parameters, simulator.nominal.tolist(), strict=True):
        if not math.isfinite(value):
            raise top.error("model", f"its own {name} is {value}", "give it a finite value in the MJCF")
    return simulator, parameters


def _root(folder: Path, model: str) -> Path:
    """Return the folder that a model may read: the problem's, or its own where it lies elsewhere on purpose."""
    inside = not Path(model).is_absolute() and ".." not in Path(model).parts
    return folder if inside else (folder / model).resolve().parent


def _with_units(top: Section, model: mujoco.MjModel, parameters: Declared) -> ParameterSpace:
    """The space with each address resolved, so that an error names the key that it stands under."""
    free, runs, units = top.section("parameters"), top.section("runs"), dict[str, str]()
    for name, parameter in parameters.model.items():
        with free.at(name):
            units[name] = resolve(model, name).unit
            _check_sign(name, parameter.low, units[name], "give a lower bound of 0 or more")
    for pattern, values in parameters.known.items():
        for name, value in values.items():
            if "@" in name:
                continue
            with runs.section(pattern).at(name):
                units[name] = resolve(model, name).unit
                _check_sign(name, value, units[name], "give 0 or more")
    space = parameters.space
    return ParameterSpace({name: dataclasses.replace(one, unit=units[name]) for name, one in space.items()})


def _check_sign(address: str, value: float, unit: str, cure: str) -> None:
    if value < 0 and (field := field_of(address)) in NEVER_NEGATIVE:
        raise BadInput(f"address '{address}': a {NEVER_NEGATIVE[field]} of {value:g} {unit} cannot be", cure)


def _check_made(top: Section, simulator: Simulator, parameters: Declared) -> None:
    """Check the parameters of a factory's own simulator, and that nothing is asked that cannot be done to it."""
    for key in ("model_edit", "actuators"):
        if top.section(key).values:
            raise top.error(key, "the factory returns a simulator, which cannot be edited", "return an MjSpec instead")
    if parameters.globs:
        cure = "name each parameter, or return an MjSpec"
        raise top.section("parameters").error(parameters.globs[0], "a glob needs the model's names", cure)
    if simulator.parameters.names != parameters.space.names:
        have = ", ".join(simulator.parameters.names) or "none"
        there = sorted(simulator.parameters.names) == sorted(parameters.space.names)
        cure = f"name {'them in this order' if there else 'exactly these'} under [parameters]"
        raise top.error("model", f"'{top.text('model')}' has the parameters {have}", cure)


def beside_bounds(simulator: Simulator, parameters: Declared) -> list[str]:
    """A line for each fitted parameter whose value in the model lies outside the bounds that it was given."""
    return [
        f"{name}: the model's own {value:g} lies outside the bounds {bounds.low:g} to {bounds.high:g}"
        for (name, bounds), value in zip(simulator.parameters.items(), simulator.nominal.tolist(), strict=True)
        if name in parameters.model and not bounds.low <= value <= bounds.high
    ]


def signal_units(simulator: Extensible) -> dict[str, str]:
    """Signal -> SI unit, for the joints of a model."""
    if not isinstance(simulator, MujocoSimulator):
        lengths = {joint: "m" if kind == "slide" else "rad" for joint, kind in simulator.joint_kinds.items()}
        signals = {f"{kind}.{joint}": unit + rate for joint, unit in lengths.items() for kind, rate in RATES.items()}
        return {name: unit for name, unit in signals.items() if name in simulator.signals}
    return {name: _unit(simulator.model, *name.split(".", 1)) for name in simulator.signals}


def known_addresses(simulator: Simulator) -> tuple[str, ...]:
    """``sensor.<name>`` for each sensor of a MuJoCo model."""
    if not isinstance(simulator, MujocoSimulator):
        return ()
    return tuple(f"sensor.{simulator.model.sensor(i).name}" for i in range(simulator.model.nsensor))


def _unit(model: mujoco.MjModel, kind: str, rest: str) -> str:
    """Unit of ``<kind>.<rest>``; empty for a quaternion's parts and what is no joint's."""
    if kind == "qfrc":
        return "N" if model.jnt_type[_joint(model, rest)] == mujoco.mjtJoint.mjJNT_SLIDE else "N m"
    rate = RATES.get(kind)
    if rate is None:
        return ""
    if (number := _joint(model, rest)) >= 0:
        return ("m" if model.jnt_type[number] == mujoco.mjtJoint.mjJNT_SLIDE else "rad") + rate
    joint, _, part = rest.rpartition(".")
    number = _joint(model, joint)
    if number >= 0 and model.jnt_type[number] == mujoco.mjtJoint.mjJNT_FREE and part in ("0", "1", "2"):
        return "m" + rate
    return "rad/s" if kind == "qvel" else ""


def _joint(model: mujoco.MjModel, name: str) -> int:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
