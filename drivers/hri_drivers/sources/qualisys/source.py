"""``kind: qualisys``: the skeletons of Qualisys Track Manager, over TCP; see ``packets``.

QTM's frame is right-handed in millimetres, with z up. A skeleton's name identifies the person. A
segment that was not measured is unobserved.
"""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hri_drivers.sources.live import LiveSettings, LiveSource, sender_joints
from hri_drivers.sources.mocap.decoder import MocapDecoder
from hri_drivers.sources.mocap.frames import Frame, FrameError, person, shown
from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.qualisys import packets
from hri_drivers.sources.qualisys.packets import PacketSplitter, Segments, command
from hri_drivers.sources.sent import SentPerson
from hri_drivers.sources.tcp import StreamClient
from hri_predict.base.arrays import Floats
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


VERSION = "Version 1.25"
PARAMETERS = "GetParameters Skeleton"
STREAM = "StreamFrames AllFrames Skeleton:global"
ROOT = "Hips"
MOST_NAMES = 1000
LOCAL_MM = 700.0
"""If all segments except the root are within this distance of the origin, they are relative to
their parents: no body fits into such a small sphere."""


class QtmReader:
    """See ``hri_drivers.sources.mocap.frames.Reader``; expects whole packets.

    Args:
        joints: names of segments, the joints of the source.
        counters: counts ``ignored``.

    Attributes:
        wanted: the command to send to QTM; ``None`` while data arrive.
    """

    def __init__(self, joints: Sequence[str], counters: SourceCounters) -> None:
        self.wanted: str | None = VERSION
        self._joints = joints
        self._counters = counters
        self._names: list[tuple[str, dict[int, str]]] = []
        self._ids: dict[str, int] = {}

    def reset(self) -> None:
        """Restart the exchange: the connection is new."""
        self.wanted = VERSION

    def pause(self) -> None:
        """Do nothing: each packet is complete."""

    def read(self, data: bytes) -> Frame | None:
        """See ``Reader``."""
        kind, content = packets.content(data)
        if kind == packets.DATA:
            return self._frame(packets.frame(content))
        text = content.rstrip(b"\0").decode("utf-8", "replace")
        if kind == packets.ERROR:
            raise FrameError(f"QTM says: {shown(text)}")
        if kind == packets.XML and self.wanted == PARAMETERS:
            self._names, self.wanted = packets.names(content), STREAM
        elif kind == packets.COMMAND and text.startswith("Version set") and self.wanted == VERSION:
            self.wanted = PARAMETERS
        elif kind == packets.NO_MORE_DATA:
            self._counters.note("qualisys: QTM has no data; start the real-time preview")
            self.wanted = STREAM
        else:
            self._counters.ignored += 1
            if kind == packets.COMMAND and not text.startswith("QTM RT Interface"):
                self._counters.note(f"qualisys: QTM's answer: {shown(text)}")
        return None

    def _frame(self, frame: packets.QtmFrame) -> Frame | None:
        if self.wanted not in (None, STREAM):
            self._counters.ignored += 1  # of an exchange that began again
            return None
        known = [segments.keys() for _, segments in self._names]
        if [segments.keys() for segments in frame.skeletons] != known:
            self.wanted = PARAMETERS
            raise FrameError(
                "the skeletons differ from the parameters; requesting the parameters again"
            )
        self.wanted = None
        if not self._names:
            self._counters.note(
                "qualisys: QTM has no skeleton, so no person is seen; define a skeleton for each "
                "person and solve skeletons in QTM's real-time actions"
            )
        people = [
            self._person(name, parts, segments)
            for (name, parts), segments in zip(self._names, frame.skeletons, strict=True)
        ]
        return Frame(
            stamp_ns=frame.time_us * 1000,
            number=frame.number,
            people=tuple(people),
            tracks=bool(self._names),
        )

    def _person(self, name: str, parts: Mapping[int, str], segments: Segments) -> SentPerson:
        if not set(parts.values()) & set(self._joints):
            raise FrameError("no segment of the joint map; correct 'joint_map'")
        found: Floats = np.full((len(self._joints), 3), np.nan)
        for number, place in segments.items():
            if parts[number] in self._joints:
                found[self._joints.index(parts[number])] = place
        others = np.array([p for k, p in segments.items() if parts[k] != ROOT])
        measured = others[np.isfinite(others).all(axis=1)] if len(others) else others
        if len(measured) and np.linalg.norm(measured, axis=1).max() < LOCAL_MM:
            raise FrameError("a relative stream: segments in local coordinates; update QTM")
        return person(self._id(name), found)

    def _id(self, name: str) -> int:
        if name not in self._ids:
            if len(self._ids) >= MOST_NAMES:
                raise FrameError(f"more than {MOST_NAMES} names of skeletons since the start")
            self._ids[name] = len(self._ids) + 1
        return self._ids[name]
