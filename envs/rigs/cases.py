"""Blind cases: a rig, recorded with something hidden, and what an engineer would hand over; the truth kept apart.

| kind    | what is wrong                                                         | right verdict        |
|---------|-----------------------------------------------------------------------|----------------------|
| effect  | one effect of the rig's list, or two; weak, medium, strong in turn    | missing_effect       |
| null    | base parameters off their nominal values, nothing hidden              | adequate             |
| tie     | one of two effects that the inputs cannot part                        | tie                  |
| outside | something that no vocabulary names                                    | unexplained          |
| bounds  | one base parameter lies outside the bounds given                      | bounds_exclude_truth |
| wiring  | the log is not what it says: see :mod:`envs.rigs.wiring`              | data_problem         |
| short   | less than a second of each of two runs                                | insufficient_data    |
| surplus | the model has a passive term that the machine lacks                   | bounds_exclude_truth |
| own     | a number that the model keeps fixed is off                            | bounds_exclude_truth |

The same rig, kind and seed give the same case; which seeds are reported is the study's to say.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.catalogue import RIGS
from envs.rigs.off_numbers import OffNumber, number, with_number
from envs.rigs.recording import Recording, record
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie
from envs.rigs.wiring import Fault, miswired
from onlinebayes.runs import BadInput

KINDS = ("effect", "null", "tie", "outside", "bounds", "wiring", "short", "surplus", "own")
LEVELS: Mapping[str, float] = {"weak": 0.45, "medium": 1.0, "strong": 2.5}  # times the medium size
BASE = (0.75, 1.35)  # true base parameters, as shares of the nominal ones
MOST_HIDDEN = 2
PAIRED = 0.3  # share of the effect cases that hide two
SHORT = 0.8  # length of a run of the kind ``short`` [s]


@final
@dataclass(frozen=True)
class BlindCase:
    """A case.

    Args:
        rig, kind, seed: what made it.
        columns: run -> column -> values; names of the measurement tables, SI.
        xml: the engineer's model (MJCF).
        parameters: address -> prior bounds [SI].
        noise: signal -> (sd, resolution) as its data sheet gives them [SI].
        holdout: names of the runs to open once.
        hidden: keys ``effect@target`` of what is hidden, or the model's number that is off; for the judge, as all that
            follows.
        level: weak, medium or strong; empty where nothing has a size.
        partners: keys that explain the data as well as ``hidden``.
        fault: what is wrong with the table or the bounds, and where; empty otherwise.
        truth: every value that made the data [SI], by address.
        small: keys of what is off by little beside ``hidden``, on messy machines.
    """

    rig: str
    kind: str
    seed: int
    columns: Mapping[str, Mapping[str, Float[ndarray, " T"]]]
    xml: str
    parameters: Mapping[str, tuple[float, float]]
    noise: Mapping[str, tuple[float, float]]
    holdout: tuple[str, ...]
    hidden: tuple[str, ...]
    level: str
    partners: tuple[str, ...]
    fault: str
    truth: Mapping[str, float]
    small: tuple[str, ...] = ()


@final
@dataclass(frozen=True)
class _Plan:
    """Plan of a case, made before anything moves."""

    hidden: tuple[HiddenEffect, ...] = ()
    level: str = ""
    partners: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()
    fault: Fault | None = None
    off: OffNumber | None = None

    @property
    def keys(self) -> tuple[str, ...]:
        """Of what is hidden."""
        return tuple(effect.key for effect in self.hidden) + ((self.off.key,) if self.off else ())


def kinds(rig: str) -> tuple[str, ...]:
    """The kinds of cases that a rig has: of some models no number can be off that a free parameter would not hide."""
    return tuple(kind for kind in KINDS if kind != "own" or RIGS[rig].own)


def case(rig: str, kind: str, seed: int, last: bool = True) -> BlindCase:
    """The case of that rig, kind and seed (a few seconds).

    Args:
        rig: a name in ``RIGS``.
        kind: one of ``KINDS`` that the rig has.
        seed: which case of that kind.
        last: may what criticism tries last hide in it, too? Without it the cases are others.

    Raises:
        BadInput: an unknown rig or kind, a negative seed.
    """
    if rig not in RIGS:
        raise BadInput(f"rig '{rig}' is unknown", f"use one of {', '.join(RIGS)}")
    if kind not in kinds(rig):
        raise BadInput(f"kind '{kind}' is unknown of {rig}", f"use one of {', '.join(kinds(rig))}")
    if seed < 0:
        raise BadInput(f"seed {seed} is negative", "seeds count from 0")
    draw = _drawing(rig, kind, seed)
    return _made(RIGS[rig], kind, seed, _plan(RIGS[rig], kind, seed, draw, last), draw)


def hidden_in(rig: str, seed: int) -> tuple[str, ...]:
    """Keys of what the case of kind ``effect`` hides, without its recording."""
    return tuple(effect.key for effect in drawn_effects(RIGS[rig], _drawing(rig, "effect", seed)))


def effect_case(rig: str, key: str, level: str, seed: int) -> BlindCase:
    """A case of kind ``effect`` that hides this effect at this level, for studies of power.

    Raises:
        BadInput: an unknown rig, or a key or level that it does not have.
    """
    if rig not in RIGS:
        raise BadInput(f"rig '{rig}' is unknown", f"use one of {', '.join(RIGS)}")
    known = {effect.key: effect for effect in (*RIGS[rig].effects, *RIGS[rig].last, *RIGS[rig].by_name)}
    if key not in known:
        raise BadInput(f"'{key}' does not hide in {rig}", f"use one of {', '.join(known)}")
    if level not in LEVELS:
        raise BadInput(f"level '{level}' is unknown", f"use one of {', '.join(LEVELS)}")
    draw = np.random.default_rng([seed, zlib.crc32(f"{rig} {key} {level}".encode())])
    return _made(RIGS[rig], "effect", seed, _seen(RIGS[rig], (known[key],), level), draw)


def sized_case(rig: Rig, effect: HiddenEffect | OffNumber | None, scale: float, seed: int) -> BlindCase:
    """A case that hides this effect or number at ``scale`` times its medium size, or nothing: for calibration.

    Base parameters, inputs and noise are those of the rig's null case of the same seed, so that the two tell what the
    effect adds. The rig may be one with another protocol.
    """
    draw = _drawing(rig.name, "null", seed)
    if effect is None:
        return _made(rig, "null", seed, _Plan(), draw)
    if isinstance(effect, OffNumber):
        return _made(rig, "own", seed, _off(rig, effect.resized(scale), "medium"), draw)
    return _made(rig, "effect", seed, _Plan((effect.resized(scale),), "medium"), draw)


def _drawing(rig: str, kind: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(f"{rig} {kind}".encode())])


def _plan(rig: Rig, kind: str, seed: int, draw: np.random.Generator, last: bool) -> _Plan:
    level = list(LEVELS)[seed % len(LEVELS)]
    if kind == "effect":
        return _seen(rig, drawn_effects(rig, draw, last), level)
    if kind == "tie":
        tie: Tie = rig.ties[draw.integers(len(rig.ties))]
        return _Plan((tie.hidden,), "medium", (tie.partner,), tie.fixed)
    if kind == "outside":
        return _Plan((rig.outside[draw.integers(len(rig.outside))],), "strong")
    if kind == "wiring":
        return _Plan(fault=Fault.drawn(rig, draw))
    if kind in ("surplus", "own"):
        numbers = rig.surplus if kind == "surplus" else rig.own
        return _off(rig, numbers[draw.integers(len(numbers))], level)
    return _Plan()


def _off(rig: Rig, off: OffNumber, level: str) -> _Plan:
    return _Plan(level=level, partners=(off.law, *rig.partners((off.law,))), fixed=off.fixed, off=off)


def _seen(rig: Rig, hidden: tuple[HiddenEffect, ...], level: str) -> _Plan:
    return _Plan(hidden, level, rig.partners(tuple(effect.key for effect in hidden)))


def drawn_effects(rig: Rig, draw: np.random.Generator, last: bool = True) -> tuple[HiddenEffect, ...]:
    """One effect of the rig's, or two of different laws at different places that do not look alike."""
    effects = (*rig.effects, *rig.last) if last else rig.effects
    first, second = draw.choice(len(effects), 2, replace=False)
    pair = effects[first], effects[second]
    # Two laws of one name, or two at one place, are one question too many for a first judge.
    apart = all(one != other for one, other in zip(*(effect.key.split("@") for effect in pair), strict=True))
    # Of two that look alike the log shows their sum, which either of them explains.
    alike = pair[1].key in rig.partners((pair[0].key,))
    return pair if apart and not alike and draw.random() < PAIRED else pair[:1]


