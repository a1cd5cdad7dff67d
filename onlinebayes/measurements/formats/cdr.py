"""ROS 2 messages in CDR -> mappings, lists and numbers, as :mod:`.messages` reads them.

The type's definition is the log's own where it has one; of logs that have none (bags before Iron) the standard messages
of ROS 2 are known. Left out are covariances, which every ``Imu`` and ``Odometry`` repeats, layouts of arrays, and lists
of messages. Source: DDS-XTypes 1.3, 7.4, and https://gitlab.com/ternaris/rosbags. Needs the extra ``ros``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from onlinebayes.measurements.formats.messages import LONGEST_LIST

Decoder = Callable[[bytes], Any]

MISSING = "install the extra ros (pip install -e '.[ros]' in the repository), or write a CSV table"
IDL, LAYOUT = "ros2idl", "std_msgs/msg/MultiArrayLayout"


def cdr_decoder(name: str, definition: str = "", encoding: str = "ros2msg") -> Decoder | None:
    """What turns the bytes of messages of one type into mappings; None where its definition is not known.

    Args:
        name: of the type, ``sensor_msgs/msg/JointState``.
        definition: its text and those of the types in it; empty where the log has none.
        encoding: of the text, ``ros2msg`` or ``ros2idl``.

    Raises:
        ImportError: the extra is missing.
    """
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY if definition else Stores.LATEST)
    if definition:
        try:
            store.register(get_types_from_idl(definition) if encoding == IDL else get_types_from_msg(definition, name))
        except Exception:  # a text that its parser does not know is no fault of the other channels
            return None
    if name not in store.types:
        return None
    return lambda data: _plain(store.deserialize_cdr(data, name))


def _plain(message: Any) -> dict[str, Any]:
    plain: dict[str, Any] = {}
    for name in type(message).__dataclass_fields__:
        value = getattr(message, name)
        layout = getattr(value, "__msgtype__", "") == LAYOUT
        if name.startswith("__") or name.endswith("covariance") or layout:
            continue
        if isinstance(value, np.ndarray):
            if value.size <= LONGEST_LIST:
                plain[name] = value.tolist()
        elif hasattr(value, "__dataclass_fields__"):
            plain[name] = _plain(value)
        else:
            plain[name] = value.item() if isinstance(value, np.generic) else value
    return plain
