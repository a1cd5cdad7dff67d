"""Rerun recordings (``.rrd``): the scalars of every entity, as columns by entity path.

| in the recording              | column                                                     |
|-------------------------------|------------------------------------------------------------|
| ``Scalars`` of one value      | the entity's path with its slash, e.g. ``/qpos/hinge``     |
| ``Scalars`` of several values | ``/joints[0]``, ``/joints[1]``, ...                        |
| a timeline of times           | ``time``                                                   |

The timeline is the one called ``time``, else the only one of durations or timestamps besides ``log_time``, else that.
Source of the format: https://rerun.io/docs.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.measurements.formats.rrd_chunks import ENTITY, UNREADABLE
from onlinebayes.measurements.formats.series import Recorder, SeriesSource
from onlinebayes.runs import BadInput

SCALARS = "rerun.components.Scalar"
LONGEST = 256


def rrd_source(path: Path) -> SeriesSource:
    """The scalars of a recording.

    Raises:
        BadInput: it is damaged, holds no scalars, or its timelines leave open which one is the time.
    """
    try:
        batches = _scalar_batches(path)
        line = _timeline(batches, path)
        recorder = Recorder(path)
        for entity, batch in batches:
            if line in batch.schema.names:
                _record(recorder, entity, batch, line)
    except BadInput:
        raise
    except Exception as error:  # the Rust reader raises RuntimeError, Arrow whatever the bytes make it meet
        problem = f"is a damaged Rerun recording: {' '.join(str(error).split())[:200]}"
        raise BadInput(problem, "record it again ('rerun rrd verify' says more)", where=str(path)) from None
    return SeriesSource(path, {name: recorder.series[name] for name in sorted(recorder.series)})


def _scalar_batches(path: Path) -> list[tuple[str, Any]]:
    """(entity path, Arrow batch) of each chunk with scalars that has a time at all."""
    found = [(entity, batch) for entity, batch in _batches(path) if any(_scalars(batch))]
    if not found:
        raise BadInput("no entity has scalars over time", "log rerun.Scalars on a timeline", where=str(path))
    return found


def _batches(path: Path) -> Iterator[tuple[str, Any]]:
    """Every chunk that is not static, read by a process of its own; see :mod:`.rrd_chunks`."""
    import pyarrow as pa

    program = [sys.executable, "-P", str(Path(__file__).with_name("rrd_chunks.py")), str(path.resolve())]
    # In a process group of its own Ctrl-C does not reach it: the reading is ended from here.
    read = subprocess.run(program, capture_output=True, stdin=subprocess.DEVNULL, process_group=0, check=False)
    if read.returncode == UNREADABLE:
        raise RuntimeError(read.stderr.decode(errors="replace"))
    if read.returncode:
        raise RuntimeError("its reader stopped at what it holds")
    source = pa.BufferReader(read.stdout)
    while source.tell() < source.size():
        stream = pa.ipc.open_stream(source)
        entity = stream.schema.metadata[ENTITY].decode()
        for batch in stream:
            batch.validate(full=True)
            yield entity, batch


def _timeline(batches: list[tuple[str, Any]], path: Path) -> str:
    import pyarrow as pa

    lines = {
        field.name
        for _, batch in batches
        for field in batch.schema
        if (field.metadata or {}).get(b"rerun:kind") == b"index"
        and (pa.types.is_duration(field.type) or pa.types.is_timestamp(field.type))
    }
    if "time" in lines:
        return "time"
    own = sorted(lines - {"log_time"})
    if len(own) > 1:
        problem = f"several timelines could be the time: {', '.join(own)}"
        raise BadInput(problem, "call the one that counts 'time'", where=str(path))
    if not own and not lines:
        problem = "no timeline counts seconds"
        raise BadInput(problem, "log with rerun.set_time('time', duration=..)", where=str(path))
    return own[0] if own else "log_time"


def _scalars(batch: Any) -> Iterator[str]:
    for field in batch.schema:
        if (field.metadata or {}).get(b"rerun:component_type") == SCALARS.encode():
            yield field.name


def _record(recorder: Recorder, entity: str, batch: Any, line: str) -> None:
    instants = np.asarray(batch.column(line).cast("int64")).tolist()
    for name in _scalars(batch):
        for instant, values in zip(instants, batch.column(name).to_pylist(), strict=True):
            for k, value in enumerate((values or [])[:LONGEST]):
                column = entity if len(values) == 1 else f"{entity}[{k}]"
                if value is not None and instant is not None:
                    recorder.add(column, int(instant), value)
