"""``kind: zenoh``: scenes under ``hri/<site>/<cell>/scene``; see ``docs/fleet.md``.

Each payload is one datagram of the node's own scene stream (``drivers/SCENE_STREAM.md``), so that a
key (HMAC) protects a scene from its sender to the node, through whatever router lies between.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from hri_drivers.live_source import LiveSource
from hri_drivers.stream_settings import StreamSettings, stream_of
from hri_drivers.zenoh_session import CellSettings, is_local
from hri_drivers.zenoh_transport import ZenohTransport
from hri_predict.clock import Clock
from hri_predict.protocol.keyed_codec import SCENE, prefix


class ZenohSourceSettings(CellSettings, StreamSettings):
    """``source:`` of ``kind: zenoh``."""

    kind: Literal["zenoh"]
    allow_unauthenticated: bool = Field(
        False, description="hear the network without a key: whoever may put is believed"
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
        stream = stream_of(settings, base_dir, utc_ns)
        receiver = ZenohReceiver(settings.resolved(base_dir or Path()))
        super().__init__(settings, receiver, stream, stream.counters, stream.joint_map, clock)
