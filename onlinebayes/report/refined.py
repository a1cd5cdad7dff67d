"""The refined model: refined.toml (the problem with its accepted effects) and refined.xml (for plain MuJoCo).

Where the data leave several models open, refined-2.toml and so on are the problem with each of the others.

refined.toml is the problem file with ``[effects] add`` extended, everything else kept: bounds stay priors, the fitted
values stand beside them as comments, relative paths are rewritten to hold from the new folder. refined.xml is the
model with every fitted value and every effect that MuJoCo has a term for written in; a comment names those it lacks.
Where the data have a fault, refined.toml has the lines that put it right, and the values of both are fitted to the
mended table: those of the fit to the faulty one mean nothing.
"""

from __future__ import annotations

import dataclasses
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco

from onlinebayes.criticism import MOST_HYPOTHESES, Criticism, WeightedModel, WidenedBounds
from onlinebayes.identification import FittedModel, address_of, physical, quantities, unwrap
from onlinebayes.report import phrases, words
from onlinebayes.report.correction import mended
from onlinebayes.runs import Attempts, BadInput, to_toml, write_atomic
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.export import in_folder, to_xml

RIVALS = tuple(f"refined-{k + 2}.toml" for k in range(MOST_HYPOTHESES))
"""Problem files of the other models that a result leaves open."""

FILES = ("refined.toml", "refined.xml", *RIVALS)
"""Files that ``refine`` writes besides the report, where there is a problem file, and a model that MuJoCo takes."""

ASSETS = "refined_assets"
"""Folder beside refined.xml for the meshes and textures that the model had in memory."""

FAILURES = (BadInput, ValueError, mujoco.FatalError)
"""Errors that MuJoCo raises where it cannot make a file of a model."""


def left_out(result: Criticism) -> Mapping[str, str]:
    """Keys of the effects that refined.xml cannot hold -> why, and what would let it."""
    model = _model(result)
    simulator, theta = unwrap(model.simulator), physical(model.simulator, model.theta)
    return simulator.not_exportable(theta) if isinstance(simulator, MujocoSimulator) else {}


def noted(result: Criticism) -> Criticism:
    """The result of ``refine`` with a note where refined.xml is not the final model, or cannot be written at all."""
    simulator = unwrap(result.final.simulator)
    if result.command != "refine" or not isinstance(simulator, MujocoSimulator):
        return result
    notes = [f"refined.xml holds {held}." for held in _approximate(result, simulator)]
    try:
        to_xml(_spec(result, simulator))
    except FAILURES as error:
        notes = [f"refined.xml was not written, for MuJoCo refuses the fitted values: {error}"]
    return dataclasses.replace(result, notes=tuple(dict.fromkeys([*result.notes, *notes])))


def write_refined(
    result: Criticism, out_dir: str | Path, problem: str | Path | None = None, attempts: Attempts | None = None
) -> tuple[str, ...]:
    """Write refined.toml where there is a problem file, and refined.xml for a MuJoCo model, each atomically.

    An XML that MuJoCo refuses is left out, an older one with it; :func:`noted` says why.

    Args:
        result: what ``refine`` returned.
        out_dir: folder of the report.
        problem: the problem file that was refined.
        attempts: takes what fails; the first failure is raised in the end where there is none.

    Returns:
        Names of the files written.

    Raises:
        BadInput: the folder cannot be written.
    """
    folder, noting, written = Path(out_dir), attempts or Attempts(), list[str]()
    rivals = result.hypotheses[1:] if result.wiring is None else ()
    models = (None, *rivals) if problem is not None else ()
    for name, rival in zip(("refined.toml", *RIVALS), models, strict=False):
        with noting.attempt(name):
            assert problem is not None
            content = tomllib.loads(Path(problem).read_text(encoding="utf-8-sig"))
            write_atomic(folder / name, refined_toml(content, Path(problem).parent, folder, result, rival))
            written.append(name)
    with noting.attempt("refined.xml"):
        written += _write_xml(result, folder)
    if attempts is None and noting.errors:
        raise noting.errors[0]
    return tuple(written)


