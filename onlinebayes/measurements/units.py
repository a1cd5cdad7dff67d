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
SPELT = {
    **dict.fromkeys(("°", "degree", "degs"), "deg"),
    **dict.fromkeys(("radian", "rads"), "rad"),
    **dict.fromkeys(("turn", "revolution", "rotation"), "rev"),
    **dict.fromkeys(("metre", "meter"), "m"),
    **dict.fromkeys(("centimetre", "centimeter"), "cm"),
    **dict.fromkeys(("millimetre", "millimeter"), "mm"),
    **dict.fromkeys(("micrometre", "micrometer", "micron", "µm", "μm"), "um"),
    **dict.fromkeys(("second", "sec"), "s"),
    **dict.fromkeys(("millisecond", "msec"), "ms"),
    **dict.fromkeys(("microsecond", "usec", "µs", "μs"), "us"),
    **dict.fromkeys(("nanosecond", "nsec"), "ns"),
    **dict.fromkeys(("newton",), "N"),
    **dict.fromkeys(("newton metre", "newton meter", "newtonmetre", "newtonmeter"), "N m"),
    **dict.fromkeys(("volt",), "V"),
    **dict.fromkeys(("amp", "ampere"), "A"),
    **dict.fromkeys(("dps", "deg_s", "degps"), "deg/s"),
    **dict.fromkeys(("rps",), "rev/s"),
    **dict.fromkeys(("rad_s", "radps"), "rad/s"),
    **dict.fromkeys(("mps",), "m/s"),
}
"""A unit in other words -> as it is written here."""


def to_si(unit: str, wanted: str = "") -> float:
    """Return the factor that turns a value in ``unit`` into SI.

    Args:
        unit: e.g. ``"deg"``.
        wanted: the SI unit that must come out, e.g. ``"rad"``; any when empty.

    Raises:
        BadInput: a unit that is unknown or of another quantity.
    """
    if unit not in SI:
        meant = _meant(unit)
        fitting = [name for name, (si, _) in SI.items() if si == wanted] if wanted else SI
        cure = f"nearest: {meant}" if meant in fitting else nearest(unit, fitting or SI, most=2, cutoff=0.5)
        raise BadInput(f"unit '{unit}' is unknown", cure)
    found, factor = SI[unit]
    if wanted and found != wanted:
        known = ", ".join(name for name, (si, _) in SI.items() if si == wanted) or wanted
        raise BadInput(f"unit '{unit}' cannot become {wanted}", f"use one of {known}")
    return factor


def _meant(unit: str) -> str:
    """The unit that another word is meant for: ``Degrees``, ``rad per second``; empty where nobody knows."""
    whole, _, per = unit.strip().replace(" per ", "/").partition("/")
    known = {name.lower(): name for name in SI}

    def short(word: str) -> str:
        low = word.strip().lower()
        singular = low.removesuffix("s")
        return SPELT.get(low) or SPELT.get(singular) or known.get(low) or known.get(singular, "")

    found = short(whole) if whole else ""
    over = short(per.rstrip("2^")) if per else ""
    said = f"{found}/{over}{'2' if per.endswith('2') else ''}" if per else found
    return said if said in SI else ""
