"""``[parameters]``, ``[runs]`` and ``[effects.scope]`` of a problem file: what is fitted, once or in every run or unit.

| written                                                     | becomes                                              |
|-------------------------------------------------------------|------------------------------------------------------|
| ``"joint.a.damping" = [0, 1]``                              | one parameter                                        |
| ``"joint.f*.damping" = [0, 1]``                             | one parameter for each joint that the glob matches   |
| ``"joint.f*.damping" = { .., tie = true }``                 | one parameter, the value of all of them              |
| ``.. = { .., scope = "per_run" }``, ``[effects.scope]``     | one value in every run                               |
| ``groups = ["ball-a-*", "ball-b-*"]``                       | runs that have what is per run in common             |
| ``.. = { .., scope = "per_unit" }``, ``[effects.scope]``    | one value in every unit of the machine               |
| ``units = ["arm-1-*", "arm-2-*"]``, ``[units]``             | runs of one unit                                     |
| ``[runs."kp200*"]``, ``"actuator.goal.kp" = 1.9``           | a known constant of these runs                       |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from onlinebayes.criticism import Scope
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.problems.section import Section
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.addresses import is_glob

SCOPES = ("shared", "per_run", "per_unit")
NEVER_NEGATIVE = {
    "mass": "mass",
    "inertia": "moment of inertia",
    "armature": "rotor inertia",
    "frictionloss": "dry friction",
}


@dataclass(frozen=True)
class Declared:
    """Parameters as a problem file declares them.

    Args:
        model: address or glob -> bounds.
        tied: the globs that are one value.
        effects: ``name@target.parameter`` -> bounds, of added effects.
        per_run: addresses and effects with one value a run.
        known: glob of runs -> address -> value [SI].
        groups: globs of runs that share what is per run.
        per_unit: addresses and effects with one value a unit.
        units: unit -> names or globs of its runs.
    """

    model: dict[str, Parameter]
    tied: frozenset[str]
    effects: dict[str, Parameter]
    per_run: tuple[str, ...]
    known: dict[str, dict[str, float]]
    groups: tuple[str, ...] = ()
    per_unit: tuple[str, ...] = ()
    units: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def globs(self) -> tuple[str, ...]:
        """Addresses that stand for several elements."""
        return tuple(name for name in (*self.model, *self._unfitted) if is_glob(name))

    @property
    def space(self) -> ParameterSpace:
        """The simulator's free parameters: what is fitted, then what is only known in some runs."""
        known = {name: [v[name] for v in self.known.values() if name in v] for name in self._unfitted}
        constants = {name: _around(values, field_of(name) in NEVER_NEGATIVE) for name, values in known.items()}
        return ParameterSpace({**self.model, **constants})

    @property
    def scope(self) -> Scope | None:
        """The differences of the parameters between runs; None where they do not differ."""
        return Scope(self.per_run, self.known, self._unfitted, self.groups, self.per_unit, self.units) or None

    @property
    def _unfitted(self) -> tuple[str, ...]:
        named = dict.fromkeys(address for values in self.known.values() for address in values)
        return tuple(name for name in named if name not in self.model and "@" not in name)

    def expanded(self, expand: Callable[[str], tuple[str, ...]], section: Section) -> Declared:
        """With globs that are not tied written out.

        Args:
            expand: a glob -> the addresses it stands for.
            section: ``[parameters]``, for messages.
        """
        model: dict[str, Parameter] = {}
        own = (list(self.per_run), list(self.per_unit))
        for name, parameter in self.model.items():
            with section.at(name):
                found = (name,) if name in self.tied else expand(name)
            for one in found:
                if one != name and one in self.model:
                    continue  # what is written out says it for this one
                if one in model:
                    raise section.error(name, f"'{one}' is matched twice", "let one glob match it")
                model[one] = parameter
                for names in own:
                    if name in names and one not in names:
                        names.append(one)
        per_run, per_unit = (tuple(n for n in names if n in model or "@" in n) for names in own)
        return replace(self, model=model, per_run=per_run, per_unit=per_unit)


def declared(top: Section, effects: Section) -> Declared:
    """Read the three tables.

    Raises:
        BadInput: nothing to fit, or bounds, a scope or a constant that cannot be used.
    """
    section = top.section("parameters")
    if "parameters" not in top:
        cure = "name what may be inferred, with bounds; leave the table empty where nothing may"
        raise BadInput("[parameters] is missing", cure, where=top.file)
    read = {key: _parameter(section, key, value) for key, value in section.values.items()}
    own = {name: [key for key, (_, _, scope) in read.items() if scope == name] for name in SCOPES}
    scopes = effects.section("scope")
    for key in scopes.values:
        if "@" not in key:
            raise scopes.error(key, "no effect at a target", "write effect@target, e.g. constant_load@carriage")
        if key not in (named := own[_scope(scopes, key)]):
            named.append(key)
    per_run, per_unit = own["per_run"], own["per_unit"]
    return Declared(
        {key: bounds for key, (bounds, _, _) in read.items() if "@" not in key},
        frozenset(key for key, (_, tie, _) in read.items() if tie),
        {key: bounds for key, (bounds, _, _) in read.items() if "@" in key},
        tuple(per_run),
        _known(top.section("runs")),
        _groups(top, per_run),
        tuple(per_unit),
        _units(top, per_unit),
    )


