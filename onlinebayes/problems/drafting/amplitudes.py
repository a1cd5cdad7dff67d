"""Units that the values of a log show where no name says one: degrees for radians, mm for m, a gripper's 0 to 100.

    against a unit:  the values leave the joint's range by half of it;  or, without a range, a servo turns more than
                     twice while it is faster than 10 rad/s
    for a unit:      in it they stay within the range and a quarter of it;  or within a turn

All hinges together, all slides together and all commands of servos together, for a log is written in one unit
throughout. What only one reading fits is proposed, what several fit is asked: encoders' counts, a gripper in percent or
degrees, a fast joint without a range. Ranges of a tenth of a radian throughout are those of a model in radians that
lacks ``<compiler angle="radian"/>``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float

from onlinebayes.measurements.clocks import TIME
from onlinebayes.measurements.formats import Columns, Source
from onlinebayes.measurements.units import to_si
from onlinebayes.problems.drafting.actuator_inputs import Input
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.problems.drafting.words import words
from onlinebayes.runs import BadInput

OUTSIDE, WITHIN = 0.5, 0.25
"""Shares of a range: so far outside no joint goes; so far a soft limit gives, or a zero differs."""
TURNS, FAST, FASTEST = 4 * math.pi, 10.0, 60.0
"""Of a joint without a range: travel [rad] and speed [rad/s] of no servo; speed of hardly any joint."""
FULL_TURN = 400.0
GRIPPERS = {"gripper", "grip", "jaw", "jaws", "finger", "fingers", "hand", "claw"}
SMALLEST, LARGEST = 20.0, 101.0
"""A percentage reaches more than the first and no more than the second."""
TINY = 1.05 * 2 * math.pi * math.pi / 180
"""The largest limit of joints whose ranges were radians and are read as degrees [rad]."""
UNIT = {"rad": "deg", "m": "mm"}
SAME, OTHER = (0.5, 2.0), (28.0, 115.0)
"""Ratios of the speed in a column of positions to that in one of speeds: one unit; degrees beside radians."""


@dataclass(frozen=True)
class Column:
    """The values of a column that has no unit yet.

    Args:
        match: the signal or command that it is.
        unit: SI unit of that.
        cells: the finite values.
        speed: that 99 of 100 steps do not exceed [unit of the column / s]; nan without a clock.
        span: lowest and highest value that the model allows [SI]; None without limits.
        servo: True if a position servo drives the joint.
    """

    match: Match
    unit: str
    cells: Float[np.ndarray, " T"]
    speed: float
    span: tuple[float, float] | None
    servo: bool

    def fits(self, factor: float) -> bool:
        """Check whether the values times ``factor`` are within what is allowed, or within a turn."""
        if self.span is None:
            return bool(np.abs(self.cells).max() <= FULL_TURN) if self.unit == "rad" else True
        return self._beyond(factor) <= WITHIN

    @property
    def denies_si(self) -> bool:
        """True if the values cannot be in SI."""
        if self.span is not None:
            return self._beyond(1.0) > OUTSIDE
        return self.unit == "rad" and self.servo and float(np.ptp(self.cells)) > TURNS and self.speed > FAST

    @property
    def is_percent(self) -> bool:
        """True for a gripper whose values could be percent of its range."""
        named = {*words(self.match.name), *words(self.match.column)} & GRIPPERS
        low, high = float(self.cells.min()), float(self.cells.max())
        return bool(named) and self.span is not None and low >= -1 and SMALLEST < high <= LARGEST and self.denies_si

    @property
    def is_counted(self) -> bool:
        """True for whole numbers that are neither SI nor degrees."""
        far = float(np.abs(self.cells).max()) > FULL_TURN
        return far and bool((self.cells == np.round(self.cells)).all()) and self.unit == "rad"

    def _beyond(self, factor: float) -> float:
        low, high = self.span or (0.0, 0.0)
        over = max(float(self.cells.max()) * factor - high, low - float(self.cells.min()) * factor, 0.0)
        return over / max(high - low, 1e-9)


@dataclass(frozen=True)
class Read:
    """Matches with the units that their values show, and what must be asked."""

    matches: tuple[Match, ...]
    questions: tuple[str, ...]


def by_values(
    model: mujoco.MjModel,
    in_degrees: bool,
    matches: Sequence[Match],
    units: Mapping[str, str],
    inputs: Mapping[str, Input],
    sources: Sequence[Source],
    timed: bool,
) -> Read:
    """Look at every column of a position, a speed or a servo's command whose name says no unit.

    Args:
        model: gives ranges.
        in_degrees: whether the model's file has its angles in degrees.
        matches: columns by name.
        units: signal -> SI unit.
        inputs: what actuators are told.
        sources: the logs.
        timed: whether they have a column ``time``, for speeds.
    """
    try:
        columns = _columns(model, matches, units, inputs, sources, timed)
    except BadInput:  # a malformed row; its owner learns of it when all is read
        return Read(tuple(matches), ())
    positions = [one for one in columns if one.match.name.startswith("qpos.")]
    told = [one for one in columns if one.match.name.startswith("ctrl.")]
    if (said := _radians_as_degrees(model, in_degrees, positions)) is not None:
        return Read(tuple(matches), (said,))
    changed: dict[str, Match] = {}
    questions: list[str] = []
    for kind in (positions, told):
        for unit in ("rad", "m"):
            found, asked = _together([one for one in kind if one.unit == unit], UNIT[unit])
            changed |= found
            questions += asked
    changed |= _rates(columns, changed, units)
    return Read(tuple(changed.get(one.name, one) for one in matches), tuple(questions))


def _together(columns: Sequence[Column], unit: str) -> tuple[dict[str, Match], list[str]]:
    """One unit for all columns of a kind, percentages and counts apart."""
    factor = to_si(unit)
    percent = [one for one in columns if one.is_percent]
    counted = [one for one in columns if one.is_counted and one.denies_si and one not in percent]
    rest = [one for one in columns if one not in percent and one not in counted]
    questions = [_counts(one) for one in counted]
    found: dict[str, Match] = {}
    for one in percent:
        if one.fits(factor) and not _is_lerobot(one.match.column):
            questions.append(_percent_or(one, unit))
        else:
            found[one.match.name] = _in_percent(one)
    against = [one for one in rest if one.denies_si]
    if against and all(one.fits(factor) for one in rest):
        worst = max(against, key=lambda one: float(np.abs(one.cells).max()))
        why = f"a guess, {_reach(worst)}: check it"
        found |= {one.match.name: replace(one.match, unit=unit, unit_why=why) for one in rest}
    elif against:
        names = ", ".join(one.match.name for one in against)
        questions.append(f"{names}: {_reach(against[0])}; say what the columns hold: unit, or scale and offset")
    elif unit == "deg" and (fast := [one for one in rest if one.span is None and one.speed > FASTEST and one.fits(1)]):
        names = ", ".join(one.match.name for one in fast)
        questions.append(f'{names}: {fast[0].speed:.3g} rad/s as it stands; if these are degrees, write unit = "deg"')
    return found, questions


def _columns(
    model: mujoco.MjModel,
    matches: Sequence[Match],
    units: Mapping[str, str],
    inputs: Mapping[str, Input],
    sources: Sequence[Source],
    timed: bool,
) -> list[Column]:
    driven = {given.joint for given in inputs.values() if given.told == "qpos"}
    wanted = []
    for one in matches:
        kind, _, rest = one.name.partition(".")
        told = inputs.get(one.name, Input())
        joint = told.joint if kind == "ctrl" else rest
        unit = units.get(f"qpos.{joint}" if kind == "ctrl" else one.name, "")
        if unit and not one.keys and kind in ("qpos", "qvel", "ctrl") and (kind != "ctrl" or told.told == "qpos"):
            wanted.append((one, unit, joint))
    names = [one.column for one, *_ in wanted]
    tables = [source.columns([*names, *([TIME] if timed else [])]) for source in sources] if names else []
    found = []
    for one, unit, joint in wanted:
        cells, speed = _values(one.column, tables, timed)
        if len(cells) > 1 and np.ptp(cells) > 0:
            span = _span(model, joint, one.name if one.name.startswith("ctrl.") else "")
            found.append(Column(one, unit, cells, speed, span, joint in driven))
    return found


def _values(column: str, tables: Sequence[Columns], timed: bool) -> tuple[Float[np.ndarray, " T"], float]:
    """Finite values of a column, and the speed that 99 of 100 steps do not exceed."""
    values, speeds = [], []
    for read in tables:
        known = np.isfinite(read[column])
        values.append(read[column][known])
        if timed:
            step = np.diff(read[TIME][known])
            change = np.abs(np.diff(values[-1]))
            speeds.append(change[step > 0] / step[step > 0])
    speed = np.concatenate(speeds) if speeds else np.empty(0)
    return np.concatenate(values), float(np.quantile(speed, 0.99)) if len(speed) else math.nan


def _span(model: mujoco.MjModel, joint: str, command: str) -> tuple[float, float] | None:
    """The range of a joint; of a servo's command its own, where it has one."""
    if command:
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, command.removeprefix("ctrl."))
        if i >= 0 and model.actuator_ctrllimited[i]:
            low, high = model.actuator_ctrlrange[i]
            return float(low), float(high)
    i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    if i < 0 or not model.jnt_limited[i]:
        return None
    low, high = model.jnt_range[i]
    return float(low), float(high)


