"""Parts common to all sources of the node's own scene stream: settings, decoder, construction."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from hri_drivers.sources.live import Decoder, LiveSettings, LiveSource, Receiver, sender_joints
from hri_drivers.sources.scene_stream.codec import MAX_JOINTS
from hri_drivers.sources.scene_stream.key_file import read_key
from hri_drivers.sources.scene_stream.receiver import SceneStream
from hri_predict.base.clock import Clock
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
            above="scenes recorded up to {value:g} s earlier may be sent again, once"
        )
    }

    def demand_key(self, local: bool, where: str, remedy: str) -> None:
        """Refuse network input without a key, unless the configuration allows it.

        Raises:
            ValueError: the message consists of ``where`` and ``remedy``.
        """
        open_to_all = getattr(self, "allow_unauthenticated", False)
        if not (local or self.key_file is not None or open_to_all):
            raise ValueError(
                f"{where} accepts network input, and any program could claim an empty room: set "
                f"'key_file', or 'allow_unauthenticated: true' if {remedy}"
            )


class StreamSource(LiveSource, ABC):
    """See ``hri_drivers.sources.live.LiveSource``.

    Args:
        settings: the source's.
        base_dir: base of relative paths of the key and the joint map.
        clock: the node's.
        utc_ns: this machine's UTC clock.

    Raises:
        ConfigError: the joint map is unknown, or has more joints than a stream can carry.
        SourceError: the key cannot be used.
    """

    stamps_utc = True

    def __init__(
        self,
        settings: Any,  # each kind's own
        base_dir: Path | None = None,
        clock: Clock | None = None,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        joint_map, key_file = sender_joints(settings, base_dir), settings.key_file
        if len(joint_map.source_joints) > MAX_JOINTS:
            raise ConfigError(
                f"source.joint_map: {len(joint_map.source_joints)} joints, a scene stream carries"
                f" at most {MAX_JOINTS}; leave some out of the map"
            )
        stream = SceneStream(
            joint_map=joint_map,
            counters=SourceCounters(),
            key=read_key(key_file, base_dir) if key_file is not None else None,
            max_skew_s=settings.max_skew_s,
            utc_ns=utc_ns,
        )
        super().__init__(
            settings=settings,
            receiver=self._make_receiver(settings, base_dir or Path()),
            decoder=self._make_decoder(stream),
            counters=stream.counters,
            joint_map=joint_map,
            clock=clock,
        )

    @staticmethod
    @abstractmethod
    def _make_receiver(settings: Any, base_dir: Path) -> Receiver:
        """Return the receiver of the bytes, not yet open."""

    @staticmethod
    def _make_decoder(stream: SceneStream) -> Decoder:
        """Return the decoder of the bytes: for whole datagrams, the stream itself."""
        return stream