def _write_xml(result: Criticism, folder: Path) -> list[str]:
    """Write refined.xml and its assets; nothing for a model that is no MJCF, or that MuJoCo refuses."""
    simulator = unwrap(_model(result).simulator)
    if not isinstance(simulator, MujocoSimulator):
        return []
    try:
        text, assets = refined_xml(result, simulator, folder)
    except FAILURES:
        (folder / "refined.xml").unlink(missing_ok=True)
        return []
    for name, bytes_ in assets.items():
        write_atomic(folder / name, bytes_)
    write_atomic(folder / "refined.xml", text)
    return ["refined.xml"]


def refined_toml(
    content: Mapping[str, Any], source: Path, target: Path, result: Criticism, rival: WeightedModel | None = None
) -> str:
    """The text of refined.toml.

    Args:
        content: the parsed problem file.
        source: the folder its relative paths start from.
        target: the folder that the new file will lie in.
        result: what ``refine`` returned.
        rival: one of its other models, in the place of the final one.
    """
    model = result.final if rival is None else rival.model
    content = mended(content, result.read_as)
    content = content if result.wiring is None else mended(content, result.wiring.lines)
    content["model"] = _moved(content["model"], source, target)
    tables = content["measurements"]
    content["measurements"] = [_moved(t, source, target) for t in ([tables] if isinstance(tables, str) else tables)]
    effects = dict(content.get("effects", {}))
    effects["add"] = list(model.effects)
    content["effects"] = effects
    content["parameters"] = {
        **content["parameters"],
        **_bounds(content["parameters"], model),
        **({} if rival is None else _freed(result, model)),
        **_widened(content["parameters"], result, rival),
        **_own(content["parameters"], result),
    }
    fitted = _fitted(_model(result) if rival is None else model)
    for address, fleet in result.fleet.items() if rival is None else ():
        fitted[address].append(f"the next unit's {phrases.interval(fleet.next)}")
    comments: dict[tuple[str, ...], str] = {
        ("parameters", name): f"fitted: {'; '.join(values)}" for name, values in fitted.items()
    }
    head = "\n".join(filter(None, (words.headline(result), words.improvement(result), words.put_right(result))))
    if rival is not None:
        share = quantities.percent(rival.weight)
        head = f"Another model that the data leave open, believed to {share}: with {phrases.listing(rival.accepted)}"
    return to_toml(content, head=head, comments=comments)


def refined_xml(result: Criticism, simulator: MujocoSimulator, target: Path) -> tuple[str, dict[str, bytes]]:
    """MJCF of the final model with its fitted values; a comment names the effects that it cannot hold.

    Args:
        result: what ``refine`` returned.
        simulator: the physics of the model that is written; where runs have values of their own, their mean is written.
        target: the folder that the file will lie in; meshes and textures stay where they are and are found from there.

    Returns:
        The text, and the files it needs that lie nowhere yet, by their paths from the folder.
    """
    spec = _spec(result, simulator)
    text, beside = in_folder(spec, target, ASSETS)
    missing = left_out(result)
    differing = sorted({address_of(name) for name in result.parameters if address_of(name) != name})
    note = words.lacking(missing) or "with all accepted effects"
    note += f"; {', '.join(differing)} at the mean of the runs" if differing else ""
    if result.wiring is not None:
        fitted = "the table with its fault" if result.corrected is None else "the mended table"
        note = f"fitted to {fitted} ({result.wiring.fault}){f', {note}' if missing else ''}"
    note += "".join(f"; {held}" for held in _approximate(result, simulator))
    # "--" would end an XML comment.
    return f"<!-- refined by onlinebayes, {note.replace('--', '- -')} -->\n{text}", beside


