"""A measurement as it would read without the latency of some of its signals.

    y'(t) = y(t + L),      on the rows of the table; see :func:`onlinebayes.measurements.latency.advanced`

A log written late is mended so, and the starts of a late sensor's windows are read so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch

from onlinebayes.measurements import Measurement
from onlinebayes.measurements.latency import advanced


def without_latency(measurement: Measurement, latency: Mapping[str, float]) -> Measurement:
    """The measurement with these signals as they would read without a latency.

    Args:
        measurement: the runs.
        latency: signal -> by how much it is late, negative where it runs ahead [s].
    """
    known = [signal.name for signal in measurement.signals]
    data = measurement.data.clone(recurse=False)
    data["signal"], data["measured"] = data["signal"].clone(), data["measured"].clone()
    for r, rows in enumerate(measurement.lengths.tolist()):
        time = data["time"][r, :rows].cpu().numpy()
        for name, seconds in latency.items():
            s = known.index(name)
            values = torch.where(data["measured"][r, :rows, s], data["signal"][r, :rows, s], torch.nan)
            put_back = torch.as_tensor(advanced(time, values.cpu().numpy(), seconds)).to(values)
            seen = torch.isfinite(put_back)
            data["measured"][r, :rows, s] = seen
            data["signal"][r, :rows, s] = torch.where(seen, put_back, torch.zeros_like(put_back))
    return replace(measurement, data=data)
