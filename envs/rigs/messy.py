"""Messy machines: one or two effects dominate, six to ten small ones lie beside them, as on machines that were built.

| what is messy                       | how much                                                                  |
|-------------------------------------|---------------------------------------------------------------------------|
| what dominates                      | an effect, or one time in three a number: ``STRENGTH`` times medium size  |
| masses, moments, gears of the model | off by 1 to 5 %, lengths by 0.2 to 1 %, centres of mass by 0.5 to 2 %      |
| other effects of the rig, a tilt    | a fifteenth to a sixth of what dominates                                  |
| gain of a motor, by direction       | 1 to 3 %                                                                  |
| late sensors                        | 0.5 to 2 ms                                                               |
| zeros of the encoders, by run       | one to five of the rig's own noises                                       |
| sensors                             | one of ``BEST`` and one of ``WORST`` of the rig's own noises              |
| runs                                | two or three, the held-out ones a half larger; or one, its last third so  |

The engineer's model is the rig's own file with the wrong numbers; all else is the machine's.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import final
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.cases import BlindCase, base_values, data_sheet, tables
from envs.rigs.catalogue import RIGS
from envs.rigs.off_numbers import OffNumber, number, with_number
from envs.rigs.recording import Habits, record
from envs.rigs.rig import HiddenEffect, Protocol, Rig
from onlinebayes.runs import BadInput

STRENGTH: Mapping[str, float] = {
    "swing": 10.0,
    "slide_drive": 8.0,
    "cart_pole": 8.0,
    "two_link_arm": 10.0,
    "position_servo": 6.0,
    "six_joint_arm": 5.0,
    "pushed_block": 3.0,
    "thrown_ball": 2.5,
}
"""Times its medium size at which an effect dominates: friction is a quarter of what the motor gives, not a fiftieth."""

MOST: Mapping[str, float] = {
    "delay": 0.025,
    "time_constant": 0.025,
    "gain": 0.3,
    "angle": 0.08,
    "scale": 0.1,
    "mu": 0.3,
}
"""Of a dominating effect's parameters, where twice the medium size is not more [SI]: beyond it nobody would begin."""

SHARES: Mapping[str, tuple[float, float]] = {"pos": (0.002, 0.01), "ipos": (0.005, 0.02)}
"""By which lengths and centres of mass are off; all else by 1 to 5 %."""

EARLY = 0.6  # chance of each trait to come before the rig's other effects
TWO = 0.4  # chance of two that dominate
OFF = 0.2  # share by which a dominating number is off at most
SMALL = 0.07, 0.17  # of the strength
TILT = 0.001, 0.004  # [rad]
DIRECTION = 0.01, 0.03
LATE = 0.0005, 0.002  # [s]
ZEROS = 1.0, 5.0  # noises
BEST, WORST = 0.2, 20.0  # noises: about 1e-4 and 1e-2 of the travel
WORST_IN_A_LOOP, WORST_ALONE = 8.0, 3.0  # what a controller bears; where nothing else shows what dominates


@final
@dataclass
class Mess:
    """A messy machine before it moves; drawn bit by bit.

    Args:
        rig: with its sensors and runs.
        xml: the engineer's model.
        truth: values that make the data [SI].
        fixed: parameters that are not free.
        keys: of what dominates.
        small: keys of what does not, one group for each imperfection.
        zeros: of the encoders, by run [m, rad].
    """

    rig: Rig
    xml: str
    truth: dict[str, float]
    fixed: tuple[str, ...]
    zeros: Float[ndarray, "R n"]
    keys: list[str] = field(default_factory=list)
    small: list[tuple[str, ...]] = field(default_factory=list)

    def off(self, key: str, more: float) -> None:
        """The model's number exceeds the machine's by so much; moments of a body do so together, or it were no body."""
        self.truth[key] = number(self.xml, key)
        together = [f"{key[:-3]}[{k}]" for k in range(3)] if ".inertia" in key else [key]
        values = {one: number(self.xml, one) for one in together}
        for one, value in values.items():
            share = value / self.truth[key] if len(together) > 1 else 1.0
            self.xml = with_number(self.xml, one, value + share * more)


def messy_case(rig: str, seed: int) -> BlindCase:
    """The messy case of that rig and seed (a few seconds); its ``hidden`` dominates, its ``small`` lies beside it.

    Raises:
        BadInput: an unknown rig, or a negative seed.
    """
    mess, draw = messy_machine(rig, seed)
    machine, protocol = mess.rig, mess.rig.protocol
    made = record(
        machine,
        mess.truth,
        draw,
        runs=protocol.fit + protocol.held,
        seconds=protocol.seconds,
        habits=Habits(mess.zeros, _reach(protocol, draw)),
    )
    held = tuple(f"held{k + 1}" for k in range(protocol.held))
    fit = [f"fit{k + 1}" for k in range(protocol.fit)] if held else ["long"]
    return BlindCase(
        rig=rig,
        kind="messy",
        seed=seed,
        columns=tables(machine, made, [*fit, *held]),
        xml=mess.xml,
        parameters={name: bound for name, bound in machine.free.items() if name not in mess.fixed},
        noise=data_sheet(machine),
        holdout=held,
        hidden=tuple(mess.keys),
        level="strong",
        partners=machine.partners(tuple(machine.laws.get(key, key) for key in mess.keys)),
        fault="",
        truth=mess.truth,
        small=tuple(key for group in mess.small for key in group),
    )


def messy_machine(rig: str, seed: int) -> tuple[Mess, np.random.Generator]:
    """The machine of a messy case, and what decides on its runs; errors as :func:`messy_case`."""
    if rig not in RIGS:
        raise BadInput(f"rig '{rig}' is unknown", f"use one of {', '.join(RIGS)}")
    if seed < 0:
        raise BadInput(f"seed {seed} is negative", "seeds count from 0")
    draw, plain = np.random.default_rng([seed, zlib.crc32(f"{rig} messy".encode())]), RIGS[rig]
    dominating = _dominating(plain, draw)
    fixed = tuple(name for one in dominating if isinstance(one, OffNumber) for name in one.fixed)
    truth = {**plain.nominal, **base_values(plain, fixed, draw)}
    machine = replace(plain, protocol=_protocol(plain, draw))
    zeros = np.zeros((machine.protocol.fit + machine.protocol.held, len(plain.joints)))
    mess = Mess(machine, plain.xml, truth, fixed, zeros)
    for one in dominating:
        _add(mess, one, STRENGTH[rig] * draw.uniform(0.7, 1.4), draw)
        mess.keys.append(one.key)
    taken = {place for one in dominating for place in (one.key, *_looks_like(plain, one))}
    _add_small(mess, taken, draw)
    return mess, draw


def _dominating(rig: Rig, draw: np.random.Generator) -> list[HiddenEffect | OffNumber]:
    """One or two that do not look alike and lie at different places; the second one is an effect."""
    effects: list[HiddenEffect | OffNumber] = [
        one for one in rig.effects if not one.shrinks
    ]  # small runs know no limit
    numbers: list[HiddenEffect | OffNumber] = [*rig.surplus, *rig.own]
    of = numbers if draw.random() < 1 / 3 else effects
    first = of[draw.integers(len(of))]
    if draw.random() > TWO:
        return [first]
    like = _looks_like(rig, first)
    law, place = like[0].split("@")
    apart = [one for one in effects if one.key not in like and one.key.split("@")[0] != law]
    apart = [one for one in apart if one.key.split("@")[1] != place]
    return [first, apart[draw.integers(len(apart))]] if apart else [first]


def _looks_like(rig: Rig, one: HiddenEffect | OffNumber) -> tuple[str, ...]:
    """The law, and those that look like it; without the axes that some have."""
    law = one.law if isinstance(one, OffNumber) else one.key
    return tuple(_plain(key) for key in (law, *rig.partners((law,))))


def _plain(key: str) -> str:
    """An effect's key without its axis; others as they are."""
    return re.sub(r"^(com_offset|gravity_tilt|wind)(@\w+)\.[xyz]$", r"\1\2", key)


def _laws(rig: Rig, keys: Iterable[str]) -> set[str]:
    """Return the laws of some keys, numbers under the name of the effect that is the same law."""
    return {_plain(rig.laws.get(key, key)) for key in keys}


def _add(mess: Mess, one: HiddenEffect | OffNumber, scale: float, draw: np.random.Generator) -> None:
    """Put in what dominates."""
    sign = float(draw.choice([-1.0, 1.0]))
    if isinstance(one, HiddenEffect):
        medium, values = one.values(1.0, sign), one.values(scale, sign)
        mess.truth |= {name: _at_most(name, value, medium[name]) for name, value in values.items()}
        return
    true, more = number(mess.xml, one.key), scale * one.size
    if one in mess.rig.surplus:
        mess.off(one.key, more)
    else:
        mess.off(one.key, sign * (min(more, OFF * abs(true)) if true and ".ipos" not in one.key else more))


def _at_most(name: str, value: float, medium: float) -> float:
    limit = max(MOST.get(name.rpartition(".")[2], np.inf), 2 * abs(medium))
    return float(np.clip(value, -limit, limit))


def _add_small(mess: Mess, taken: set[str], draw: np.random.Generator) -> None:
    """Put in six to ten small ones: numbers first, then traits and effects."""
    rig, wanted = mess.rig, int(draw.integers(6, 11))
    fixed = [key for key in _numbers(rig) if key not in {*rig.free, *taken} and not taken & _laws(rig, [key])]
    for key in draw.permutation(fixed)[: draw.integers(2, 5)].tolist():
        low, high = SHARES.get(key.split(".")[2].split("[")[0], (0.01, 0.05))
        share = float(draw.uniform(low, high) * draw.choice([-1.0, 1.0]))
        mess.off(key, _no_more_than_small(rig, key, share * number(mess.xml, key)))
        mess.small.append((key,))
    present = {*taken, *_laws(rig, [key for group in mess.small for key in group])}
    traits, effects = _traits(mess, draw), _effects(rig, draw)
    early = draw.random(len(traits)) < EARLY
    rest = [one for one, first in zip(traits, early, strict=True) if not first]
    for one in (*(one for one, first in zip(traits, early, strict=True) if first), *effects, *rest):
        if len(mess.small) < wanted and not present & set(one.keys):
            present |= set(one.keys)
            mess.small.append(one.keys)
            mess.truth |= one.values
            mess.zeros = mess.zeros + one.zeros


@final
@dataclass(frozen=True)
class _Small:
    """A small imperfection: keys, values [SI], and what it makes of the encoders' zeros."""

    keys: tuple[str, ...]
    values: Mapping[str, float]
    zeros: Float[ndarray, "R n"] | float = 0.0


def _traits(mess: Mess, draw: np.random.Generator) -> list[_Small]:
    """A tilt, a motor that gives less one way, late sensors, zeros that differ by run."""
    rig, turn = mess.rig, float(draw.choice([-1.0, 1.0]))
    tilt = float(draw.uniform(*TILT) * draw.choice([-1.0, 1.0]))
    motor = f"direction_gain@{rig.actuators[draw.integers(len(rig.actuators))].name}"
    late = tuple(f"sensor_delay@qpos.{joint}" for joint in rig.joints)
    bias = tuple(f"sensor_bias@qpos.{joint}" for joint in rig.joints)
    spread = draw.uniform(*ZEROS) * np.array(RIGS[rig.name].protocol.sd)
    return [
        _Small(("gravity_tilt@world",), {"gravity_tilt@world.angle": tilt}),
        _Small((motor,), {f"{motor}.gain": turn * float(draw.uniform(*DIRECTION))}),
        _Small(late, {f"{key}.delay": float(draw.uniform(*LATE)) for key in late}),
        _Small(bias, {}, spread * draw.standard_normal(mess.zeros.shape)),
    ]


def _effects(rig: Rig, draw: np.random.Generator) -> list[_Small]:
    """The rig's effects in any order, each a small one."""
    usual = [one for one in rig.effects if not one.shrinks]
    found = []
    for k in draw.permutation(len(usual)).tolist():
        scale, sign = STRENGTH[rig.name] * draw.uniform(*SMALL), float(draw.choice([-1.0, 1.0]))
        found.append(_Small((usual[k].key,), usual[k].values(scale, sign)))
    return found


def _no_more_than_small(rig: Rig, key: str, more: float) -> float:
    """The error of a number, but no more than a small effect's size where its own medium size is known."""
    most = next((SMALL[1] * STRENGTH[rig.name] * off.size for off in rig.own if off.key == key), np.inf)
    return float(np.clip(more, -most, most))


def _numbers(rig: Rig) -> Iterator[str]:
    """Numbers of the model that are not nothing: lengths, masses, centres, moments, armatures, drives' constants."""
    root = ElementTree.fromstring(rig.xml)
    for body in root.iterfind(".//body"):
        turns = body.find("joint[@type='hinge']") is not None
        fields = [*(f"ipos[{k}]" for k in range(3)), *(["inertia[1]"] if turns else []), "mass"]
        yield from _present(rig.xml, [f"body.{body.get('name')}.{name}" for name in fields])
    for body in root.iterfind(".//body/body"):  # where the first one stands makes no difference
        yield from _present(rig.xml, [f"body.{body.get('name')}.pos[{k}]" for k in range(3)])
    for joint in root.iterfind(".//joint[@armature]"):
        yield f"joint.{joint.get('name')}.armature"
    for actuator in rig.actuators:
        fields = ["kp", "kv"] if actuator.servo else ["gear[0]"]
        yield from _present(rig.xml, [f"actuator.{actuator.name}.{name}" for name in fields])


def _present(xml: str, keys: list[str]) -> Iterator[str]:
    yield from (key for key in keys if number(xml, key))


def _protocol(rig: Rig, draw: np.random.Generator) -> Protocol:
    """Few runs or one long one, and sensors of different quality; what was thrown comes down soon."""
    protocol, joints, lasting = rig.protocol, len(rig.joints), rig.name != "thrown_ball"
    if joints == 1:
        factor = np.exp(draw.uniform(np.log(BEST), np.log(WORST_ALONE), 1))
    else:
        worst = WORST_IN_A_LOOP if protocol.feedback else WORST
        between = np.exp(draw.uniform(np.log(BEST), np.log(worst), joints - 2))
        factor = draw.permutation(np.array([BEST, worst, *between]))
    sd = factor * np.array(protocol.sd)
    quantised = sd * draw.uniform(0.5, 3.0, joints)
    speed_sd = tuple((factor * np.array(protocol.speed_sd)).tolist()) if protocol.speed_sd else ()
    one = lasting and draw.random() < 0.25
    fit, held, longer = (1, 0, 4.0) if one else (int(draw.integers(2, 4)), int(draw.integers(1, 3)), draw.uniform(1, 2))
    seconds = float(longer if lasting else 1.0) * protocol.seconds
    return replace(
        protocol,
        fit=fit,
        held=held,
        seconds=seconds,
        sd=tuple(sd.tolist()),
        resolution=tuple(quantised.tolist()),
        speed_sd=speed_sd,
    )


def _reach(protocol: Protocol, draw: np.random.Generator) -> Float[ndarray, "R 2"]:
    """Amplitudes: small where the model is fitted, larger where it is judged."""
    near, far = draw.uniform(0.6, 0.75), draw.uniform(1.0, 1.1)
    if protocol.held == 0:
        return np.array([[near, far]])
    return np.array([[near] * 2] * protocol.fit + [[far] * 2] * protocol.held)
