"""``kind: zenoh``: scenes under ``hri/<site>/<cell>/scene``; see ``docs/guides/fleet.md``.

Each payload is one datagram of the node's own scene stream (``drivers/SCENE_STREAM.md``), so a key
(HMAC) protects a scene all the way from sender to node, through any router.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from hri_drivers.sources.live import LiveSource
from hri_drivers.sources.scene_stream.settings import StreamSettings, stream_of
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import CellSettings, is_local
from hri_predict.base.clock import Clock
from hri_predict.protocol.keyed import SCENE, prefix


class ZenohSourceSettings(CellSettings, StreamSettings):
    """``source:`` of ``kind: zenoh``."""

    kind: Literal["zenoh"]
    allow_unauthenticated: bool = Field(
        False,
        description="without a key: believe any program that may publish",
    )

    @model_validator(mode="after")
    def _protected(self) -> Self:
        ends = [*(self.connect or []), *(self.listen or [])]
        local = self.zenoh_config is None and all(is_local(end) for end in ends)
        if local or self.key_file is not None or self.allow_unauthenticated:
            return self
        raise ValueError(
            "zenoh accepts network input, and any program could claim an empty room: set "
            "'key_file', or 'allow_unauthenticated: true' if zenoh_config keeps strangers out"
        )


class ZenohReceiver:
    """``hri_drivers.sources.live.Receiver`` of the payloads under the scene's key."""

    def __init__(self, settings: ZenohSourceSettings) -> None:
        self._transport = ZenohTransport(settings, prefix(settings.site, settings.cell), [SCENE])

    def open(self) -> None:
        """Open the session; see ``ZenohTransport.open``."""
        self._transport.open()

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the payloads that have arrived.

        Raises:
            LinkError: there is no connection.
        """
        return [unit.data for unit in self._transport.read(timeout_s)]

    def close(self) -> None:
        """Close the session."""
        self._transport.close()


class ZenohSource(LiveSource):
    """See ``hri_drivers.sources.live.LiveSource``; arguments as for ``udp_source.UdpSource``.

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
        super().__init__(
            settings=settings,
            receiver=receiver,
            decoder=stream,
            counters=stream.counters,
            joint_map=stream.joint_map,
            clock=clock,
        )
