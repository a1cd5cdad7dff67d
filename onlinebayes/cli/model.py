"""The ``model`` of a problem file -> a simulator: an MJCF file, or a factory of the user's own."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import mujoco

from onlinebayes.cli.section import Section
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.addresses import resolve
from onlinebayes.simulators.mujoco.model import compile_spec, load_spec


def build_simulator(top: Section, folder: Path, parameters: ParameterSpace) -> Simulator:
    """The simulator whose free parameters are ``parameters``.

    Args:
        top: the problem file; its ``model`` is the path of an MJCF file relative to ``folder``, or
            ``"package.module:factory"``. The factory is called with the :class:`ParameterSpace` (without an argument
            where it takes none) and returns a Simulator.
        folder: where the problem file lies; modules beside it can be named.
        parameters: addresses and bounds.

    Raises:
        BadInput: no such model or factory, one that does not compile or run, or unknown addresses.
    """
    model = top.text("model")
    if ":" in model and not model.endswith(".xml"):
        with top.at("model"):
            return _from_factory(model, folder, parameters)
    with top.at("model"):
        if not (folder / model).is_file():
            raise BadInput(f"no such file: {folder / model}", "give an MJCF file, or 'package.module:factory'")
        # A model that the file names elsewhere was named on purpose; what it may read then lies beside it.
        inside = not Path(model).is_absolute() and ".." not in Path(model).parts
        spec = load_spec(folder / model, root=folder if inside else (folder / model).resolve().parent)
        compiled = compile_spec(spec.copy())
    units = {}
    for name in parameters:
        with top.section("parameters").at(name):
            units[name] = resolve(compiled, name).unit
    named = {name: dataclasses.replace(parameter, unit=units[name]) for name, parameter in parameters.items()}
    simulator = MujocoSimulator(spec, ParameterSpace(named))
    for name, value in zip(parameters, simulator.nominal.tolist(), strict=True):
        if not math.isfinite(value):
            raise top.error("model", f"its own {name} is {value}", "give it a finite value in the MJCF")
    return simulator


def _from_factory(model: str, folder: Path, parameters: ParameterSpace) -> Simulator:
    module, _, factory = model.rpartition(":")
    make = getattr(import_module(module, folder), factory, None)
    if not callable(make):
        raise BadInput(f"module '{module}' has no factory '{factory}'", "name a function that returns a Simulator")
    try:
        simulator = make(parameters) if inspect.signature(make).parameters else make()
    except BadInput:
        raise
    except Exception as error:  # the user's own code: whatever it raises is theirs to mend
        raise BadInput(f"'{model}' raised {type(error).__name__}: {error}", "mend the factory") from error
    if not isinstance(simulator, Simulator):
        raise BadInput(f"'{model}' returned a {type(simulator).__name__}", "return an onlinebayes Simulator")
    if simulator.parameters.names != parameters.names:
        have = ", ".join(simulator.parameters.names) or "none"
        raise BadInput(f"'{model}' has the parameters {have}", "name exactly these under [parameters]")
    return simulator


def import_module(name: str, folder: Path) -> ModuleType:
    """A module by its dotted name, also one that lies in ``folder``; raises :class:`BadInput` when it cannot be."""
    with _on_path(folder):
        try:
            return importlib.import_module(name)
        except Exception as error:
            problem = f"module '{name}' cannot be imported: {type(error).__name__}: {error}"
            raise BadInput(problem, "install it or put it beside the problem file") from error


def signal_units(simulator: Simulator) -> dict[str, str]:
    """Signal -> SI unit, for the joints of a MuJoCo model; empty for others."""
    if not isinstance(simulator, MujocoSimulator):
        return {}
    return {name: _unit(simulator.model, *name.split(".", 1)) for name in simulator.signals}


def known_addresses(simulator: Simulator) -> tuple[str, ...]:
    """``sensor.<name>`` for each sensor of a MuJoCo model."""
    if not isinstance(simulator, MujocoSimulator):
        return ()
    return tuple(f"sensor.{simulator.model.sensor(i).name}" for i in range(simulator.model.nsensor))


def _unit(model: mujoco.MjModel, kind: str, rest: str) -> str:
    """Unit of ``<kind>.<rest>``; empty for a quaternion's parts and what is no joint's."""
    rate = {"qpos": "", "qvel": "/s"}.get(kind)
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


@contextmanager
def _on_path(folder: Path) -> Iterator[None]:
    sys.path.insert(0, str(folder.resolve()))
    try:
        yield
    finally:
        sys.path.remove(str(folder.resolve()))