def _made(rig: Rig, kind: str, seed: int, plan: _Plan, draw: np.random.Generator) -> BlindCase:
    base = base_values(rig, plan.fixed, draw)
    truth = {**rig.nominal, **base}
    # Drawn even where nothing is hidden: the case with the effect and the one without get the same commands.
    signs = draw.choice([-1.0, 1.0], MOST_HIDDEN).tolist()
    for effect, sign in zip(plan.hidden, signs, strict=False):
        truth |= effect.values(LEVELS[plan.level], sign)
    xml = rig.xml
    if plan.off:
        truth[plan.off.key] = number(xml, plan.off.key)
        sign = 1.0 if plan.off.key in {off.key for off in rig.surplus} else signs[0]
        xml = with_number(xml, plan.off.key, truth[plan.off.key] + sign * LEVELS[plan.level] * plan.off.size)
    bounds = {name: bound for name, bound in rig.free.items() if name not in plan.fixed}
    fault = plan.fault.name if plan.fault else ""
    if kind == "bounds":
        name = str(draw.choice(_telling(bounds)))
        bounds[name], fault = _excluding(bounds[name], truth[name], draw), name
    protocol = _shortened(rig.protocol) if kind == "short" else rig.protocol
    recording = record(
        rig,
        truth,
        draw,
        runs=protocol.fit + protocol.held,
        seconds=protocol.seconds,
        interference=plan.fault.interference if plan.fault else None,
    )
    names = [f"fit{k + 1}" for k in range(protocol.fit)] + [f"held{k + 1}" for k in range(protocol.held)]
    columns = tables(rig, recording, names)
    if plan.fault:
        columns = {run: miswired(table, plan.fault) for run, table in columns.items()}
    return BlindCase(
        rig=rig.name,
        kind=kind,
        seed=seed,
        columns=columns,
        xml=xml,
        parameters=bounds,
        noise=data_sheet(rig),
        holdout=tuple(names[protocol.fit :]),
        hidden=plan.keys,
        level=plan.level if plan.keys else "",
        partners=plan.partners,
        fault=fault,
        truth=truth,
    )


