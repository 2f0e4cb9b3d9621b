"""Types of ROS messages by ``rosbags``, which reads their bytes without ROS.

Only types of its own tables are read: a definition that a bag brings along is never compiled.
"""

import functools
from typing import Any, Literal

from hri_predict.base.errors import ConfigError

TF_MESSAGE = "tf2_msgs/msg/TFMessage"

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
    if TF_MESSAGE not in store.types:
        store.register(
            get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF_MESSAGE)
        )
    return store
