"""refined.xml, the final model for plain MuJoCo, and refined_model.py beside it, which has what MJCF has no term for.

The file has every fitted value and every effect that MuJoCo has a term for, integrated as MuJoCo needs it for that (see
:mod:`onlinebayes.simulators.mujoco.in_file`); its comment says what it lacks and how its integration differs from the
user's. The module steps file and missing laws together, in the final model's own integration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco

from onlinebayes.criticism import Criticism
from onlinebayes.identification import FittedModel, address_of, physical, unwrap
from onlinebayes.report import words
from onlinebayes.runs import BadInput, write_atomic
from onlinebayes.simulators.abilities import InFile
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.export import in_folder
from onlinebayes.simulators.standalone import Setup, module_text

XML, MODULE = "refined.xml", "refined_model.py"

ASSETS = "refined_assets"
"""Folder beside refined.xml for the meshes and textures that the model had in memory."""

FAILURES = (BadInput, ValueError, mujoco.FatalError)
"""Errors that MuJoCo raises where it cannot make a file of a model."""


@dataclass(frozen=True, eq=False)
class ModelFiles:
    """The model in both files.

    Args:
        simulator: of the whole model.
        held: the part of it that refined.xml holds.
        spec: of refined.xml.
        setup: what stands beside it.
        without: keys of the effects that stand in neither -> why, as a clause.
    """

    simulator: MujocoSimulator
    held: InFile
    spec: mujoco.MjSpec
    setup: Setup
    without: Mapping[str, str]

    @property
    def needs_module(self) -> bool:
        """True if refined.xml alone is not the model."""
        return bool(self.held.without or self.held.integrated)


def model_of(result: Criticism) -> FittedModel:
    """The model that the files hold."""
    return result.final if result.corrected is None else result.corrected


def model_files(result: Criticism) -> ModelFiles | None:
    """Both files' contents; None for a model that is no MJCF.

    Raises:
        BadInput, ValueError, mujoco.FatalError: MuJoCo refuses the fitted values.
    """
    model = model_of(result)
    simulator = unwrap(model.simulator)
    if not isinstance(simulator, MujocoSimulator):
        return None
    theta = physical(model.simulator, model.theta)
    held = simulator.in_file(theta)
    assert isinstance(held.simulator, MujocoSimulator)
    spec = held.simulator.export(held.theta)
    setup, without = simulator.beside_file(theta, spec, held.without)
    return ModelFiles(simulator, held, spec, setup, without)


def left_out(result: Criticism) -> Mapping[str, str]:
    """Keys of the effects that refined.xml cannot hold, and why."""
    model = model_of(result)
    found = unwrap(model.simulator).in_file(physical(model.simulator, model.theta))
    return {} if found is None else found.without


def lost(result: Criticism) -> Mapping[str, str]:
    """Keys of the effects that neither refined.xml nor refined_model.py can hold, and why."""
    files = model_files(result)
    return {} if files is None else files.without


def write_model(result: Criticism, folder: Path) -> list[str]:
    """Write both files and the assets; nothing for a model that is no MJCF, or that MuJoCo refuses.

    Returns:
        Names of the files written; refined_model.py only where refined.xml alone is not the model.
    """
    try:
        files = model_files(result)
        if files is None:
            return []
        text, assets = _xml(result, files, folder)
    except FAILURES:
        for name in (XML, MODULE):
            (folder / name).unlink(missing_ok=True)
        return []
    for name, bytes_ in assets.items():
        write_atomic(folder / name, bytes_)
    write_atomic(folder / XML, text)
    if not files.needs_module:
        return [XML]
    head = f"The refined model: {XML} with {words.beside(files.held.without, files.without)}."
    write_atomic(folder / MODULE, module_text(files.setup, XML, head))
    return [XML, MODULE]


def approximate(result: Criticism) -> list[str]:
    """Note the bodies whose fitted moments of inertia no body has; the file holds the nearest possible ones."""
    model = model_of(result)
    simulator = unwrap(model.simulator)
    if not isinstance(simulator, MujocoSimulator):
        return []
    bodies = simulator.bodies_with_adjusted_inertia(physical(model.simulator, model.theta))
    rule = "the nearest moments of inertia that a body can have (A + B >= C)"
    return [f"{rule} in place of the fitted ones of {', '.join(bodies)}"] if bodies else []


def _xml(result: Criticism, files: ModelFiles, target: Path) -> tuple[str, dict[str, bytes]]:
    """The text, and the files that it needs that lie nowhere yet, by their paths from the folder.

    Args:
        result: what ``refine`` returned; where runs have values of their own, their mean is written.
        files: what is written.
        target: the folder; meshes and textures stay where they are and are found from there.
    """
    spec = files.spec
    text, beside = in_folder(spec, target, ASSETS)
    note = "; ".join(_notes(result, files))
    # "--" would end an XML comment.
    return f"<!-- refined by onlinebayes, {note.replace('--', '- -')} -->\n{text}", beside


def _notes(result: Criticism, files: ModelFiles) -> list[str]:
    """What the comment of refined.xml says."""
    notes = [words.lacking(files.held.without)] if files.held.without else []
    if result.wiring is not None:
        fitted = "the table with its fault" if result.corrected is None else "the mended table"
        notes = [f"fitted to {fitted} ({result.wiring.fault})", *notes]
    notes = notes or ["with all accepted effects"]
    if files.needs_module:
        notes.append(f"{MODULE} beside this file adds {words.beside(files.held.without, files.without)}")
    differing = sorted({address_of(name) for name in result.parameters if address_of(name) != name})
    notes += [f"{', '.join(differing)} at the mean of the runs"] if differing else []
    notes += _integration(result, files)
    return [*notes, *approximate(result)]


def _integration(result: Criticism, files: ModelFiles) -> list[str]:
    """How the file is integrated otherwise than the user's model, and why."""
    given = None if result.given is None else unwrap(result.given)
    said = list(files.held.integrated)
    if not isinstance(given, MujocoSimulator):
        return said
    used, own = (_option(simulator) for simulator in (files.simulator, given))
    if used == own:
        return said
    why = "too coarse for these sensors, or not in step with the log's rows"
    return [f"fitted with {used}, for the model's own, {own}, is {why}", *said]


def _option(simulator: MujocoSimulator) -> str:
    kind = mujoco.mjtIntegrator(simulator.model.opt.integrator).name.removeprefix("mjINT_")
    return f"timestep {simulator.timestep:.6g} s and integrator {kind if kind == 'RK4' else kind.capitalize()}"
