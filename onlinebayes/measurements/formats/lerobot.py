"""LeRobot data sets: a folder of ``meta/info.json`` and Parquet files under ``data/``; each episode is a run.

| in the data set                          | here                                                  |
|------------------------------------------|-------------------------------------------------------|
| ``episode_index`` 3 of the folder ``a``  | run ``a-000003``                                      |
| ``timestamp`` [s]                        | ``time``                                              |
| ``observation.state``, ``action``, ...   | ``<feature>[<name>]``, ``<feature>[0]`` where unnamed |
| features of one number                   | ``<feature>``                                         |

Versions 2.x write one file an episode, 3.x several episodes a file; both are read by the columns, not by the files'
names. Source: https://huggingface.co/docs/lerobot. Needs the extra ``parquet``.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.measurements.formats.parquet import is_numeric, open_parquet, read_parquet
from onlinebayes.measurements.formats.source import MOST_CELLS, ArraySource, check_cells
from onlinebayes.runs import BadInput

LARGEST_INFO = 16 * 2**20
MOST_FILES = 100_000
LONGEST = 256
"""Parts of a feature; what has more is an image or a scan."""

VERSION = re.compile(r"v?[23](?!\d)")

EPISODE, TIME = "episode_index", "timestamp"
OTHER = ("frame_index", "index", "task_index", "time", "run")
"""Features that are no quantity, or have the name of what a row is placed by: its clock and its episode."""


def lerobot_source(folder: Path) -> ArraySource:
    """Every episode of a data set.

    Raises:
        BadInput: the folder is no data set of version 2 or 3, a file is damaged or lies elsewhere (a link out of the
            folder), a feature is not as ``meta/info.json`` says, or pyarrow is missing.
    """
    features = _features(folder)
    files = _files(folder)
    parts: dict[str, list[np.ndarray]] = {}
    cells = 0
    for path in files:
        columns = _columns(path, features)
        if parts and columns.keys() != parts.keys():
            problem = f"has other columns than {files[0]}"
            raise BadInput(problem, "write the same features into every file", where=str(path))
        cells += sum(map(len, columns.values()))
        check_cells(cells, 1, folder)
        for name, column in columns.items():
            parts.setdefault(name, []).append(column)
    whole = {name: np.concatenate(pieces) for name, pieces in parts.items()}
    episodes = whole.pop(EPISODE)
    order = np.argsort(episodes, kind="stable")  # rows of an episode may be spread over files
    stem = folder.resolve().name
    numbers, places = np.unique(episodes[order], return_inverse=True)
    runs = np.array([f"{stem}-{int(number):06d}" for number in numbers], dtype=object)[places]
    values: dict[str, np.ndarray] = {"run": runs, "time": whole.pop(TIME)[order]}
    return ArraySource(folder, values | {name: column[order] for name, column in whole.items()})


def _features(folder: Path) -> dict[str, list[str] | None]:
    """Feature -> names of its parts, None for a single number; only features of numbers with at most one axis."""
    path = folder / "meta" / "info.json"
    if not path.is_file():
        raise BadInput(
            "is a folder without meta/info.json", "name a table, or the folder of a LeRobot data set", where=str(folder)
        )
    _check_inside(path, folder)
    if path.stat().st_size > LARGEST_INFO:
        raise BadInput(f"has {path.stat().st_size} bytes", "describe the features only", where=str(path))
    try:
        info = json.loads(path.read_bytes())
    except (ValueError, RecursionError, OSError) as error:
        raise BadInput(f"is not JSON: {str(error)[:100]}", "write the data set again", where=str(path)) from None
    features = info.get("features") if isinstance(info, dict) else None
    version = str(info.get("codebase_version", "")) if isinstance(info, dict) else ""
    if not isinstance(features, dict):
        raise BadInput("describes no features", "write the data set again with LeRobot", where=str(path))
    if not VERSION.match(version):
        cure = "versions 2.x and 3.x can be: convert it with LeRobot's scripts"
        raise BadInput(f"codebase_version '{version[:20]}' cannot be read", cure, where=str(path))
    return {name: _parts(name, one, path) for name, one in features.items() if _is_numeric(name, one)}


def _is_numeric(name: str, feature: Any) -> bool:
    if name in (EPISODE, TIME, *OTHER) or not isinstance(feature, dict):
        return False
    shape = feature.get("shape", [1])
    kind = str(feature.get("dtype", ""))
    small = isinstance(shape, list) and (not shape or (len(shape) == 1 and _at_most(shape[0], LONGEST)))
    return small and kind.startswith(("float", "int", "uint", "bool"))


def _at_most(count: Any, most: int) -> bool:
    return isinstance(count, int) and not isinstance(count, bool) and 0 < count <= most


def _parts(name: str, feature: dict[str, Any], path: Path) -> list[str] | None:
    """The names of a feature's parts: a list, or one list under a key such as ``motors``, else numbers."""
    shape, names = feature.get("shape") or [1], feature.get("names")
    count = shape[0]
    if isinstance(names, dict) and len(names) == 1:
        names = next(iter(names.values()))
    if not isinstance(names, list) or not all(isinstance(part, str) for part in names):
        return None if count == 1 else [str(k) for k in range(count)]
    if len(names) != count:
        problem = f"feature '{name[:80]}' has {len(names)} names and the shape {shape}"
        raise BadInput(problem, "name each part once", where=str(path))
    return names


