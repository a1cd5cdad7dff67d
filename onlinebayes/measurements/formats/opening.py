"""Detection of a path's format by its first bytes: the name of a file proves nothing.

| begins with          | format                                                     |
|----------------------|------------------------------------------------------------|
| a folder             | ROS 2 bag (it has ``metadata.yaml``), LeRobot data set     |
| ``SQLite format 3``  | ROS 2 bag                                                  |
| ``ULog``             | PX4 flight log                                             |
| ``PAR1``             | Parquet                                                    |
| ``\\x89MCAP0\\r\\n``    | MCAP                                                       |
| ``RRF``              | Rerun recording                                            |
| else                 | CSV                                                        |
"""

from __future__ import annotations

from pathlib import Path

from onlinebayes.measurements.formats.delimited import CsvSource
from onlinebayes.measurements.formats.lerobot import lerobot_source
from onlinebayes.measurements.formats.mcap import mcap_source
from onlinebayes.measurements.formats.parquet import ParquetSource
from onlinebayes.measurements.formats.rosbag import SQLITE, bag_source, is_bag
from onlinebayes.measurements.formats.rrd import rrd_source
from onlinebayes.measurements.formats.source import Source
from onlinebayes.measurements.formats.ulog import MAGIC, ulog_source
from onlinebayes.runs import BadInput

NAMED = {".parquet": "Parquet", ".pq": "Parquet", ".mcap": "MCAP", ".rrd": "Rerun", ".db3": "SQLite", ".ulg": "ULog"}
PACKED = {
    b"\x1f\x8b": "packed by gzip",
    b"PK\x03\x04": "a ZIP archive (as .xlsx is)",
    b"BZh": "packed by bzip2",
    b"\xfd7zXZ": "packed by xz",
    b"\x28\xb5\x2f\xfd": "packed by zstd",
    b"\x89HDF\r\n": "an HDF5 file",
}
"""First bytes of files that hold a table and are not read."""

_CURE = "name a CSV, Parquet, MCAP, ULog or Rerun file, a ROS 2 bag, or the folder of a LeRobot data set"


def open_source(path: Path) -> Source:
    """The file's columns.

    Raises:
        BadInput: it is missing, cannot be read, or is in none of the formats.
    """
    try:
        if path.is_dir():
            if is_bag(path):
                return bag_source(path)
            return lerobot_source(path)
        if not path.exists():
            raise BadInput("no such file", "check its path", where=str(path))
        if not path.is_file():
            raise BadInput("is not a file", _CURE, where=str(path))
        with path.open("rb") as file:
            start = file.read(len(SQLITE))
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", _CURE, where=str(path)) from None
    if start.startswith(b"PAR1"):
        return ParquetSource(path)
    if start.startswith(b"\x89MCAP0\r\n"):
        return mcap_source(path)
    if start == SQLITE:
        return bag_source(path)
    if start.startswith(MAGIC):
        return ulog_source(path)
    if start.startswith(b"RRF"):
        return rrd_source(path)
    if not start:
        raise BadInput("the file is empty", "give a header and at least two rows", where=str(path))
    if (called := NAMED.get(path.suffix.lower())) is not None:
        raise BadInput(
            f"is not a{'n' if called in ('MCAP', 'SQLite') else ''} {called} file",
            "write it again, or name a CSV file .csv",
            where=str(path),
        )
    if packed := next((kind for mark, kind in PACKED.items() if start.startswith(mark)), ""):
        raise BadInput(f"the file is {packed}", "give the table in it as CSV or Parquet", where=str(path))
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise BadInput("the file is UTF-16", "save it as UTF-8", where=str(path))
    return CsvSource(path)
