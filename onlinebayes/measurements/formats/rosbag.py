"""ROS 2 bags: a folder with ``metadata.yaml``, or one of its files, in SQLite (``.db3``) or MCAP, messages in CDR.

    topics(id, name, type, serialization_format),   messages(topic_id, timestamp, data),   message_definitions(...)

Columns and instants are those of :mod:`.messages`. A bag that was split into several files is one run. SQLite is opened
for reading only. Source of the tables: https://github.com/ros2/rosbag2. Needs the extra ``ros``.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from onlinebayes.measurements.formats.cdr import MISSING, Decoder, cdr_decoder
from onlinebayes.measurements.formats.mcap import LARGEST, read_mcap
from onlinebayes.measurements.formats.messages import record
from onlinebayes.measurements.formats.series import Recorder, SeriesSource
from onlinebayes.runs import BadInput

SQLITE = b"SQLite format 3\0"
METADATA = "metadata.yaml"
MOST_FILES = 10_000


def is_bag(folder: Path) -> bool:
    """Check whether a folder is a bag."""
    return (folder / METADATA).is_file()


def bag_source(path: Path) -> SeriesSource:
    """The numbers of a bag, a folder or one SQLite file.

    Raises:
        BadInput: it is damaged, packed, has no topic that can be read, or the extra is missing.
    """
    recorder = Recorder(path)
    unreadable: set[str] = set()
    for file in _files(path):
        unreadable |= _read(file, recorder) if file.suffix != ".mcap" else read_mcap(file, recorder)
    if not recorder.series:
        seen = ", ".join(sorted(unreadable))[:200]
        raise BadInput(
            f"no topic holds numbers that can be read{f' (there are {seen})' if seen else ''}",
            "record JointState, Imu, Odometry or arrays, or write a CSV table",
            where=str(path),
        )
    return SeriesSource(path, recorder.tied())


def _files(path: Path) -> list[Path]:
    """The bag's files in the order in which they were written: ``_2`` before ``_10``."""
    if not path.is_dir():
        return [path]
    files = [file for file in path.iterdir() if file.suffix in (".db3", ".mcap")]
    if not files:
        packed = [file.name for file in path.iterdir() if file.suffix == ".zstd"]
        problem = f"its files are packed ({packed[0]})" if packed else "a bag without .db3 or .mcap files"
        raise BadInput(problem, "unpack it ('ros2 bag convert'), or record it again", where=str(path))
    if len(files) > MOST_FILES:
        raise BadInput(f"more than {MOST_FILES} files", "cut the bag", where=str(path))
    for file in files:
        if not file.resolve().is_relative_to(path.resolve()):
            raise BadInput(f"is a link to {file.resolve()}, outside the bag", "copy the file into it", where=str(file))
    return sorted(files, key=lambda file: (len(file.name), file.name))


def _read(path: Path, recorder: Recorder) -> set[str]:
    """Record every message of an SQLite file; returns the types that were left out."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as base:
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
            return _record(base, path, recorder)
    except BadInput:
        raise
    except ImportError:
        raise BadInput("reading a ROS 2 bag needs rosbags", MISSING, where=str(path)) from None
    except Exception as error:  # damaged bytes raise whatever SQLite or the CDR reader meets first
        problem = f"is a damaged ROS 2 bag: {type(error).__name__} {str(error)[:200]}"
        raise BadInput(problem, "record it again, or write a CSV table", where=str(path)) from None


def _record(base: sqlite3.Connection, path: Path, recorder: Recorder) -> set[str]:
    tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {"topics", "messages"} <= tables:
        raise BadInput("is an SQLite file, but no ROS 2 bag", "name a bag, or write a CSV table", where=str(path))
    texts: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        found = base.execute("SELECT topic_type, encoded_message_definition, encoding FROM message_definitions")
        texts = {kind: (text, encoding) for kind, text, encoding in found if text}
    topics: dict[int, tuple[str, Decoder]] = {}
    left_out = set()
    for number, name, kind, packing in base.execute("SELECT id, name, type, serialization_format FROM topics"):
        decode = cdr_decoder(kind, *texts.get(kind, ())) if packing == "cdr" else None
        if decode is None:
            left_out.add(f"{packing} {kind}")
        else:
            topics[number] = (name, decode)
    wanted = ", ".join(map(str, topics)) or "NULL"
    rows = base.execute(
        f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({wanted}) ORDER BY timestamp, id"
    )
    for number, logged, data in rows:
        name, decode = topics[number]
        record(recorder, name, decode(data), logged)
    return left_out