def _radians_as_degrees(model: mujoco.MjModel, in_degrees: bool, positions: Sequence[Column]) -> str | None:
    """The line for a model whose file has radians and does not say so; None for any other."""
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    limited = [one for one in positions if one.unit == "rad" and one.span is not None]
    if not in_degrees or not hinges.any() or np.abs(model.jnt_range[hinges]).max() > TINY:
        return None
    beyond = [one for one in limited if one.denies_si and one.fits(math.pi / 180)]
    if not beyond or not all(one.fits(math.pi / 180) for one in limited):
        return None
    low, high = beyond[0].span or (0.0, 0.0)
    return (
        f"the model's ranges are {low:.3g} to {high:.3g} rad for {beyond[0].match.name}, which reaches "
        f'{np.abs(beyond[0].cells).max():.3g}: its file seems to have radians; add <compiler angle="radian"/> to it'
    )


def _rates(columns: Sequence[Column], changed: Mapping[str, Match], units: Mapping[str, str]) -> dict[str, Match]:
    """Columns of speeds in degrees per second, as their size beside the positions' change shows."""
    positions = {one.match.name[5:]: one for one in columns if one.match.name.startswith("qpos.")}
    found = {}
    for one in columns:
        beside = positions.get(one.match.name[5:]) if one.match.name.startswith("qvel.") else None
        if beside is None or one.unit != "rad/s" or not beside.speed > 0:
            continue
        ratio = beside.speed / float(np.quantile(np.abs(one.cells), 0.99))
        in_degrees = beside.match.name in changed and changed[beside.match.name].unit == "deg"
        if SAME[0] < ratio < SAME[1] if in_degrees else 1 / OTHER[1] < ratio < 1 / OTHER[0]:
            why = f"a guess, by the change of {beside.match.name}: check it"
            found[one.match.name] = replace(one.match, unit="deg/s", unit_why=why)
    return found