def _model(result: Criticism) -> FittedModel:
    """The model that the files hold."""
    return result.final if result.corrected is None else result.corrected


def _spec(result: Criticism, simulator: MujocoSimulator) -> mujoco.MjSpec:
    return simulator.export(physical(_model(result).simulator, _model(result).theta))


def _approximate(result: Criticism, simulator: MujocoSimulator) -> list[str]:
    """Note the bodies whose fitted moments of inertia no body has; the file holds the nearest possible ones."""
    bodies = simulator.bodies_with_adjusted_inertia(physical(_model(result).simulator, _model(result).theta))
    rule = "the nearest moments of inertia that a body can have (A + B >= C)"
    return [f"{rule} in place of the fitted ones of {', '.join(bodies)}"] if bodies else []


def _bounds(parameters: Mapping[str, Any], model: FittedModel) -> dict[str, Any]:
    """Bounds of the effects' parameters, as the problem file writes them; what else it says of one is kept."""
    space = unwrap(model.simulator).parameters
    found: dict[str, Any] = {}
    for effect in model.simulator.effects:
        for name in effect.parameters:
            address = f"{effect.key}.{name}"
            parameter = space[address]
            given = parameters.get(address)
            more = {**given} if isinstance(given, Mapping) else {}
            if parameter.scale != "linear":
                more["scale"] = parameter.scale
            low, high = parameter.low, parameter.high
            found[address] = {**more, "low": low, "high": high} if more else [low, high]
    return found


def _freed(result: Criticism, model: FittedModel) -> dict[str, Any]:
    """Bounds of the numbers that the model has free and the base model does not."""
    known = unwrap(result.base.simulator).parameters
    space = unwrap(model.simulator).parameters
    return {name: [space[name].low, space[name].high] for name in space if name not in known and "@" not in name}


def _widened(parameters: Mapping[str, Any], result: Criticism, rival: WeightedModel | None) -> dict[str, Any]:
    """The wider bounds where the old ones exclude the truth, as the problem file wrote them."""
    found: dict[str, Any] = {}
    for name, widened in result.widened.items():
        if rival is not None and _does_without(rival.model, name, widened):
            continue
        low, high = widened.after
        address = address_of(name)
        given = parameters.get(address)
        found[address] = {**given, "low": low, "high": high} if isinstance(given, Mapping) else [low, high]
    return found


def _does_without(model: FittedModel, name: str, widened: WidenedBounds) -> bool:
    """Check whether a parameter is not free in a model, or has the old bounds there."""
    held = unwrap(model.simulator).parameters.get(address_of(name))
    return held is None or (held.low, held.high) == widened.before


def _own(parameters: Mapping[str, Any], result: Criticism) -> dict[str, Any]:
    """Return the parameters that differ between runs, each with a value in every run."""
    space, found = unwrap(result.final.simulator).parameters, {}
    for change in result.changes:
        given, bounds = parameters.get(change.parameter), space[change.parameter]
        bounded = given if isinstance(given, Mapping) else {"low": bounds.low, "high": bounds.high}
        found[change.parameter] = {**bounded, "scope": "per_run"}
    return found


def _fitted(model: FittedModel) -> dict[str, list[str]]:
    """Address -> its fitted value, or that of every run."""
    found: dict[str, list[str]] = {}
    for name, value in model.parameters.items():
        address = address_of(name)
        of_run = name.removeprefix(address).removeprefix("[").removesuffix("]")  # a glob has brackets of its own
        found.setdefault(address, []).append(f"{of_run} {phrases.estimate(value)}".strip())
    return found


def _moved(path: str, source: Path, target: Path) -> str:
    """A relative path that starts from ``source``, rewritten to start from ``target``; factories stay as they are."""
    if not (source / path).exists() or Path(path).is_absolute():
        return path
    return Path(os.path.relpath((source / path).resolve(), target.resolve())).as_posix()
