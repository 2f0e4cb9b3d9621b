"""ROS message types from ``rosbags``, which reads their bytes without ROS.

Only types from its tables and from ours are read; definitions contained in a bag are never
compiled.
"""

import functools
from typing import Any, Literal

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.ros.tracked import IDS_LIST, IDS_LIST_TEXT
from hri_predict.protocol.ros.zed import OBJECTS, OBJECTS_BEFORE, TEXTS

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
_TEXTS = {
    TF_MESSAGE: "geometry_msgs/TransformStamped[] transforms",
    IDS_LIST: IDS_LIST_TEXT,
    **TEXTS,
}
"""Definitions of types that may be missing from a release's table."""
_BEFORE = {OBJECTS: OBJECTS_BEFORE}
"""Earlier definitions of types that changed; the bytes do not show which one was used."""

Release = Literal["ros1", "foxy", "jazzy"]
"""Releases, grouped by their messages. ``foxy``: markers without textures, up to Galactic."""


@functools.cache
def typestore(release: Release) -> Any:
    """Return the types of a release.

    Raises:
        ConfigError: rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise ConfigError(
            "this needs a package that is not installed: rosbags; install it with: "
            "pip install 'hri-predict[bags]'"
        ) from None
    chosen = {
        "ros1": Stores.ROS1_NOETIC,
        "foxy": Stores.ROS2_FOXY,
        "jazzy": Stores.ROS2_JAZZY,
    }
    store = get_typestore(chosen[release])
    for name, text in _TEXTS.items():
        if name not in store.types:
            store.register(get_types_from_msg(text, name))
    return store


def of_cdr(store: Any, data: bytes, kind: str) -> Any:
    """Decode a ROS 2 message with the definition that consumes all of its bytes.

    Raises:
        Exception: any type, if the message is damaged.
    """
    try:
        return store.deserialize_cdr(data, kind)
    except Exception:
        if kind not in _BEFORE:
            raise
        return store.deserialize_cdr(data, _BEFORE[kind])
