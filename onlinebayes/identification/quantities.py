"""Numbers as a reader wants them: a prefix that suits the size, digits that suit the uncertainty, always a unit.

    0.0066 m  ->  6.6 mm          22.04 +- 0.93 N  ->  22.0 ± 0.9 N          2.3e-05 N m  ->  2.3e-5 N m

Prefixes are given only to units where they are usual (mm, mrad, ms; not mN s/m), so that a reader can type the number
back into a model without error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_THOUSANDS = ((1e-9, "n"), (1e-6, "µ"), (1e-3, "m"), (1.0, ""))
_PREFIXED = ("m", "rad", "s", "m/s", "rad/s", "V", "A")
_MISSING = "–"
LEAST_SHOWN, MOST_SHOWN = 0.02, 1e5
"""Numbers that share a unit are written between these, where one prefix can do that for all."""
MEANINGLESS_BELOW = 1e-13
"""SI value below which no parameter of a machine means anything."""
_EXPONENT = re.compile(r"(?<=[a-z])[23]\b")
_RAISED = {"2": "²", "3": "³"}


@dataclass(frozen=True)
class Scale:
    """A display unit: ``shown = value / size`` in ``unit``.

    Args:
        size: SI value of one display unit.
        unit: how the display unit is written; empty for a pure number.
        base: the SI unit it stands for.
    """

    size: float
    unit: str
    base: str = ""

    def number(self, value: float, digits: int = 2) -> str:
        """``value`` in this unit with ``digits`` significant digits, without the unit."""
        return significant(value / self.size, digits)

    def text(self, value: float | None, digits: int = 2) -> str:
        """``value`` in this unit with the unit behind it; a dash where there is none."""
        if value is None or not math.isfinite(value):
            return _MISSING
        return f"{self.number(value, digits)} {self.unit}".strip()


def scale_for(size: float, unit: str) -> Scale:
    """The display unit in which ``size`` [unit] reads best: between 0.1 and 1000 where a prefix is usual."""
    if unit not in _PREFIXED or not math.isfinite(size) or size == 0:
        return Scale(1.0, _EXPONENT.sub(lambda found: _RAISED[found.group()], unit), unit)
    fitting = [(factor, prefix) for factor, prefix in _THOUSANDS if abs(size) >= 0.999 * factor]
    factor, prefix = fitting[-1] if fitting else _THOUSANDS[0]
    return Scale(factor, prefix + unit, unit)


def shared_scale(values: Iterable[float], unit: str) -> Scale:
    """The one display unit for numbers that stand side by side to be compared: ``4100 mrad`` and ``4.6 mrad``.

    That of the largest; a finer one where the smallest would be all zeros in it.
    """
    sizes = sorted(abs(value) for value in values if math.isfinite(value) and value != 0)
    if not sizes:
        return scale_for(0.0, unit)
    scale = scale_for(sizes[-1], unit)
    while sizes[0] < LEAST_SHOWN * scale.size:
        finer = scale_for(scale.size / 1000, unit)
        if finer.size >= scale.size or sizes[-1] >= MOST_SHOWN * finer.size:
            break
        scale = finer
    return scale


def texts(values: Sequence[float], unit: str) -> list[str]:
    """``values`` [unit], all in one display unit."""
    scale = shared_scale(values, unit)
    return [scale.text(value) for value in values]


def text(value: float | None, unit: str, digits: int = 2) -> str:
    """``value`` [unit] in the display unit that suits it best."""
    if value is None or not math.isfinite(value):
        return _MISSING
    return scale_for(value, unit).text(value, digits)


def exact(value: float, unit: str) -> str:
    """``value`` as it was chosen by somebody: ``1 s``, ``300 ms``, without digits that mean nothing."""
    scale = scale_for(value, unit)
    return f"{value / scale.size:.6g} {scale.unit}".strip()


def with_error(mean: float, sd: float, unit: str) -> str:
    """``mean ± sd unit``, both to the last digit that the sd decides (two digits of it where they start with 1)."""
    if not (math.isfinite(mean) and math.isfinite(sd)):
        return _MISSING
    if max(abs(mean), sd) < MEANINGLESS_BELOW:  # rounding, of what lies at a bound of zero
        return f"0 {scale_for(0.0, unit).unit}".strip()
    if sd <= 0:
        return text(mean, unit, 4)
    scale = scale_for(max(abs(mean), sd), unit)
    mean, sd = mean / scale.size, sd / scale.size
    if not 1e-4 <= max(abs(mean), sd) < 1e6:
        exponent = math.floor(math.log10(max(abs(mean), sd)))
        inner = f"({_fixed(mean / 10**exponent, sd / 10**exponent)})"
        return f"{inner}e{exponent} {scale.unit}".strip()
    return f"{_fixed(mean, sd)} {scale.unit}".strip()


def interval(low: float, high: float, unit: str) -> str:
    """``92.6 to 97.4 kg``, with as many digits as tell the ends apart."""
    (first, last), unit = apart((low, high), high - low, unit)
    return f"{first} to {last} {unit}".strip()


def apart(values: Sequence[float], width: float, unit: str) -> tuple[list[str], str]:
    """``values`` [unit] in one display unit, with as many digits as tell two apart that lie ``width`` apart."""
    largest = max(abs(value) for value in values)
    scale = scale_for(largest, unit)
    digits = 3 if not 0 < width < largest else max(3, math.ceil(math.log10(largest / width)) + 2)
    return [scale.number(value, digits) for value in values], scale.unit


def significant(value: float, digits: int = 2) -> str:
    """``value`` with so many significant digits; whole numbers keep theirs, tiny and huge ones get an exponent."""
    if not math.isfinite(value):
        return _MISSING
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -4 <= exponent < 6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(power)}"
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def times(ratio: float) -> str:
    """``3.3 times``, ``33 times``, ``over 1000 times``."""
    return "over 1000 times" if ratio >= 1000 else f"{significant(ratio)} times"


def percent(share: float) -> str:
    """A share in 0..1 as whole percent, "<1 %" where that would read as nothing."""
    if not math.isfinite(share):
        return _MISSING
    return "<1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %".replace("-", "−")


def _fixed(mean: float, sd: float) -> str:
    exponent = math.floor(math.log10(sd))
    digits = -exponent + (1 if sd / 10**exponent < 1.95 else 0)
    if digits < 0:
        mean, sd = round(mean, digits), round(sd, digits)
    return f"{mean:.{max(digits, 0)}f} ± {sd:.{max(digits, 0)}f}"
