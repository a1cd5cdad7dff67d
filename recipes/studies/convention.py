"""A header of a log beside a model's joints and actuators, and which column each name of the model is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from onlinebayes.problems.drafting import proposed
from onlinebayes.simulators.mujoco import MujocoSimulator

Drive = Literal["position", "motor", "velocity"]
FREE = "free:"
Verdict = Literal["rightly", "in part", "not at all", "wrongly"]


@dataclass(frozen=True)
class Convention:
    """How somebody names columns.

    Args:
        who: writes so.
        joints: of the model, hinges in a chain; ``free:`` before a name for a free joint.
        drive: its actuators.
        actuators: their names; the joints' by default.
        right: name of the model -> column.
        beside: columns that are nobody's.
    """

    who: str
    joints: Sequence[str]
    drive: Drive
    right: Mapping[str, str]
    beside: Sequence[str] = ()
    actuators: Sequence[str] = ()

    def xml(self) -> str:
        """A chain of bodies with these joints and actuators, as MJCF; what floats without joints has rotors."""
        driven = [joint for joint in self.joints if not joint.startswith(FREE)]
        tags = [
            f'<joint name="{joint}"/>' if joint in driven else f'<freejoint name="{joint.removeprefix(FREE)}"/>'
            for joint in self.joints
        ]
        chain = "".join(f'<body pos="0 0 .1">{tag}<site name="{k}"/><geom size=".1"/>' for k, tag in enumerate(tags))
        gain = {"position": 'kp="10"', "velocity": 'kv="1"', "motor": ""}[self.drive]
        joints = driven or [""] * len(self.actuators)
        at = [
            f'{self.drive} {gain} joint="{joint}"' if joint else 'motor site="0" gear="0 0 1 0 0 0"' for joint in joints
        ]
        acts = "".join(f'<{one} name="{name}"/>' for one, name in zip(at, self.actuators or driven, strict=True))
        bodies = f"<worldbody>{chain}{'</body>' * len(tags)}</worldbody>"
        return f"<mujoco>{bodies}<actuator>{acts}</actuator></mujoco>"

    def found(self) -> dict[str, str]:
        """What ``init`` proposes by names alone."""
        return proposed(MujocoSimulator(self.xml(), threads=1), self.columns)

    @property
    def columns(self) -> list[str]:
        """The header; what is beside stands between."""
        return [*self.beside[::2], *self.right.values(), *self.beside[1::2]]

    @property
    def verdict(self) -> Verdict:
        """Matched rightly (all of it), in part, not at all; wrongly as soon as one column is."""
        found = self.found()
        if any(self.right.get(name) != column for name, column in found.items()):
            return "wrongly"
        return "rightly" if len(found) == len(self.right) else "in part" if found else "not at all"
