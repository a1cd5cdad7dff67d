"""Malformed and hostile logs: each is one clear line, at once, with little memory."""

from __future__ import annotations

import json
import re
import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from onlinebayes.runs import BadInput
from tests.measurements.formats import logs

Write = Callable[[Path], object]
MAGIC = b"\x89MCAP0\r\n"


def raw(content: bytes) -> Write:
    return lambda path: path.write_bytes(content)


def changed(write: Write, change: Callable[[bytes], bytes]) -> Write:
    def both(path: Path) -> None:
        write(path)
        path.write_bytes(change(path.read_bytes()))

    return both


def mcap_record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def mcap_chunk(size: int, packing: str, data: bytes) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(packing)) + packing.encode()
    return mcap_record(6, head + struct.pack("<Q", len(data)) + data)


def zeros(packing: str, size: int) -> bytes:
    if packing == "zstd":
        import zstandard

        compressor = zstandard.ZstdCompressor(write_content_size=False).compressobj()
        parts = [compressor.compress(bytes(2**20)) for _ in range(size >> 20)]
        return b"".join([*parts, compressor.flush()])
    import lz4.frame

    return lz4.frame.compress(bytes(size))


def mcap_messages(*messages: bytes, topic: str = "/q") -> Write:
    def write(path: Path) -> None:
        from mcap.writer import Writer

        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel(topic, "json", 0)
            for k, message in enumerate(messages):
                writer.add_message(channel, k, message, k)
            writer.finish()

    return write


def parquet(**columns: object) -> Write:
    def write(path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)

    return write


