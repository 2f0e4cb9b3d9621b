"""What sources of the node's own scene stream have in common, whatever carries its datagrams."""

import time
from collections.abc import Callable
from pathlib import Path

from pydantic import Field

from hri_drivers.key_file import read_key
from hri_drivers.live_source import LiveSettings, sender_joints
from hri_drivers.scene_codec import MAX_JOINTS
from hri_drivers.scene_stream import SceneStream
from hri_predict.errors import ConfigError
from hri_predict.source import SourceCounters


class StreamSettings(LiveSettings):
    """``source:`` of a kind that carries the scene stream (``drivers/SCENE_STREAM.md``)."""

    key_file: str | None = Field(
        None, min_length=1, description="file with the key that the sender has, too (HMAC-SHA256)"
    )
    max_skew_s: float = Field(
        2.0, gt=0, le=60, description="with a key: how far a new sender's UTC clock may be off"
    )


def stream_of(
    settings: StreamSettings, base_dir: Path | None, utc_ns: Callable[[], int] = time.time_ns
) -> SceneStream:
    """The decoder that a source's settings ask for, with counters of its own.

    Args:
        settings: the source's.
        base_dir: where relative paths of the key and the joint map start.
        utc_ns: this machine's UTC clock.

    Raises:
        ConfigError: there is no such joint map, or it has more joints than a stream can carry.
        SourceError: the key cannot be used.
    """
    joint_map = sender_joints(settings, base_dir)
    if len(joint_map.source_joints) > MAX_JOINTS:
        raise ConfigError(
            f"source.joint_map: {len(joint_map.source_joints)} joints, a scene stream carries "
            f"{MAX_JOINTS}; leave some out of the map"
        )
    key = read_key(settings.key_file, base_dir) if settings.key_file is not None else None
    return SceneStream(joint_map, SourceCounters(), key, settings.max_skew_s, utc_ns)
