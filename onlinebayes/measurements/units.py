"""Units that logs are written in, and what multiplies a value to bring it to SI."""

from __future__ import annotations

import math

from onlinebayes.runs import BadInput, nearest

SI = {
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "ns": ("s", 1e-9),
    "m": ("m", 1.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", math.pi / 180),
    "rev": ("rad", 2 * math.pi),
    "m/s": ("m/s", 1.0),
    "cm/s": ("m/s", 1e-2),
    "mm/s": ("m/s", 1e-3),
    "km/h": ("m/s", 1 / 3.6),
    "rad/s": ("rad/s", 1.0),
    "mrad/s": ("rad/s", 1e-3),
    "deg/s": ("rad/s", math.pi / 180),
    "rev/s": ("rad/s", 2 * math.pi),
    "rpm": ("rad/s", 2 * math.pi / 60),
    "m/s2": ("m/s2", 1.0),
    "m/s^2": ("m/s2", 1.0),
    "rad/s2": ("rad/s2", 1.0),
    "rad/s^2": ("rad/s2", 1.0),
    "deg/s2": ("rad/s2", math.pi / 180),
    "N": ("N", 1.0),
    "mN": ("N", 1e-3),
    "kN": ("N", 1e3),
    "N m": ("N m", 1.0),
    "Nm": ("N m", 1.0),
    "mN m": ("N m", 1e-3),
    "mNm": ("N m", 1e-3),
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "A": ("A", 1.0),
    "mA": ("A", 1e-3),
}
"""unit -> (its SI unit, factor)."""


def to_si(unit: str, wanted: str = "") -> float:
    """Return the factor that turns a value in ``unit`` into SI.

    Args:
        unit: e.g. ``"deg"``.
        wanted: the SI unit that must come out, e.g. ``"rad"``; any when empty.

    Raises:
        BadInput: a unit that is unknown or of another quantity.
    """
    if unit not in SI:
        raise BadInput(f"unit '{unit}' is unknown", nearest(unit, SI, most=2, cutoff=0.5))
    found, factor = SI[unit]
    if wanted and found != wanted:
        known = ", ".join(name for name, (si, _) in SI.items() if si == wanted) or wanted
        raise BadInput(f"unit '{unit}' cannot become {wanted}", f"use one of {known}")
    return factor
