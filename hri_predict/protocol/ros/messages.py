"""Types of ROS messages by ``rosbags``, which reads their bytes without ROS.

Only types of its own tables and of ours are read: a definition that a bag brings along is never
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
"""Definitions of types that a release's table may lack."""
_BEFORE = {OBJECTS: OBJECTS_BEFORE}
"""Types whose definition changed, as they were before; nothing in the bytes says which it is."""

Release = Literal["ros1", "foxy", "jazzy"]
"""Releases by their messages. ``foxy``: markers without textures, up to Galactic."""


@functools.cache
def typestore(release: Release) -> Any:
    """The types of a release.

    Raises:
        ConfigError: rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise ConfigError(
            "this needs a package that is not installed: rosbags; pip install 'hri-predict[bags]'"
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
    """A message of ROS 2 as plain values; of whichever definition takes all of its bytes.

    Raises:
        Exception: of any kind, if it is damaged.
    """
    try:
        return store.deserialize_cdr(data, kind)
    except Exception:
        if kind not in _BEFORE:
            raise
        return store.deserialize_cdr(data, _BEFORE[kind])