def base_values(rig: Rig, fixed: tuple[str, ...], draw: np.random.Generator) -> dict[str, float]:
    """True values of the free parameters; those that a tie keeps fixed stay nominal."""
    low, high = np.log(BASE)
    drawn = {name: rig.nominal[name] * float(np.exp(draw.uniform(low, high))) for name in rig.free}
    return {name: value for name, value in drawn.items() if name not in fixed}


def _telling(bounds: Mapping[str, tuple[float, float]]) -> list[str]:
    """Parameters whose wrong value cannot be missed: dampings may be too small to matter."""
    return [name for name in bounds if not name.endswith(".damping")]


def _excluding(bound: tuple[float, float], value: float, draw: np.random.Generator) -> tuple[float, float]:
    """Bounds that keep the true value out, at a distance."""
    if draw.random() < 0.5:
        return min(bound[0], 0.4 * value), 0.7 * value
    return 1.4 * value, max(bound[1], 3.0 * value)


def _shortened(protocol: Protocol) -> Protocol:
    return replace(protocol, fit=1, held=1, seconds=SHORT)


def tables(rig: Rig, made: Recording, names: list[str]) -> dict[str, dict[str, ndarray]]:
    """The measurement tables of a recording, by the names of its runs."""
    found = {}
    for run, name in enumerate(names):
        table = {"time": made.time}
        table |= {f"ctrl.{act.name}": made.command[:, run, k] for k, act in enumerate(rig.actuators)}
        table |= {f"qpos.{joint}": made.reading[:, run, k] for k, joint in enumerate(rig.joints)}
        if rig.protocol.speed_sd:
            table |= {f"qvel.{joint}": made.speed[:, run, k] for k, joint in enumerate(rig.joints)}
        found[name] = table
    return found


def data_sheet(rig: Rig) -> dict[str, tuple[float, float]]:
    """Signal -> (sd, resolution) of its sensor [SI]."""
    protocol = rig.protocol
    found = {
        f"qpos.{joint}": (float(sd), step)
        for joint, sd, step in zip(rig.joints, protocol.floor, protocol.resolution, strict=True)
    }
    speeds = {f"qvel.{joint}": (sd, 0.0) for joint, sd in zip(rig.joints, protocol.speed_sd, strict=False)}
    return found | speeds
