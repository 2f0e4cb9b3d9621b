"""Common part of all sources of the node's own scene stream."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from hri_drivers.sources.live import LiveSettings, sender_joints
from hri_drivers.sources.scene_stream.codec import MAX_JOINTS
from hri_drivers.sources.scene_stream.key_file import read_key
from hri_drivers.sources.scene_stream.receiver import SceneStream
from hri_predict.base.errors import ConfigError
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.contracts.source import SourceCounters


class StreamSettings(LiveSettings):
    """``source:`` of a kind that carries the scene stream (``drivers/SCENE_STREAM.md``)."""

    key_file: str | None = Field(
        None, min_length=1, description="file with the key shared with the sender (HMAC-SHA256)"
    )
    max_skew_s: float = Field(
        2.0, ge=0.001, le=60, description="with a key: largest error of a new sender's UTC clock"
    )

    safety: ClassVar[Safety] = {
        "max_skew_s": LessSafe(
            above="scenes that were recorded up to {value:g} s before may be sent again, once"
        )
    }


def stream_of(
    settings: StreamSettings, base_dir: Path | None, utc_ns: Callable[[], int] = time.time_ns
) -> SceneStream:
    """Return the decoder for a source's settings, with its own counters.

    Args:
        settings: the source's.
        base_dir: start of relative paths of the key and the joint map.
        utc_ns: this machine's UTC clock.

    Raises:
        ConfigError: there is no such joint map, or it has more joints than a stream can carry.
        SourceError: the key cannot be used.
    """
    joint_map = sender_joints(settings, base_dir)
    if len(joint_map.source_joints) > MAX_JOINTS:
        raise ConfigError(
            f"source.joint_map: {len(joint_map.source_joints)} joints, a scene stream carries"
            f" at most {MAX_JOINTS}; leave some out of the map"
        )
    key = read_key(settings.key_file, base_dir) if settings.key_file is not None else None
    return SceneStream(
        joint_map=joint_map,
        counters=SourceCounters(),
        key=key,
        max_skew_s=settings.max_skew_s,
        utc_ns=utc_ns,
    )
