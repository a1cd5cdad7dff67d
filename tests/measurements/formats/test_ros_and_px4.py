"""ROS 2 bags in SQLite and MCAP, messages in CDR; PX4 flight logs: what their writers wrote, to the nanosecond."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onlinebayes.measurements import Measurement
from onlinebayes.measurements.formats import open_source
from onlinebayes.runs import BadInput
from tests.measurements.formats import logs

EPOCH = 1_700_000_000 * 10**9
STATES = ("/joint_states.position[hinge]", "/joint_states.velocity[hinge]", "/command.data[0]")


def bag(path: Path, plugin: str = "SQLITE3", stamped_from: int = EPOCH) -> Path:
    """Joint states every 10 ms, stamped 3 ms before they are logged; commands, an IMU and odometry with them."""
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)

    def make(kind: str, *values: Any) -> Any:
        return store.types[kind](*values)

    def header(instant: int) -> Any:
        stamp = make("builtin_interfaces/msg/Time", instant // 10**9, instant % 10**9)
        return make("std_msgs/msg/Header", stamp, "base")

    def vector(*values: float) -> Any:
        return make("geometry_msgs/msg/Vector3", *values)

    turn, nine, many = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0), np.zeros(9), np.zeros(36)

    def state(k: int, instant: int) -> Any:
        position, velocity = np.array([logs.ANGLE[k], 0.5]), np.array([logs.RATE[k], 0.0])
        return make("sensor_msgs/msg/JointState", header(instant), ["hinge", "other"], position, velocity, np.zeros(0))

    def command(k: int, _instant: int) -> Any:
        return make(
            "std_msgs/msg/Float64MultiArray", make("std_msgs/msg/MultiArrayLayout", [], 0), logs.COMMAND[k : k + 1]
        )

    def imu(k: int, instant: int) -> Any:
        turned = vector(0.0, 0.0, float(logs.RATE[k]))
        return make("sensor_msgs/msg/Imu", header(instant), turn, nine, turned, nine, vector(0.0, 0.0, 9.81), nine)

    def odometry(k: int, instant: int) -> Any:
        pose = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", 0.1 * k, 0.0, 0.0), turn)
        twist = make("geometry_msgs/msg/Twist", vector(0.1, 0.0, 0.0), vector(0.0, 0.0, 0.0))
        poses = make("geometry_msgs/msg/PoseWithCovariance", pose, many)
        return make(
            "nav_msgs/msg/Odometry",
            header(instant),
            "b",
            poses,
            make("geometry_msgs/msg/TwistWithCovariance", twist, many),
        )

    topics: dict[str, tuple[str, Callable[[int, int], Any], int]] = {
        "/joint_states": ("sensor_msgs/msg/JointState", state, 3_000_000),
        "/command": ("std_msgs/msg/Float64MultiArray", command, 0),
        "/imu": ("sensor_msgs/msg/Imu", imu, 3_000_000),
        "/odom": ("nav_msgs/msg/Odometry", odometry, 3_000_000),
    }
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
        for topic, (kind, message, late) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for k in range(logs.ROWS):
                passed = round(logs.TIME[k] * 1e9)
                data = store.serialize_cdr(message(k, stamped_from + passed), kind)
                writer.write(connection, EPOCH + passed + late, data)
    return path


def check(found: Measurement) -> None:
    assert np.allclose(found.data["time"][0], logs.TIME, rtol=0, atol=1e-12)
    assert np.allclose(found.data["signal"][0, :, 0], logs.ANGLE)
    assert np.allclose(found.data["signal"][0, :, 1], logs.RATE)
    assert np.allclose(found.data["command"][0, :, 0], logs.COMMAND)


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize("whole", [True, False], ids=["folder", "file"])
def test_a_bag_reads_as_its_folder_and_as_its_file(tmp_path: Path, plugin: str, whole: bool) -> None:
    folder = bag(tmp_path / "swing", plugin)
    (file,) = (one for one in folder.iterdir() if one.suffix != ".yaml")
    found = logs.reader(*STATES).read([folder if whole else file])
    check(found)
    assert found.runs == ("swing",)


def test_imu_and_odometry_are_columns_without_covariances(tmp_path: Path) -> None:
    source = open_source(bag(tmp_path / "swing"))
    assert not any("covariance" in name or "layout" in name for name in source.names)
    names = ["/imu.angular_velocity.z", "/odom.pose.pose.position.x", "/odom.twist.twist.linear.x"]
    read = source.columns(["time", *names])
    assert np.allclose(read[names[0]], logs.RATE)
    assert np.allclose(read[names[1]], 0.1 * np.arange(logs.ROWS))


def test_definitions_in_the_log_are_not_needed_for_standard_messages(tmp_path: Path) -> None:
    """Bags of ROS 2 before Iron have none."""
    (file,) = bag(tmp_path / "swing").glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("DROP TABLE message_definitions")
    base.close()
    check(logs.reader(*STATES).read([file]))


def test_parts_of_a_bag_are_one_run(tmp_path: Path) -> None:
    folder = bag(tmp_path / "swing")
    (first,) = folder.glob("*.db3")
    second = first.with_name("swing_10.db3")
    second.write_bytes(first.read_bytes())
    cut = EPOCH + 55_000_000
    for file, rule in ((first, ">"), (second, "<=")):
        with sqlite3.connect(file) as base:
            base.execute(f"DELETE FROM messages WHERE timestamp {rule} {cut}")
        base.close()
    check(logs.reader(*STATES).read([folder]))


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_stamps_of_a_simulated_clock_are_tied_to_the_logs(tmp_path: Path, plugin: str) -> None:
    """Commands have no stamp: their instants count from 1970, those of the states from the simulation's start."""
    found = logs.reader(*STATES).read([bag(tmp_path / "swing", plugin, stamped_from=5 * 10**9)])
    seen = found.data["measured"][0, :, 0]
    assert int(seen.sum()) == logs.ROWS
    assert np.allclose(found.data["time"][0][seen], logs.TIME + 0.003, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda file: file.write_bytes(file.read_bytes()[:5000]), "is a damaged ROS 2 bag"),
        (lambda file: sql(file, "UPDATE messages SET data = x'00010000ffffffff'"), "is a damaged ROS 2 bag"),
        (lambda file: sql(file, "DROP TABLE messages"), "an SQLite file, but no ROS 2 bag"),
        (lambda file: sql(file, "UPDATE topics SET serialization_format = 'xml'"), "no topic holds numbers"),
        (lambda file: file.rename(file.with_suffix(".db3.zstd")), r"its files are packed \(swing.*zstd\)"),
    ],
    ids=["cut", "bytes", "tables", "format", "packed"],
)
def test_a_bag_that_cannot_be_read_is_one_line(tmp_path: Path, change: Callable[[Path], object], message: str) -> None:
    folder = bag(tmp_path / "swing")
    (file,) = folder.glob("*.db3")
    change(file)
    with pytest.raises(BadInput, match=message) as error:
        logs.reader(*STATES).read([folder])
    assert "\n" not in str(error.value)


