"""Decodes serialised ROS 2 messages by ``rosbags``, an implementation that is not ours."""

from typing import Any

import pytest

pytest.importorskip("rosbags", reason="needs the extra bags: it decodes what the link encodes")

from rosbags.typesys import Stores, get_typestore

from hri_predict.protocol.ros.plain import Sample

TYPES = {
    "speed_fraction": "std_msgs/msg/Float64",
    "speed_ovr": "std_msgs/msg/Int64",
    "advice": "std_msgs/msg/String",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "zones": "visualization_msgs/msg/MarkerArray",
    "forecast_markers": "visualization_msgs/msg/MarkerArray",
    "forecast": "geometry_msgs/msg/PoseArray",
}
STORES = [get_typestore(store) for store in (Stores.ROS2_HUMBLE, Stores.ROS2_KILTED)]


def decoded(data: bytes, type_name: str) -> Any:
    """The message, which Humble and Kilted decode and encode alike."""
    for store in STORES:
        message = store.deserialize_cdr(data, type_name)
        assert bytes(store.serialize_cdr(message, type_name)) == data
    return message


def by_topic(samples: list[Sample]) -> dict[str, Any]:
    """Last part of the topic -> decoded message."""
    found = {sample.topic.rpartition("/")[2]: sample.data for sample in samples}
    assert len(found) == len(samples)
    return {name: decoded(data, TYPES[name]) for name, data in found.items()}
