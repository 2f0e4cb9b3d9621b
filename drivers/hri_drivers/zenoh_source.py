"""``kind: zenoh``: scenes under ``hri/<site>/<cell>/scene``; see ``docs/fleet.md``.

Each payload is one datagram of the node's own scene stream (``drivers/SCENE_STREAM.md``), so that a
key (HMAC) protects a scene from its sender to the node, through whatever router lies between.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from hri_drivers.key_file import read_key
from hri_drivers.live_source import LiveSettings, LiveSource, sender_joints
from hri_drivers.scene_codec import MAX_JOINTS
from hri_drivers.scene_stream import SceneStream
from hri_drivers.zenoh_session import CellSettings, is_local
from hri_drivers.zenoh_transport import ZenohTransport
from hri_predict.clock import Clock
from hri_predict.errors import ConfigError
from hri_predict.protocol.keyed_codec import SCENE, prefix
from hri_predict.source import SourceCounters


class ZenohSourceSettings(CellSettings, LiveSettings):
    """``source:`` of ``kind: zenoh``."""

    kind: Literal["zenoh"]
    key_file: str | None = Field(
        None, min_length=1, description="file with the key that the sender has, too (HMAC-SHA256)"
    )
    allow_unauthenticated: bool = Field(
        False, description="hear the network without a key: whoever may put is believed"
    )
    max_skew_s: float = Field(
        2.0, gt=0, le=60, description="with a key: how far a new sender's UTC clock may be off"
    )

    @model_validator(mode="after")
    def _protected(self) -> Self:
        ends = [*(self.connect or []), *(self.listen or [])]
        local = self.zenoh_config is None and all(is_local(end) for end in ends)
        if local or self.key_file is not None or self.allow_unauthenticated:
            return self
        raise ValueError(
            "hears the network, where anybody may say that nobody is here: set 'key_file', or "
            "'allow_unauthenticated: true' if zenoh_config keeps strangers out"
        )


class ZenohReceiver:
    """``live_source.Receiver`` of the payloads under the scene's key."""

    def __init__(self, settings: ZenohSourceSettings) -> None:
        self._transport = ZenohTransport(settings, prefix(settings.site, settings.cell), [SCENE])

    def open(self) -> None:
        """Open the session; see ``ZenohTransport.open``."""
        self._transport.open()

    def read(self, timeout_s: float) -> list[bytes]:
        """Payloads that have come.

        Raises:
            LinkError: nobody is connected.
        """
        return [unit.data for unit in self._transport.read(timeout_s)]

    def close(self) -> None:
        """Close the session."""
        self._transport.close()


class ZenohSource(LiveSource):
    """See ``live_source.LiveSource``; the arguments are those of ``udp_source.UdpSource``.

    Raises:
        ConfigError: there is no such joint map, or it has more joints than a stream can carry.
        SourceError: the key cannot be used.
    """

    settings_model = ZenohSourceSettings
    stamps_utc = True

    def __init__(
        self,
        settings: ZenohSourceSettings,
        base_dir: Path | None = None,
        clock: Clock | None = None,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        joint_map = sender_joints(settings, base_dir)
        if len(joint_map.source_joints) > MAX_JOINTS:
            raise ConfigError(
                f"source.joint_map: {len(joint_map.source_joints)} joints, a scene stream carries "
                f"{MAX_JOINTS}; leave some out of the map"
            )
        key = read_key(settings.key_file, base_dir) if settings.key_file is not None else None
        counters = SourceCounters()
        stream = SceneStream(joint_map, counters, key, settings.max_skew_s, utc_ns)
        receiver = ZenohReceiver(settings.resolved(base_dir or Path()))
        super().__init__(settings, receiver, stream, counters, joint_map, clock)
