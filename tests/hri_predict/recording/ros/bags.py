"""Bags as rosbags' own writers write them."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from tests.hri_predict.protocol.ros.sent import Maker

Logged = tuple[str, str, Any, int]
"""Topic, type, message, and time of its receipt, ns."""
KINDS = ("bag", "db3", "mcap")
RELEASES = {"bag": "ros1", "db3": "jazzy", "mcap": "jazzy"}


def maker(kind: str) -> Maker:
    return Maker(RELEASES[kind])  # type: ignore[arg-type]


def write(folder: Path, kind: str, messages: Iterable[Logged], name: str = "walk",
          sent_as: Mapping[str, str] = {}) -> Path:  # fmt: skip
    """Write a bag; of ROS 2 its folder. ``sent_as``: names under which types are written."""
    store = maker(kind).store
    if kind == "bag":
        path = folder / f"{name}.bag"
        writer: Any = Writer1(path)
        packed = store.serialize_ros1
    else:
        path = folder / name
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        packed = store.serialize_cdr
    with writer:
        connections: dict[str, Any] = {}
        for topic, message_type, message, at_ns in messages:
            if topic not in connections:
                named = sent_as.get(message_type, message_type)
                connections[topic] = writer.add_connection(topic, named, typestore=store)
            writer.write(connections[topic], at_ns, packed(message, message_type))
    return path
