"""A measurement as it would read without the latency of some of its signals.

    y'(t - L) = y(t),      on the rows of the table; see :func:`onlinebayes.measurements.latency.advanced`
    L(t) = at_zero + rate t      of a clock that drifts, with t on the measurements' clock

A log written late is mended so, and the starts of a late sensor's windows are read so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch

from onlinebayes.measurements import Measurement
from onlinebayes.measurements.latency import advanced


@dataclass(frozen=True)
class Lag:
    """A latency that grows steadily.

    Args:
        at_zero: at instant 0 of the measurements' clock [s].
        rate: of its growth [s/s].
    """

    at_zero: float
    rate: float = 0.0

    def plus(self, other: Lag) -> Lag:
        """Both together."""
        return Lag(self.at_zero + other.at_zero, self.rate + other.rate)


def without_latency(measurement: Measurement, latency: Mapping[str, float | Lag]) -> Measurement:
    """The measurement with these signals as they would read without a latency.

    Args:
        measurement: the runs.
        latency: signal -> by how much it is late, negative where it runs ahead [s].
    """
    lags = {name: lag if isinstance(lag, Lag) else Lag(lag) for name, lag in latency.items()}
    known = [signal.name for signal in measurement.signals]
    data = measurement.data.clone(recurse=False)
    data["signal"], data["measured"] = data["signal"].clone(), data["measured"].clone()
    for r, rows in enumerate(measurement.lengths.tolist()):
        time = data["time"][r, :rows].cpu().numpy()
        for name, lag in lags.items():
            s = known.index(name)
            values = torch.where(data["measured"][r, :rows, s], data["signal"][r, :rows, s], torch.nan)
            late = lag.at_zero + lag.rate * time
            put_back = torch.as_tensor(advanced(time, values.cpu().numpy(), late)).to(values)
            seen = torch.isfinite(put_back)
            data["measured"][r, :rows, s] = seen
            data["signal"][r, :rows, s] = torch.where(seen, put_back, torch.zeros_like(put_back))
    return replace(measurement, data=data)
