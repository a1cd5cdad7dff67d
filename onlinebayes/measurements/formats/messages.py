"""A decoded message -> its numbers by name, and the instant it speaks of.

| in the message                                   | column                                          |
|--------------------------------------------------|-------------------------------------------------|
| a number or a truth value                        | ``<topic>.<field>``, fields of fields by dots   |
| a list of numbers beside ``name`` (JointState)   | ``<topic>.<field>[<joint name>]``               |
| any other list of up to 256 numbers              | ``<topic>.<field>[0]``, ``[1]``, ...            |
| texts, bytes, longer lists, null                 | left out                                        |

The instant is ``header.stamp``, ``stamp`` or ``timestamp`` where the message has one (seconds and nanoseconds), else
the instant at which it was logged; see :meth:`.series.Recorder.tied` where the two are of different clocks. Source:
sensor_msgs/JointState, https://docs.ros.org/en/api/sensor_msgs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from onlinebayes.measurements.formats.series import Recorder
from onlinebayes.runs import BadInput

LONGEST_LIST = 256
DEEPEST = 16
SECONDS, NANOSECONDS = ("sec", "secs", "seconds"), ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")


def record(recorder: Recorder, topic: str, message: Any, logged: int) -> None:
    """Add the numbers of one message.

    Args:
        recorder: where they go.
        topic: name of the channel.
        message: what its bytes decode to; only mappings hold anything that can be named.
        logged: instant of logging [ns].

    Raises:
        BadInput: lists that disagree with ``name`` about the number of joints.
    """
    if not isinstance(message, Mapping):
        return
    instant = _stamp(message)
    late = None if instant is None else logged - instant
    where = f"{recorder.path}, '{topic[:80]}'"
    for column, value in _numbers(message, topic, where, DEEPEST):
        try:
            recorder.add(column, logged if instant is None else instant, float(value), late)
        except OverflowError:
            raise BadInput(f"{column[:80]} is too large a number", "write SI units", where=where) from None


def _numbers(message: Mapping[str, Any], prefix: str, where: str, depth: int) -> Iterator[tuple[str, float]]:
    joints = _joints(message.get("name"))
    for field, value in message.items():
        path = f"{prefix}.{field}"
        if field in ("header", "stamp", "timestamp") and not isinstance(value, int | float):
            continue
        if isinstance(value, bool | int | float):
            yield path, value
        elif isinstance(value, Mapping) and depth > 0:
            yield from _numbers(value, path, where, depth - 1)
        elif isinstance(value, list) and 0 < len(value) <= LONGEST_LIST:
            numbers = all(item is None or isinstance(item, bool | int | float) for item in value)
            if not numbers:
                continue
            if joints and len(value) != len(joints):
                raise BadInput(
                    f"{field} has {len(value)} values, name has {len(joints)}",
                    "write one value a joint, or none",
                    where=where,
                )
            for k, item in enumerate(value):
                if item is not None:
                    yield f"{path}[{joints[k] if joints else k}]", item


def _joints(name: Any) -> list[str]:
    return name if isinstance(name, list) and all(isinstance(joint, str) for joint in name) else []


def _stamp(message: Mapping[str, Any]) -> int | None:
    """The message's own instant [ns]; None where it has none, or only zeros (a clock that was never set)."""
    header = message.get("header")
    for holder in (header if isinstance(header, Mapping) else {}, message):
        for field in ("stamp", "timestamp"):
            stamp = holder.get(field)
            if not isinstance(stamp, Mapping):
                continue
            whole = next((stamp[key] for key in SECONDS if _whole(stamp.get(key))), 0)
            parts = next((stamp[key] for key in NANOSECONDS if _whole(stamp.get(key))), 0)
            if whole or parts:
                return whole * 1_000_000_000 + parts
    return None


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
