"""``kind: qualisys``: the skeletons of Qualisys Track Manager, over TCP; see ``packets``.

QTM's frame is right-handed in millimetres, with z up. A skeleton's name identifies the person. A
segment that was not measured is unobserved.
"""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from hri_drivers.sources.live import LiveSettings, LiveSource, sender_joints
from hri_drivers.sources.mocap.decoder import MocapDecoder
from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.qualisys.packets import PacketSplitter, command
from hri_drivers.sources.qualisys.reader import QtmReader
from hri_drivers.sources.tcp import StreamClient
from hri_predict.base.clock import Clock
from hri_predict.base.errors import SourceError
from hri_predict.contracts.source import SourceCounters

DEFAULT_PORT = 22223
ASK_S = 1.0
"""Interval at which an unanswered command is repeated."""


class QualisysSettings(MocapSettings):
    """``source:`` of ``kind: qualisys``."""

    kind: Literal["qualisys"]
    joint_map: str = Field("qualisys24", description="joint map of QTM's segments, or your own map")
    keeps_ids: bool = Field(True, description="a skeleton that returns is the same person")
    host: str = Field("127.0.0.1", description="address of the machine that runs QTM")
    port: int = Field(
        DEFAULT_PORT, ge=1, le=65535, description="QTM's port for little-endian clients"
    )


WHOLE_S = 0.5
"""Time after which an incomplete packet is considered to have a wrong size."""


class QtmClient(StreamClient):
    """A connection to QTM that sends the reader's commands; see ``StreamClient``."""

    def __init__(
        self,
        host: str,
        port: int,
        wanted: Callable[[], str | None],
        *,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(host, port, PacketSplitter)
        self._wanted = wanted
        self._monotonic_s = monotonic_s
        self._asked: tuple[str, float] | None = None
        self._whole_s: float | None = None  # since when a packet has not become whole

    def open(self) -> None:
        """Connect; the exchange starts with the next ``read``."""
        super().open()
        self._asked = self._whole_s = None

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the packets that arrive; send the command that is due.

        Raises:
            SourceError: the connection is lost, or a packet stays incomplete because its size is
                wrong; all later packets would be read as its content.
        """
        wanted, now_s = self._wanted(), self._monotonic_s()
        if wanted is None:
            self._asked = None
        elif self._asked is None or self._asked[0] != wanted or now_s - self._asked[1] >= ASK_S:
            self._asked = wanted, now_s
            if self._connection is not None:
                with contextlib.suppress(OSError):  # ``read`` will say that it is lost
                    self._connection.sendall(command(wanted))
        packets = super().read(timeout_s)
        assert isinstance(self._splitter, PacketSplitter)
        if packets or not self._splitter.waits:
            self._whole_s = None
        elif self._whole_s is None:
            self._whole_s = now_s
        elif now_s - self._whole_s > WHOLE_S:
            host, port = self._address
            raise SourceError(f"{host}:{port}: a packet stayed incomplete; connecting again")
        return packets


class QualisysSource(LiveSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model: ClassVar[type[LiveSettings]] = QualisysSettings

    def __init__(
        self, settings: QualisysSettings, base_dir: Path | None = None, clock: Clock | None = None
    ) -> None:
        """Build the source without opening it.

        Raises:
            ConfigError: the joint map is wrong.
        """
        counters = SourceCounters()
        joint_map = sender_joints(settings, base_dir)
        reader = QtmReader(joint_map.source_joints, counters)
        super().__init__(
            settings=settings,
            receiver=QtmClient(settings.host, settings.port, lambda: reader.wanted),
            decoder=MocapDecoder(
                reader=reader, settings=settings, joint_map=joint_map, counters=counters
            ),
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )
