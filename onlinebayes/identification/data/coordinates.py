"""Names of what stands for the orientation of a free or ball joint: three turns in place of four quaternion parts.

    free joint `base`:  qpos.base.0 1 2 | 3 4 5 6   ->   qpos.base.0 1 2 | rx ry rz,    qvel.base.0 1 2 | 3 4 5
    ball joint `wrist`:             qpos.wrist.0 1 2 3   ->   qpos.wrist.rx ry rz,      qvel.wrist.0 1 2

Turns are in the body's own axes [rad], as its angular velocity is, so that each has the velocity of its axis. What they
are relative to is said in :mod:`.chart`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from onlinebayes.measurements.quaternions import quaternions

AXES = ("rx", "ry", "rz")


@dataclass(frozen=True)
class Rotation:
    """The orientation of one free or ball joint.

    Args:
        joint: its name.
        quaternion: the four signals that hold it (w, x, y, z).
        first: place of the first of them among the positions.
        rates: the three signals of the angular velocity, in the body's axes.
    """

    joint: str
    quaternion: tuple[str, ...]
    first: int
    rates: tuple[str, ...]

    @property
    def turns(self) -> tuple[str, ...]:
        """The three signals that stand for the four."""
        return tuple(f"qpos.{self.joint}.{axis}" for axis in AXES)

    @property
    def linear(self) -> tuple[str, ...]:
        """A free joint's three linear coordinates, without ``qpos.`` and ``qvel.``; a ball joint has none."""
        return tuple(f"{self.joint}.{k}" for k in range(int(self.rates[0].rpartition(".")[2])))

    @property
    def parts(self) -> tuple[str, ...]:
        """The quaternion's four names without ``qpos.``."""
        return tuple(name.removeprefix("qpos.") for name in self.quaternion)


def rotations(signals: Sequence[str]) -> tuple[Rotation, ...]:
    """The free and ball joints among a simulator's signals, in their order."""
    positions = [name for name in signals if name.startswith("qpos.")]
    found = []
    for quaternion in quaternions(signals):
        stem, _, part = quaternion[0].rpartition(".")
        joint = stem.removeprefix("qpos.")
        rates = tuple(f"qvel.{joint}.{int(part) + k}" for k in range(3))
        if set(rates) <= set(signals):
            found.append(Rotation(joint, quaternion, positions.index(quaternion[0]), rates))
    return tuple(sorted(found, key=lambda rotation: rotation.first))


def velocity(joint: str, signals: Sequence[str]) -> str | None:
    """The velocity signal of a joint coordinate such as ``hinge``, ``base.0`` or ``base.rx``; None without one."""
    if f"qvel.{joint}" in signals:
        return f"qvel.{joint}"
    stem, _, axis = joint.rpartition(".")
    if axis not in AXES:
        return None
    rates = [name for name in signals if name.startswith(f"qvel.{stem}.")]
    return rates[AXES.index(axis) - 3] if len(rates) in (3, 6) else None


def renamed(signals: Sequence[str], turning: Sequence[Rotation]) -> list[str]:
    """Signals with three turns in the place of each quaternion."""
    firsts = {one.quaternion[0]: one.turns for one in turning}
    gone = {name for one in turning for name in one.quaternion}
    return [new for name in signals for new in firsts.get(name, () if name in gone else (name,))]
