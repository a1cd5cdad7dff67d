"""PX4 flight logs (ULog): every field of every topic as ``<topic>.<field>``, at the instant of its ``timestamp``.

A topic's further instances are ``<topic>_1``, ``<topic>_2``; of samples with one instant the last is kept. Time counts
from the first sample in the file. Source: https://docs.px4.io/main/en/dev_log/ulog_file_format. Needs the extra
``ulog``.
"""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.measurements.formats.series import Series, SeriesSource
from onlinebayes.measurements.formats.source import check_cells
from onlinebayes.runs import BadInput

MAGIC = b"ULog\x01\x125"
CLOCK = "timestamp"


def ulog_source(path: Path) -> SeriesSource:
    """The numbers of a flight log.

    Raises:
        BadInput: it is damaged, holds no topic, is far too large, or the extra is missing.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise BadInput(
            "reading ULog needs pyulog",
            "install the extra ulog (pip install -e '.[ulog]' in the repository), or save the log as CSV (ulog2csv)",
            where=str(path),
        ) from None
    check_cells(path.stat().st_size // 16, 1, path)
    try:
        topics = ULog(str(path), disable_str_exceptions=True).data_list
        series = {name: one for topic in topics for name, one in _series(topic).items()}
    except Exception as error:  # what damaged bytes raise inside pyulog is not documented
        problem = f"is a damaged ULog file: {type(error).__name__} {str(error)[:200]}"
        raise BadInput(problem, "record it again", where=str(path)) from None
    if not series:
        raise BadInput("no topic was logged", "record with the logger running", where=str(path))
    return SeriesSource(path, series)


def _series(topic: Any) -> dict[str, Series]:
    """Column -> samples of one topic."""
    name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
    clock = topic.data[CLOCK].astype(np.int64) * 1000
    last = np.append(clock[1:] != clock[:-1], True)
    instants = array("q", clock[last].tobytes())
    return {
        f"{name}.{field}": Series(instants, array("d", values[last].astype(np.float64).tobytes()))
        for field, values in topic.data.items()
        if field != CLOCK and values.dtype.kind in "fiub"
    }