def parquet_bomb(path: Path) -> None:
    """Rows of one repeated value, packed to nothing."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    part = pa.table({"time": pa.array(np.zeros(10_000_000)), "qpos.hinge": pa.array(np.zeros(10_000_000))})
    with pq.ParquetWriter(path, part.schema, compression="zstd") as writer:
        for _ in range(6):
            writer.write_table(part)


def lerobot(change: Callable[[Path], object]) -> Write:
    def write(path: Path) -> None:
        logs.write_lerobot(path)
        change(path)

    return write


def info(**changes: object) -> Write:
    def change(folder: Path) -> None:
        file = folder / "meta" / "info.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))

    return lerobot(change)


def elsewhere(folder: Path) -> None:
    file = folder / "data" / "chunk-000" / "episode_000001.parquet"
    file.rename(folder.parent / "moved.parquet")
    file.symlink_to(folder.parent / "moved.parquet")


def info_elsewhere(folder: Path) -> None:
    (folder / "meta" / "info.json").rename(folder.parent / "info.json")
    (folder / "meta" / "info.json").symlink_to(folder.parent / "info.json")


def no_data(folder: Path) -> None:
    for file in (folder / "data").rglob("*.parquet"):
        file.unlink()


def cut_episode(folder: Path) -> None:
    file = folder / "data" / "chunk-000" / "episode_000001.parquet"
    file.write_bytes(file.read_bytes()[:-20])


HEAD = b"time,ctrl.motor,qpos.hinge\n"
JSON = logs.write_json_mcap
STATE = {"name": ["a", "b"], "position": [1.0]}

BAD: dict[str, tuple[str, Write, str]] = {
    # CSV
    "csv empty": ("csv", raw(b""), "the file is empty"),
    "csv NUL": ("csv", raw(bytes(5000)), "not a text file"),
    "csv NUL in a cell": ("csv", raw(HEAD + b"0,0,1\0\n1,0,2\n"), "row 2, column 'qpos.hinge': .*is not a number"),
    "csv NUL in a run": ("csv", raw(b"run," + HEAD + b"a\0,0,0,1\na\0,1,0,2\n"), "characters that cannot be shown"),
    "csv UTF-16": ("csv", raw(HEAD.decode().encode("utf-16")), "UTF-16"),
    "csv two marks": ("csv", raw(b"\xef\xbb\xbf\xef\xbb\xbf" + HEAD + b"0,0,0\n1,0,0\n"), "no column 'time'"),
    "csv old Mac": ("csv", raw(HEAD + b"0,0,0\r1,0\r2,0,0\n"), "row 3: 2 cells where the header has 3"),
    "csv one line": ("csv", raw(b"time," * 1_000_000), "a line of more than"),
    "csv wide": ("csv", raw(b",".join(b"c%d" % k for k in range(20_000))), "20000 columns; at most"),
    "csv wide twins": ("csv", raw(b"," * 200_000), "200001 columns; at most"),
    "csv long cell": ("csv", raw(HEAD + b"0,0," + b"1" * 200_000 + b"\n"), "field larger than field limit"),
    "csv open quote": ("csv", raw(HEAD + b'0,0,"1\n' + b"1,0,0\n" * 1000), "is no readable CSV"),
    "csv duplicate": ("csv", raw(b"time,qpos.hinge,qpos.hinge\n0,0,0\n1,0,0\n"), "two columns are called"),
    "csv overflow": ("csv", raw(HEAD + b"0,0,1e999\n1,0,0\n"), "inf is no measured value"),
    "csv gzip": ("csv", raw(b"\x1f\x8b\x08" + bytes(range(255)) * 9), "packed by gzip"),
    "csv zip": ("csv", raw(b"PK\x03\x04" + bytes(100)), "is a ZIP archive"),
    # Parquet
    "parquet text": ("parquet", raw(HEAD), "is not a Parquet file"),
    "parquet head": ("parquet", raw(b"PAR1"), "is a damaged Parquet file"),
    "parquet cut": ("parquet", changed(parquet(time=[0.0, 1.0]), lambda b: b[:-9]), "is a damaged Parquet file"),
    "parquet footer": (
        "parquet",
        changed(parquet(time=[0.0, 1.0]), lambda b: b[:-8] + b"\xff\xff\xff\x7fPAR1"),
        "is a damaged Parquet file",
    ),
    "parquet types": ("parquet", parquet(**{"time": ["a"], "qpos.hinge": [1.0]}), "holds string, not numbers"),
    "parquet lists": ("parquet", parquet(**{"time": [0.0], "qpos.hinge": [[1.0]]}), "holds list.*, not numbers"),
    "parquet twins": ("parquet", parquet(**{"time": [0.0], "time ": [1.0]}), "two columns are called 'time'"),
    "parquet bomb": ("parquet", parquet_bomb, "120000000 numbers; at most 100000000"),
    "parquet no rows": ("parquet", parquet(**{"time": [], "qpos.hinge": []}), "holds null|no rows"),
    # MCAP
    "mcap text": ("mcap", raw(HEAD), "is not an MCAP file"),
    "mcap head": ("mcap", raw(MAGIC), "is a damaged MCAP file"),
    "mcap cut": ("mcap", changed(JSON, lambda b: b[: len(b) // 2]), "is a damaged MCAP file"),
    "mcap not finished": ("mcap", changed(JSON, lambda b: b[:-8]), "is a damaged MCAP file"),
    "mcap flipped": (
        "mcap",
        changed(JSON, lambda b: b[:200] + bytes([b[200] ^ 255]) + b[201:]),
        "damaged|another size",
    ),
    "mcap huge record": ("mcap", raw(MAGIC + mcap_record(5, b"x", 2**62)), "is a damaged MCAP file"),
    "mcap huge text": ("mcap", raw(MAGIC + mcap_record(1, struct.pack("<I", 2**32 - 1))), "is a damaged MCAP file"),
    "mcap huge chunk": ("mcap", raw(MAGIC + mcap_chunk(2**62, "zstd", zeros("zstd", 2**20))), "a chunk unpacks to"),
    "mcap zstd bomb": ("mcap", raw(MAGIC + mcap_chunk(1000, "zstd", zeros("zstd", 2**30))), "unpacks to another size"),
    "mcap lz4 bomb": ("mcap", raw(MAGIC + mcap_chunk(1000, "lz4", zeros("lz4", 2**27))), "unpacks to another size"),
    "mcap packing": ("mcap", raw(MAGIC + mcap_chunk(9, "brotli", b"x")), "a chunk is packed as 'brotli'"),
    "mcap nothing": ("mcap", mcap_messages(), "no channel holds numbers"),
    "mcap texts": ("mcap", mcap_messages(b'{"a": "b"}', b"[1]", b"3"), "no channel holds numbers"),
    "mcap not JSON": ("mcap", mcap_messages(b"{"), "damaged MCAP file: JSONDecodeError"),
    "mcap deep JSON": ("mcap", mcap_messages(b"[" * 100_000), "damaged MCAP file: RecursionError"),
    "mcap long number": ("mcap", mcap_messages(b'{"a": 1' + b"0" * 4000 + b"}"), "is too large a number"),
    "mcap far stamp": (
        "mcap",
        mcap_messages(b'{"stamp": {"sec": 99999999999999999999}, "a": 1}'),
        "a time of",
    ),
    "mcap names": ("mcap", mcap_messages(json.dumps(STATE).encode()), "position has 1 values, name has 2"),
    "mcap clock": (
        "mcap",
        mcap_messages(b'{"stamp": {"sec": 5}, "a": 1}', b'{"stamp": {"sec": 4}, "a": 1}'),
        r"or map one of its columns: '/q\.a'",  # whose clock nobody asked for
    ),
    "mcap wide": (
        "mcap",
        mcap_messages(*(json.dumps({f"a{k}_{j}": 1 for j in range(500)}).encode() for k in range(21))),
        "more than 10000 columns",
    ),
    "mcap unmapped": ("mcap", mcap_messages(b'{"a": 1}', b'{"a": 2}'), r"or map one of its columns: '/q\.a'"),
    # LeRobot
    "lerobot folder": ("", lambda path: path.mkdir(), "without meta/info.json"),
    "lerobot JSON": ("", lerobot(lambda f: (f / "meta/info.json").write_text("{")), "is not JSON"),
    "lerobot deep": ("", lerobot(lambda f: (f / "meta/info.json").write_text("[" * 10**5)), "is not JSON"),
    "lerobot list": ("", lerobot(lambda f: (f / "meta/info.json").write_text("[]")), "no features"),
    "lerobot version": ("", info(codebase_version="v1.6"), r"codebase_version 'v1\.6' cannot be read; versions 2"),
    "lerobot later version": ("", info(codebase_version="v20.1"), r"codebase_version 'v20\.1' cannot be read"),
    "lerobot no version": ("", info(codebase_version=None), "codebase_version 'None' cannot be read"),
    "lerobot no features": ("", info(features=None), r"info\.json: describes no features; write the data set again"),
    "lerobot linked": ("", lerobot(elsewhere), "is a link to .*moved.parquet, outside the data set"),
    "lerobot linked info": ("", lerobot(info_elsewhere), "is a link to .*info.json, outside the data set"),
    "lerobot no data": ("", lerobot(no_data), "no Parquet file under data/"),
    "lerobot cut": ("", lerobot(cut_episode), "episode_000001.parquet: is a damaged Parquet file"),
    "lerobot shape": (
        "",
        info(features={"observation.state": {"dtype": "float32", "shape": [3]}}),
        "row 1: a list of 2 values where meta/info.json says 3",
    ),
    "lerobot names": (
        "",
        info(features={"observation.state": {"dtype": "float32", "shape": [2], "names": ["a", "a"]}}),
        "stands twice",
    ),
    # Rerun
    "rrd head": ("rrd", raw(b"RRF2"), "is a damaged Rerun recording"),
    "rrd text": ("rrd", raw(HEAD), "is not a Rerun file"),
    "rrd cut": ("rrd", changed(logs.write_rrd, lambda b: b[: len(b) // 2]), "is a damaged Rerun recording"),
    "rrd flipped": (
        "rrd",
        changed(logs.write_rrd, lambda b: b[:20] + bytes([b[20] ^ 255]) + b[21:]),  # in the first message's length
        "is a damaged Rerun recording",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_hostile_log_is_one_line(tmp_path, name):
    suffix, write, message = BAD[name]
    path = tmp_path / (f"log.{suffix}" if suffix else "log")
    write(path)
    before = sorted(tmp_path.rglob("*"))
    reader = logs.reader("qpos.hinge", "qvel.hinge", "ctrl.motor")
    watched = "bomb" in name or "huge" in name  # watching every allocation is slow
    if watched:
        tracemalloc.start()
    start = time.process_time()
    try:
        with pytest.raises(BadInput) as caught:
            reader.read([path])
        seconds, most = time.process_time() - start, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert re.search(message, str(caught.value)), caught.value
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000
    assert ";" in str(caught.value), "no cure"
    assert seconds < 5
    assert most < 100e6, f"{most / 1e6:.0f} MB"
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
def test_a_recording_that_ends_its_reader(tmp_path):
    """Rerun's reader aborts its process where some bytes are changed; where they lie depends on the recording's id."""
    path = tmp_path / "log.rrd"
    logs.write_rrd(path)
    good, messages = path.read_bytes(), []
    for at in range(2740, 2860, 4):
        path.write_bytes(good[:at] + bytes([good[at] ^ 2]) + good[at + 1 :])
        try:
            logs.reader(*logs.RRD).read([path])
        except BadInput as error:
            messages.append(str(error))
            if "is a damaged Rerun recording: its reader stopped" in messages[-1]:
                return
    pytest.fail(f"no byte ended the reader: {messages}")
