"""The ``[effects]`` of a problem file: which to try, which are already part of the model."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Literal

from onlinebayes.criticism import propose
from onlinebayes.identification import Windows, charted, make_windows
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.problems.factory import import_module
from onlinebayes.problems.section import Section
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.abilities import Extensible
from onlinebayes.simulators.effects import EFFECTS, Effect, Scales
from onlinebayes.simulators.effects.base import split_axis
from onlinebayes.simulators.identifiable import Identifiable


def import_modules(section: Section) -> None:
    """Import the user's modules, which register effects of their own in ``EFFECTS``."""
    for name in section.texts("modules", ()):
        with section.at("modules"):
            import_module(name)


def check_candidates(section: Section, simulator: Extensible) -> Literal["all"] | tuple[str, ...]:
    """``"all"``, or effect names and ``name@target`` keys that all exist.

    Raises:
        BadInput: an unknown effect or target; names the nearest.
    """
    given = section.values.get("candidates", "all")
    if given == "all":
        return "all"
    if isinstance(given, str):
        raise section.error("candidates", f"'{given}' is no list", f'write "all" or ["{given}"]')
    candidates = section.texts("candidates")
    if not candidates:
        raise section.error("candidates", "nothing to try", 'write "all", or name effects')
    if "all" in candidates:
        raise section.error("candidates", "'all' is no effect", 'write candidates = "all", without brackets')
    for candidate in candidates:
        with section.at("candidates"):
            check_effect(candidate, simulator)
    return candidates


def check_effect(key: str, simulator: Extensible) -> None:
    """Raise :class:`BadInput` unless ``name`` or ``name@target`` exists for this simulator."""
    name, at, target = key.partition("@")
    vocabulary = {**EFFECTS, **simulator.own_effects}
    if name not in vocabulary:
        raise BadInput(f"effect '{name}' is unknown", nearest(name, list(vocabulary)))
    if at:
        kind = vocabulary[name].target_kind
        known = tuple(t for k in (kind, *vocabulary[name].wider) for t in simulator.targets(k))
        if split_axis(target, vocabulary[name].axes)[0] not in known:
            raise BadInput(f"the model has no {kind} '{target}' for {name}", nearest(target, known))


def check_constant(address: str, value: float, simulator: Extensible) -> None:
    """Raise :class:`BadInput` unless ``name@target.parameter`` exists and may have this value, added or not."""
    key, _, parameter = address.rpartition(".")
    if not key:
        raise BadInput(f"'{address}' names no parameter", "write effect@target.parameter")
    check_effect(key, simulator)
    name, _, target = key.partition("@")
    effect = {**EFFECTS, **simulator.own_effects}[name].scaled(target, Scales(1.0, 1.0, 1.0, 1.0))
    if parameter not in effect.parameters:
        raise BadInput(f"{key} has no parameter '{parameter}'", nearest(parameter, effect.parameters.names))
    own = effect.parameters[parameter]
    known = dataclasses.replace(own, low=value, high=value + max(1.0, abs(value)), scale="linear")
    try:
        dataclasses.replace(effect, **{parameter: known})  # type: ignore[type-var]
    except BadInput as error:
        raise BadInput(f"{value:g} cannot be known: {error}") from None


def add_effects(
    section: Section,
    by_hand: Sequence[str],
    simulator: Identifiable,
    measurement: Measurement,
    bounds: Mapping[str, Parameter],
    horizon: float,
) -> tuple[Identifiable, tuple[str, ...]]:
    """The simulator with the effects of ``add`` and of the command line.

    Args:
        section: ``[effects]``.
        by_hand: ``--add``.
        simulator: the base model.
        measurement: the fit runs; the sizes in play there bound an effect's parameters where nothing else does.
        bounds: address ``name@target.parameter`` -> bounds, from ``[parameters]``.
        horizon: seconds of a window [s].

    Raises:
        BadInput: an unknown effect, target or parameter, or an effect that is added twice.
    """
    added: dict[str, Effect] = {}

    @cache
    def moving() -> tuple[Identifiable, Windows]:
        """Chart the motion of the machine; this is done only where an effect is added at all."""
        model, turned = charted(simulator, measurement)
        return model, make_windows(model, turned, horizon, 0.0, None)

    for key in section.texts("add", ()):
        added[key] = _built(key, simulator, moving, bounds, f"{section.file}: {section.full('add')}")
    for key in by_hand:
        if key in added:
            raise BadInput(f"'{key}' is part of the model already", "leave it out", where="--add")
        added[key] = _built(key, simulator, moving, bounds, "--add")
    known = [f"{key}.{name}" for key, effect in added.items() for name in effect.parameters]
    for address in bounds:
        if address not in known:
            cure = nearest(address, known) if known else "add the effect under [effects], add"
            raise BadInput(f"no added effect has the parameter '{address}'", cure, where=f"{section.file}: parameters")
    for effect in added.values():
        simulator = simulator.with_effect(effect)
    return simulator, tuple(added)


def _built(
    key: str,
    simulator: Identifiable,
    moving: Callable[[], tuple[Identifiable, Windows]],
    bounds: Mapping[str, Parameter],
    where: str,
) -> Effect:
    try:
        if "@" not in key:
            raise BadInput(f"'{key}' names no target", "write effect@target, e.g. dry_friction@carriage")
        check_effect(key, simulator)
        (effect,) = propose(*moving(), [key])
        given = {
            name: dataclasses.replace(bounds[address], unit=parameter.unit)
            for name, parameter in effect.parameters.items()
            if (address := f"{key}.{name}") in bounds
        }
        return dataclasses.replace(effect, **given)  # type: ignore[type-var]
    except BadInput as error:
        raise BadInput(str(error), where=where) from None