def sql(file: Path, line: str) -> None:
    with sqlite3.connect(file) as base:
        base.execute(line)
    base.close()


def block(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def flight_log(path: Path, repeated: bool = False) -> Path:
    """A ULog file of one attitude topic and two instances of an actuator's."""
    parts = [b"ULog\x01\x125\x01" + struct.pack("<Q", 10**6), block("B", bytes(40))]
    formats = (
        b"vehicle_state:uint64_t timestamp;float angle;float[2] rate;",
        b"motors:uint64_t timestamp;float[1] control;",
    )
    parts += [block("F", text) for text in formats]
    for number, (instance, name) in enumerate([(0, b"vehicle_state"), (0, b"motors"), (1, b"motors")]):
        parts.append(block("A", struct.pack("<BH", instance, number) + name))
    for k in range(logs.ROWS):
        instant = 10**6 + round(logs.TIME[k] * 1e6)
        state = struct.pack("<HQfff", 0, instant, logs.ANGLE[k], logs.RATE[k], 7.0)
        parts += [block("D", state)] * (2 if repeated else 1)
        parts += [
            block("D", struct.pack("<HQf", one, instant, sign * logs.COMMAND[k])) for one, sign in ((1, 1), (2, -1))
        ]
    path.write_bytes(b"".join(parts))
    return path


@pytest.mark.parametrize("repeated", [False, True])
def test_a_flight_log_reads_as_the_table_does(tmp_path: Path, repeated: bool) -> None:
    pytest.importorskip("pyulog")
    reader = logs.reader("vehicle_state.angle", "vehicle_state.rate[0]", "motors_1.control[0]")
    found = reader.read([flight_log(tmp_path / "flight.ulg", repeated)])
    assert np.allclose(found.data["time"][0], logs.TIME, rtol=0, atol=1e-12)
    assert np.allclose(found.data["signal"][0], np.stack([logs.ANGLE, logs.RATE], -1), atol=1e-6)
    assert np.allclose(found.data["command"][0, :, 0], -logs.COMMAND, atol=1e-6)


def test_a_flight_log_that_is_cut_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    path = flight_log(tmp_path / "flight.ulg")
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(BadInput, match=r"is a damaged ULog file|no topic was logged") as error:
        logs.reader("a", "b", "c").read([path])
    assert "\n" not in str(error.value)
