"""Small logs of one hinge in every format, and the CSV table that says the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.measurements import CommandColumn, Signal, SignalColumn, TableReader

SIGNALS = (Signal("qpos.hinge", "rad"), Signal("qvel.hinge", "rad/s"))
ROWS = 12
TIME = np.round(np.arange(ROWS) * 0.01, 9)
ANGLE = np.sin(5 * TIME)
RATE = 5 * np.cos(5 * TIME)
COMMAND = np.round(np.cos(7 * TIME), 6)


def csv_table(rate_every: int = 1, command_every: int = 1) -> str:
    """The log as a table; the rate is measured, and the command sent, in every n-th row only."""
    rows = ["time,ctrl.motor,qpos.hinge,qvel.hinge"]
    for k in range(ROWS):
        command = repr(float(COMMAND[k])) if k % command_every == 0 else ""
        rate = repr(float(RATE[k])) if k % rate_every == 0 else ""
        rows.append(f"{TIME[k]!r},{command},{float(ANGLE[k])!r},{rate}".replace("np.float64(", "").replace(")", ""))
    return "\n".join(rows) + "\n"


def reader(angle: str, rate: str, command: str, notes: list[str] | None = None) -> TableReader:
    """Maps three columns of a log to the hinge."""
    return TableReader(
        SIGNALS,
        ["motor"],
        mapped=[SignalColumn(SIGNALS[0], angle), SignalColumn(SIGNALS[1], rate)],
        commanded=[CommandColumn("motor", command)],
        note=(lambda _line: None) if notes is None else notes.append,
    )


MCAP = ("/joint_states.position[hinge]", "/joint_states.velocity[hinge]", "/command.data[0]")


def joint_state(k: int, rate_every: int = 1, epoch: int = 1_700_000_000) -> dict[str, Any]:
    stamp = epoch * 10**9 + round(TIME[k] * 1e9)
    return {
        "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "base"},
        "name": ["hinge", "other"],
        "position": [float(ANGLE[k]), 0.5],
        "velocity": [float(RATE[k]), None] if k % rate_every == 0 else [],
        "effort": [],
    }


def write_json_mcap(path: Path, rate_every: int = 1, command_every: int = 1, **options: Any) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        schema = writer.register_schema("JointState", "jsonschema", b"{}")
        states = writer.register_channel("/joint_states", "json", schema)
        commands = writer.register_channel("/command", "json", schema)
        other = writer.register_channel("/image", "cdr", 0)
        for k in range(ROWS):
            instant = 1_700_000_000 * 10**9 + round(TIME[k] * 1e9)
            late = instant + 3_000_000  # logged 3 ms after it was measured: the stamp counts
            state = json.dumps(joint_state(k, rate_every)).encode()
            writer.add_message(states, late, state, late)
            if k % command_every == 0:
                writer.add_message(commands, instant, json.dumps({"data": [float(COMMAND[k])]}).encode(), instant)
            writer.add_message(other, instant, b"\0\1", instant)
        writer.finish()


def write_protobuf_mcap(path: Path) -> None:
    from google.protobuf import descriptor_pb2
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass
    from mcap.writer import CompressionType, Writer

    kinds = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="joint.proto", package="rig", syntax="proto3")

    def message(name: str, *fields: tuple[str, int, int, str]) -> None:
        one = file.message_type.add(name=name)
        for number, (field, kind, label, of) in enumerate(fields, start=1):
            one.field.add(name=field, number=number, type=kind, label=label, type_name=of or None)

    once, many = kinds.LABEL_OPTIONAL, kinds.LABEL_REPEATED
    message("Time", ("seconds", kinds.TYPE_INT64, once, ""), ("nanos", kinds.TYPE_INT32, once, ""))
    message("Header", ("stamp", kinds.TYPE_MESSAGE, once, ".rig.Time"), ("frame", kinds.TYPE_STRING, once, ""))
    message(
        "JointState",
        ("header", kinds.TYPE_MESSAGE, once, ".rig.Header"),
        ("name", kinds.TYPE_STRING, many, ""),
        ("position", kinds.TYPE_DOUBLE, many, ""),
        ("velocity", kinds.TYPE_DOUBLE, many, ""),
        ("raw", kinds.TYPE_BYTES, once, ""),
    )
    message("Command", ("data", kinds.TYPE_DOUBLE, many, ""), ("on", kinds.TYPE_BOOL, once, ""))
    pool = DescriptorPool()
    pool.Add(file)
    state_type = GetMessageClass(pool.FindMessageTypeByName("rig.JointState"))
    command_type = GetMessageClass(pool.FindMessageTypeByName("rig.Command"))
    files = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
    with path.open("wb") as out:
        writer = Writer(out, compression=CompressionType.LZ4)
        writer.start()
        ids = [writer.register_schema(f"rig.{name}", "protobuf", files) for name in ("JointState", "Command")]
        states = writer.register_channel("/joint_states", "protobuf", ids[0])
        commands = writer.register_channel("/command", "protobuf", ids[1])
        for k in range(ROWS):
            instant = 10**9 + round(TIME[k] * 1e9)
            state = state_type(name=["hinge"], position=[ANGLE[k]], velocity=[RATE[k]], raw=b"x")
            state.header.stamp.seconds, state.header.stamp.nanos = instant // 10**9, instant % 10**9
            writer.add_message(states, instant + 1, state.SerializeToString(), instant + 1)
            command = command_type(data=[COMMAND[k]], on=True)
            writer.add_message(commands, instant, command.SerializeToString(), instant)
        writer.finish()


LEROBOT = ("observation.state[hinge]", "observation.state[hinge.rate]", "action[motor]")


def lerobot_info(version: str = "v2.1") -> dict[str, Any]:
    state = {"dtype": "float64", "shape": [2], "names": {"motors": ["hinge", "hinge.rate"]}}
    return {
        "codebase_version": version,
        "fps": 100,
        "features": {
            "observation.state": state,
            "action": {"dtype": "float64", "shape": [1], "names": ["motor"]},
            "observation.images.top": {"dtype": "video", "shape": [480, 640, 3]},
            "timestamp": {"dtype": "float64", "shape": [1], "names": None},
            "episode_index": {"dtype": "int64", "shape": [1], "names": None},
        },
    }


def write_lerobot(folder: Path, version: str = "v2.1", episodes: int = 2) -> None:
    """Version 2: a file an episode; version 3: all in one file. Every episode is the same log."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(lerobot_info(version)))
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    state = pa.array([[a, r] for a, r in zip(ANGLE, RATE, strict=True)], pa.list_(pa.float64(), 2))
    tables = [
        pa.table(
            {
                "observation.state": state,
                "action": pa.array([[c] for c in COMMAND], pa.list_(pa.float64(), 1)).flatten(),
                "timestamp": TIME,
                "episode_index": np.full(ROWS, k),
            }
        )
        for k in range(episodes)
    ]
    if version.startswith("v2"):
        for k, table in enumerate(tables):
            pq.write_table(table, chunk / f"episode_{k:06d}.parquet")
    else:
        pq.write_table(pa.concat_tables(tables), chunk / "file-000.parquet")


RRD = ("/joints[0]", "/joints[1]", "/command")


def write_rrd(path: Path, timelines: tuple[str, ...] = ("time",)) -> None:
    import rerun as rr

    stream = rr.RecordingStream("rig", send_properties=False)
    stream.save(path)
    for k in range(ROWS):
        for name in timelines:
            stream.set_time(name, duration=float(TIME[k]))
        stream.log("joints", rr.Scalars([ANGLE[k], RATE[k]]))
        stream.log("command", rr.Scalars(COMMAND[k]))
    stream.log("note", rr.TextDocument("a rig"), static=True)
    stream.disconnect()