def _files(folder: Path) -> list[Path]:
    files = []
    for path in (folder / "data").rglob("*.parquet"):
        _check_inside(path, folder)
        files.append(path)
        if len(files) > MOST_FILES:
            raise BadInput(f"more than {MOST_FILES} files", "cut the data set", where=str(folder))
    if not files:
        raise BadInput("no Parquet file under data/", "name the data set's own folder", where=str(folder))
    return sorted(files)


def _check_inside(path: Path, folder: Path) -> None:
    if not path.resolve().is_relative_to(folder.resolve()):
        problem = f"is a link to {path.resolve()}, outside the data set"
        raise BadInput(problem, "copy the file into the folder", where=str(path))


def _columns(path: Path, features: dict[str, list[str] | None]) -> dict[str, np.ndarray]:
    """One file's columns: the episode, the time, and every part of every feature that it has."""
    stored = open_parquet(path).schema_arrow.names
    for name in (EPISODE, TIME):
        if name not in stored:
            raise BadInput(f"no column '{name}'", "write the data set again", where=str(path))
    wanted = [EPISODE, TIME, *(name for name in features if name in stored)]
    if len(set(stored)) != len(stored):
        raise BadInput("two columns share a name", "write the data set again", where=str(path))
    table = read_parquet(path, wanted)
    columns: dict[str, np.ndarray] = {}
    for name in wanted:
        parts = features.get(name)
        values = _matrix(table.column(name), name, 1 if parts is None else len(parts), path)
        labels = [name] if parts is None else [f"{name}[{part}]" for part in parts]
        if repeated := [label for label in labels if label in columns or labels.count(label) > 1]:
            raise BadInput(f"'{repeated[0][:80]}' stands twice", "name each part once", where=str(path))
        columns.update(zip(labels, values.T, strict=True))
    if np.isnan(columns[EPISODE]).any() or (np.abs(columns[EPISODE]) > MOST_CELLS).any():
        raise BadInput("an episode_index is no number of an episode", "write the data set again", where=str(path))
    return columns


def _matrix(column: Any, name: str, parts: int, path: Path) -> np.ndarray:
    """(rows, parts) as float64; nan where a value is null."""
    import pyarrow as pa

    where, kind = f"{path}, column '{name[:80]}'", column.type
    if pa.types.is_null(kind):
        return np.full((len(column), parts), np.nan)
    flat = column.combine_chunks()
    if isinstance(flat, pa.ChunkedArray):
        flat = pa.concat_arrays(flat.chunks) if flat.num_chunks else pa.array([], kind)
    if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        lengths = flat.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
        if (wrong := np.flatnonzero(lengths != parts)).size:
            raise BadInput(
                f"a list of {lengths[wrong[0]]} values where meta/info.json says {parts}",
                "write the data set again",
                where=f"{where}, row {wrong[0] + 1}",
            )
        flat = flat.flatten()
    kind = flat.type
    if not is_numeric(kind):
        raise BadInput(f"the column holds {kind}, not numbers", "write the data set again", where=where)
    if pa.types.is_boolean(kind):
        flat = flat.cast(pa.int8())
    values = flat.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    if len(values) != len(column) * parts:
        raise BadInput(
            f"{len(values)} values in {len(column)} rows of {parts}", "write the data set again", where=where
        )
    return values.reshape(len(column), parts)
