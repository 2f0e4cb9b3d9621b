"""Reads captures from QTM's data, and requests the necessary information one command at a time."""

from collections.abc import Mapping, Sequence

import numpy as np

from hri_drivers.sources.mocap.frames import Frame, FrameError, person, shown
from hri_drivers.sources.qualisys import packets
from hri_drivers.sources.qualisys.packets import Segments
from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats
from hri_predict.contracts.source import SourceCounters

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
        people = [
            self._person(name, parts, segments)
            for (name, parts), segments in zip(self._names, frame.skeletons, strict=True)
        ]
        return Frame(stamp_ns=frame.time_us * 1000, number=frame.number, people=tuple(people))

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
