"""Whatever bytes come, a loader gives a measurement or a BadInput of one line: never another exception."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from onlinebayes.measurements import Measurement
from onlinebayes.problems.problem_file import read_toml
from onlinebayes.runs import BadInput
from tests.measurements.formats import logs

FUZZ = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)

EDITS = st.lists(st.tuples(st.floats(0, 1), st.sampled_from(["put", "cut", "add"]), st.binary(max_size=6)), max_size=5)
"""Places in a file (as a share of its length) and what is done there: damage that leaves most of it in shape."""

CELL = st.sampled_from(["", "0", "1", "0.5", "nan", "inf", "-1e999", "1e300", "x", '"', " 2 ", "1,5", "\0", "é", "1_0"])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["name", "position", "velocity", "data", "header", "stamp", "sec", "nanosec", "a"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


def edited(content: bytes, edits: list[tuple[float, str, bytes]]) -> bytes:
    for share, kind, new in edits:
        at = int(share * len(content))
        end = at + (len(new) if kind == "put" else 0)
        content = content[:at] if kind == "cut" else content[:at] + new + content[end:]
    return content


def one_line(error: BadInput) -> None:
    assert len(str(error).splitlines()) == 1


def read(path: Path, columns: tuple[str, str, str]) -> Measurement | None:
    try:
        found = logs.reader(*columns).read([path])
    except BadInput as error:
        return one_line(error)
    assert np.isfinite(found.data["signal"].numpy()).all()
    assert (found.data["time"].diff(dim=1) >= 0).all()  # padding may stand still where a step is below rounding
    return found


OWN = ("qpos.hinge", "qvel.hinge", "ctrl.motor")


@FUZZ
@given(st.binary(max_size=300))
def test_any_bytes(tmp_path, content):
    for start in (b"", b"\x89MCAP0\r\n", b"PAR1", b"\xef\xbb\xbftime,qpos.hinge\n"):
        (tmp_path / "log").write_bytes(start + content)
        read(tmp_path / "log", OWN)


@FUZZ
@given(st.lists(st.lists(CELL, min_size=3, max_size=5), max_size=8), st.sampled_from(["\n", "\r\n", "\r"]))
def test_any_csv(tmp_path, rows, end):
    text = end.join(["run,time,ctrl.motor,qpos.hinge,qvel.hinge", *(",".join(row) for row in rows)])
    (tmp_path / "log.csv").write_bytes(text.encode())
    read(tmp_path / "log.csv", OWN)


@FUZZ
@given(EDITS)
def test_damaged_csv(tmp_path, edits):
    (tmp_path / "log.csv").write_bytes(edited(logs.csv_table().encode(), edits))
    read(tmp_path / "log.csv", OWN)


@pytest.fixture(scope="module")
def mcaps(tmp_path_factory) -> list[bytes]:
    from mcap.writer import CompressionType

    path = tmp_path_factory.mktemp("mcap") / "log.mcap"
    written = []
    for options in ({"compression": CompressionType.NONE, "enable_crcs": False}, {}):
        logs.write_json_mcap(path, **options)
        written.append(path.read_bytes())
    logs.write_protobuf_mcap(path)
    return [*written, path.read_bytes()]


@FUZZ
@given(EDITS, st.integers(0, 2))
def test_damaged_mcap(tmp_path, mcaps, edits, which):
    (tmp_path / "log.mcap").write_bytes(edited(mcaps[which], edits))
    read(tmp_path / "log.mcap", logs.MCAP)


@FUZZ
@given(st.lists(JSON, max_size=4))
def test_any_json_in_mcap(tmp_path, messages):
    from mcap.writer import Writer

    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/q", "json", 0)
        for k, message in enumerate(messages):
            writer.add_message(channel, k * 10**7, json.dumps(message).encode(), k * 10**7)
        writer.finish()
    read(tmp_path / "log.mcap", ("/q.a", "/q.position[0]", "/q.velocity[0]"))


@FUZZ
@given(JSON, st.sampled_from(["dtype", "shape", "names", "state", "features", "codebase_version", "all"]))
def test_any_info_of_a_lerobot_data_set(tmp_path, value, where):
    folder = tmp_path / "pick"
    if not folder.exists():
        logs.write_lerobot(folder)
    info = logs.lerobot_info()
    state = info["features"]["observation.state"]
    if where == "all":
        info = value
    elif where in info:
        info[where] = value
    elif where == "state":
        info["features"]["observation.state"] = value
    else:
        state[where] = value
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    read(folder, logs.LEROBOT)


@FUZZ
@given(EDITS)
def test_damaged_lerobot_parquet(tmp_path, edits):
    folder = tmp_path / "pick"
    logs_file = folder / "data" / "chunk-000" / "episode_000000.parquet"
    if not folder.exists():
        logs.write_lerobot(folder, episodes=1)
        (tmp_path / "good").write_bytes(logs_file.read_bytes())
    logs_file.write_bytes(edited((tmp_path / "good").read_bytes(), edits))
    read(folder, logs.LEROBOT)


PARQUET_CELLS = st.sampled_from(
    [
        None,
        0.5,
        float("nan"),
        float("inf"),
        2**62,
        True,
        "1",
        "x",
        b"1",
        [1.0],
        {"a": 1},
        Decimal("0.1"),
        datetime(2026, 1, 2),
        timedelta(seconds=1),
    ]
)


@FUZZ
@given(st.lists(st.tuples(PARQUET_CELLS, PARQUET_CELLS), min_size=5, max_size=5), st.booleans())
def test_any_parquet_columns(tmp_path, ends, dictionary):
    """Columns of every type that Arrow infers, two kinds of cells in turn where it allows them side by side."""
    import pyarrow
    import pyarrow.parquet

    names = ("run", "time", "ctrl.motor", "qpos.hinge", "qvel.hinge")
    columns = {}
    for name, (first, second) in zip(names, ends, strict=True):
        try:
            columns[name] = pyarrow.array([first, second] * 3)
        except (pyarrow.ArrowException, OverflowError, TypeError, ValueError):
            columns[name] = pyarrow.array([first] * 6)
    pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "log.parquet", use_dictionary=dictionary)
    read(tmp_path / "log.parquet", OWN)


@pytest.fixture(scope="module")
def rrd(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("rrd") / "log.rrd"
    logs.write_rrd(path)
    return path.read_bytes()


@pytest.mark.slow
@settings(FUZZ, max_examples=15)  # each starts a process of 0.6 s
@given(EDITS)
def test_damaged_rrd(tmp_path, rrd, edits):
    (tmp_path / "log.rrd").write_bytes(edited(rrd, edits))
    read(tmp_path / "log.rrd", logs.RRD)


PROBLEM = b'schema = 1\nmodel = "a.xml"\nmeasurements = ["a.csv"]\n[parameters]\n"body.a.mass" = [1.0, 2.0]\n'


@FUZZ
@given(EDITS | st.binary(max_size=200))
def test_any_toml(tmp_path, change):
    content = change if isinstance(change, bytes) else edited(PROBLEM, change)
    (tmp_path / "a.toml").write_bytes(content)
    try:
        assert isinstance(read_toml(tmp_path / "a.toml"), dict)
    except BadInput as error:
        one_line(error)
