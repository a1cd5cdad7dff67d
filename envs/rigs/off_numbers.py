"""Numbers of the engineer's model that are not the machine's: wrong ones, and passive terms that the machine lacks.

The machine stays what its equations say; what is off stands in the MJCF that the engineer hands over.

| number                                        | where it stands in the file     |
|-----------------------------------------------|---------------------------------|
| body.B.mass, body.B.ipos[k], body.B.inertia[k] | the body's ``inertial``        |
| body.B.pos[k]                                 | the body                        |
| joint.J.damping, .frictionloss, .stiffness, .armature | the joint               |
| actuator.A.gear[0], .kp, .kv                  | the actuator                    |
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

_INERTIAL = {"mass": "mass", "ipos": "pos", "inertia": "diaginertia"}
_DEFAULT = {"gear": "1"}  # of what a file may leave out; all else is nothing


@final
@dataclass(frozen=True)
class OffNumber:
    """A number of the engineer's model that is off.

    Args:
        key: its address in the model.
        law: the effect that would be off by as much, as criticism spells it.
        size: by how much the model exceeds the machine, at medium size [SI].
        fixed: parameters that must not be free, for they would make up for it.
    """

    key: str
    law: str
    size: float
    fixed: tuple[str, ...] = ()

    def factor(self, scale: float) -> float:
        """By what the medium size is multiplied at that scale."""
        return scale

    def resized(self, scale: float) -> OffNumber:
        """The same number with another medium size: ``scale`` times this one."""
        return replace(self, size=scale * self.size)


def number(xml: str, key: str) -> float:
    """A number of a model file; what is left out has its default."""
    element, attribute, place = _place(ElementTree.fromstring(xml), key)
    return _numbers(element, attribute, place)[place]


def with_number(xml: str, key: str, value: float) -> str:
    """The model file with another value of one number."""
    root = ElementTree.fromstring(xml)
    element, attribute, place = _place(root, key)
    values = _numbers(element, attribute, place)
    values[place] = value
    element.set(attribute, " ".join(f"{one:.9g}" for one in values))
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _place(root: Element, key: str) -> tuple[Element, str, int]:
    """The element, its attribute and the number's place in it."""
    kind, name, field, index = re.fullmatch(r"(\w+)\.(\w+)\.(\w+)(?:\[(\d)\])?", key).groups()  # type: ignore[union-attr]
    named = f".//*[@name='{name}']"
    element = next(one for one in root.iterfind(named) if _is(kind, one))
    if kind == "body" and field != "pos":
        inertial = element.find("inertial")
        element = element.find("geom") if inertial is None else inertial  # type: ignore[assignment]
        field = _INERTIAL[field]
    return element, field, int(index or 0)


def _is(kind: str, element: Element) -> bool:
    return element.tag == kind if kind != "actuator" else element.tag in ("motor", "position")


def _numbers(element: Element, attribute: str, place: int) -> list[float]:
    text = element.get(attribute, _DEFAULT.get(attribute, "0"))
    found = [float(one) for one in text.split()]
    return found + [0.0] * (place + 1 - len(found))