def _groups(top: Section, per_run: list[str]) -> tuple[str, ...]:
    groups = top.texts("groups", ())
    if groups and not per_run:
        raise top.error("groups", "nothing is per run", 'give a parameter or an effect the scope "per_run"')
    return groups


def _units(top: Section, per_unit: list[str]) -> dict[str, tuple[str, ...]]:
    """``["arm-1-*", "arm-2-*"]``, or a table of unit = runs."""
    if isinstance(top.values.get("units"), dict):
        table = top.section("units")
        units = {unit: (runs,) if isinstance(runs, str) else table.texts(unit) for unit, runs in table.values.items()}
    else:
        units = {glob: (glob,) for glob in top.texts("units", ())}
    for unit in (unit for unit, runs in units.items() if not runs):
        raise top.section("units").error(unit, "no run is named", 'name its runs, e.g. ["arm-1-*"]')
    if units and not per_unit:
        raise top.error("units", "nothing is per unit", 'give a parameter or an effect the scope "per_unit"')
    return units


def _known(section: Section) -> dict[str, dict[str, float]]:
    found = {}
    for pattern in section.values:
        table = section.section(pattern)
        for address, value in table.values.items():
            if isinstance(value, dict):
                cure = f'write "{_flat(address, value)}" = value'
                raise table.error(address, "an address that is not in quotes", cure)
        found[pattern] = {address: table.finite(address, value) for address, value in table.values.items()}
        if not found[pattern]:
            raise section.error(pattern, "nothing is known of these runs", 'write "address" = value in SI units')
    return found


def _parameter(section: Section, key: str, value: Any) -> tuple[Parameter, bool, str]:
    """Bounds, whether a glob is one value, and the scope."""
    if isinstance(value, list):
        value = dict(zip(("low", "high"), value, strict=True)) if len(value) == 2 else value
    quoted = key.count(".") >= 2 or "@" in key
    if isinstance(value, dict) and not quoted and any(isinstance(part, dict | list) for part in value.values()):
        raise section.error(key, "an address that is not in quotes", f'write "{_flat(key, value)}" = [low, high]')
    if not isinstance(value, dict):
        raise section.error(key, f"{value!r} is no pair of bounds", "write [low, high] in SI units")
    table = Section(value, section.file, section.full(key), ("low", "high", "scale", "tie", "scope"))
    if not isinstance(tie := table.values.get("tie", False), bool):
        raise table.error("tie", f"{tie!r} is not true or false", "write true or false")
    if tie and not is_glob(key):
        raise table.error("tie", "a single address has nothing to share", "write a glob such as joint.finger*.damping")
    if is_glob(key) and "@" in key:
        raise section.error(key, "globs of effects' parameters are not supported", "name each one")
    low, high = (table.number(name) for name in ("low", "high"))
    if low is None or high is None:
        raise section.error(key, "a bound is missing", "write [low, high] or { low = .., high = .. } in SI units")
    with section.at(key):
        return Parameter(low, high, scale=table.text("scale", "linear")), tie, _scope(table, "scope")


def _scope(table: Section, key: str) -> str:
    if (scope := table.text(key, "shared")) not in SCOPES:
        raise table.error(key, f"scope '{scope}' is unknown", "write 'shared', 'per_run' or 'per_unit'")
    return scope


def field_of(address: str) -> str:
    """``mass`` of ``body.arm.mass``, ``inertia`` of ``body.arm.inertia[0]``."""
    return address.rpartition(".")[2].partition("[")[0]


def _around(values: list[float], never_negative: bool) -> Parameter:
    """Bounds that hold the known values; nothing is fitted within them."""
    width, lowest = max(abs(value) for value in values) or 1.0, min(values)
    low = max(lowest - width, 0.0) if never_negative and lowest >= 0 else lowest - width
    return Parameter(low, max(values) + width)


def _flat(key: str, value: Any) -> str:
    """The address that ``a.b.c = ..`` without quotes meant, which TOML reads as tables within tables."""
    while isinstance(value, dict) and value and not {"low", "high"} & value.keys():
        inner, value = next(iter(value.items()))
        key = f"{key}.{inner}"
    return key