def _is_lerobot(column: str) -> bool:
    return column.startswith(("observation.state", "action")) and ".pos" in column


def _reach(one: Column) -> str:
    said = f"{one.match.name} has {one.cells.min():.3g} to {one.cells.max():.3g}"
    if one.span is not None:
        return f"{said}, the model allows {one.span[0]:.3g} to {one.span[1]:.3g} {one.unit}"
    return f"{said}, at up to {one.speed:.3g} a second"


def _percent(one: Column) -> tuple[float, float]:
    low, high = one.span or (0.0, 1.0)
    return float(f"{(high - low) / 100:.6g}"), float(f"{low:.6g}")


def _in_percent(one: Column) -> Match:
    scale, offset = _percent(one)
    why = f"a guess, percent of {one.span and f'{one.span[0]:.3g} to {one.span[1]:.3g}'} {one.unit}: check it"
    return replace(one.match, scale=scale, offset=offset, unit_why=why)


def _percent_or(one: Column, unit: str) -> str:
    scale, offset = _percent(one)
    return f'{_reach(one)}: {unit}, or percent? write unit = "{unit}", or scale = {scale:g} and offset = {offset:g}'


def _counts(one: Column) -> str:
    return (
        f"{one.match.name} has whole numbers from {one.cells.min():.0f} to {one.cells.max():.0f}: counts of an "
        f"encoder? write scale = 2 pi / counts of a turn ({2 * math.pi / 4096:.6g} of 4096), and as offset minus "
        "what its zero then reads"
    )
