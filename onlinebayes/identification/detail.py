"""The error in detail, as frozen values: window by window, by the time since their start, by what the machine did.

Nothing is decided by these: they show a reader what the figures of ``results.py`` are averages of. They are made from
the replays by ``heldout.py`` (windows, horizons) and ``profiles.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Quantity = Literal["time", "position", "velocity", "direction", "reversal", "command", "run"]


@dataclass(frozen=True)
class WindowError:
    """Error of one signal in one window.

    Args:
        signal: its name.
        run, window: which window; ``window`` counts within the run.
        held_out: whether the run was kept from the fit.
        start: instant of its first row [s].
        before, after: RMS of measured - simulated, base and final model [the signal's unit]; inf where it diverged.
    """

    signal: str
    run: str
    window: int
    held_out: bool
    start: float
    before: float
    after: float


@dataclass(frozen=True)
class HorizonError:
    """Error of one signal against the time for which the model has run freely, over the held-out windows.

    Args:
        signal: its name.
        time: since the window's start, the middle of each bin [s].
        before, after: RMS over windows and the bin's rows, base and final model [the signal's unit].
        floor: what sensor noise and the starts' uncertainty give a perfect model there [the signal's unit].
    """

    signal: str
    time: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    floor: tuple[float, ...]


@dataclass(frozen=True)
class Profile:
    """The distribution of the squared error of one signal over one quantity, over all runs.

    Args:
        signal: whose error.
        quantity: the kind of quantity.
        name: what is binned, e.g. ``"qvel.carriage"``.
        unit: of the edges; empty for categories.
        edges: of the n bins, n + 1 of them; empty for categories.
        labels: of the n categories; empty for bins.
        time: share of the rows in each bin, sums to 1.
        before: share of the base model's squared error in each bin, sums to 1.
        after: the final model's squared error in each bin as a share of the base model's whole, so that its sum is
            what is left.
    """

    signal: str
    quantity: Quantity
    name: str
    unit: str
    edges: tuple[float, ...]
    labels: tuple[str, ...]
    time: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]

    @property
    def concentration(self) -> float:
        """Half the sum of |share of error - share of time|: 0 where error is everywhere alike, 1 at the most."""
        return sum(abs(b - t) for b, t in zip(self.before, self.time, strict=True)) / 2


@dataclass(frozen=True)
class Detail:
    """The error in detail; empty where nothing was replayed."""

    windows: tuple[WindowError, ...] = ()
    horizons: tuple[HorizonError, ...] = ()
    profiles: tuple[Profile, ...] = ()
