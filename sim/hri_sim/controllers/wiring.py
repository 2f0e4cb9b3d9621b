"""The wires between the controllers of one robot: speed permits, and the true state of the arm.

A monitor sends the drive a hard-wired speed permit, like a second safety channel in a real cell.
This wire is simulated by a small file that both processes map into memory. A permit that is
missing, torn or older than ``PERMIT_STALE_S`` reads as 0: a dead monitor stops the robot. A permit
carries its cause, so that a stop advised to the monitor does not count as one of the wire.

The same file carries the arm's true joint state, which the monitor reports and the referee uses. On
the virtual clock, plain values replace the file.
"""

import mmap
import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self, get_args

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.messages import Level
from hri_sim.controllers.controller import Watchdog
from hri_sim.controllers.tools import NOTHING, Mounted

PERMIT_STALE_S = 0.1
NO_PERMIT = "other channel"
"""Cause of a permit of 0 that cannot be trusted, or states no cause."""
_CAUSES = (NO_PERMIT, *(level.name.lower() for level in Level), *get_args(Watchdog))
_TRUTH_STALE_S = 0.25  # a drive silent for longer is dead; its brakes have closed
_CARRIED_S = 0.1  # its motion is extrapolated for this long
_MAX_JOINTS = 12  # nine, and three coordinates of a moving base
_VALUES = 3 + 2 * _MAX_JOINTS
_NO_TOOL = -1.0
_BODY = struct.Struct(f"<qQ{_VALUES}d")  # stamp, number of values, values
_SLOT = 8 + _BODY.size  # CRC-32 and padding, then the body
_REGISTER = 2 * _SLOT


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The arm's true state: (N,) rad and rad/s, m and m/s, at ``stamp_ns``; a moving base first.

    ``path_s`` is its position along the path. ``mounted`` is its tool, as reported by its
    controller.
    """

    q: Floats
    qd: Floats
    path_s: float
    stamp_ns: int
    mounted: Mounted = NOTHING

    def at(self, now_ns: int) -> tuple[Floats, Floats]:
        """Return the joints at ``now_ns``: extrapolated, or at rest once the drive is dead."""
        if not self.alive(now_ns):
            return self.q, np.zeros_like(self.qd)
        ahead_s = min(max((now_ns - self.stamp_ns) * 1e-9, 0.0), _CARRIED_S)
        return self.q + self.qd * ahead_s, self.qd

    def alive(self, now_ns: int) -> bool:
        """Whether the drive still moves the arm."""
        return now_ns - self.stamp_ns <= _TRUTH_STALE_S * 1e9


class Wiring:
    """One robot's wires: one truth, and one permit per channel (controller).

    Each register has two slots that its single writer fills in turn, each with a CRC. A reader uses
    the newest complete slot, so neither side ever waits and a torn write is never used.
    """

    def __init__(self, buffer: "bytearray | mmap.mmap", channels: Sequence[str]) -> None:
        """``channels``: names, in the same order in every process."""
        self._buffer = buffer
        self._channels = {name: 1 + i for i, name in enumerate(channels)}
        self._next_slot = [0] * (1 + len(channels))

    @staticmethod
    def in_memory(channels: Sequence[str]) -> "Wiring":
        """Wires within one process."""
        return _InMemory(channels)

    @classmethod
    def create(cls, path: Path, channels: Sequence[str]) -> Self:
        """Create the wires: a new file of zeros, which reads as "no permit"."""
        path.write_bytes(bytes(_REGISTER * (1 + len(channels))))
        return cls.open(path, channels)

    @classmethod
    def open(cls, path: Path, channels: Sequence[str]) -> Self:
        """Connect to wires that another process created.

        Raises:
            OSError: the file does not exist.
            ValueError: it was created for a different number of channels.
        """
        size = _REGISTER * (1 + len(channels))
        descriptor = os.open(path, os.O_RDWR)
        try:
            if os.fstat(descriptor).st_size != size:
                raise ValueError(f"wiring {path}: created for a different number of channels")
            return cls(mmap.mmap(descriptor, size), channels)
        finally:
            os.close(descriptor)

    def set_permit(
        self, channel: str, speed_m_s: float, now_ns: int, *, cause: str = NO_PERMIT
    ) -> None:
        """Set the speed that ``channel`` permits, and why: a level or a watchdog."""
        self._write(self._channels[channel], now_ns, [speed_m_s, float(_CAUSES.index(cause))])

    def permit(self, channel: str, now_ns: int) -> tuple[float, str]:
        """Return the speed that ``channel`` permits, m/s, and its cause.

        0 and ``NO_PERMIT`` if it is stale or was never set.
        """
        read = self._read(self._channels[channel])
        if read is None:
            return 0.0, NO_PERMIT
        stamp_ns, values = read
        # a stamp slightly ahead is valid: the other process wrote after this one read its clock
        if abs(now_ns - stamp_ns) > PERMIT_STALE_S * 1e9 or len(values) != 2:
            return 0.0, NO_PERMIT
        speed_m_s, cause = values
        permitted = speed_m_s if speed_m_s > 0 else 0.0  # NaN compares false
        return permitted, _CAUSES[int(cause)]

    def lowest_permit(self, now_ns: int) -> tuple[float, str]:
        """Return the lowest permit of all channels, m/s, and its cause."""
        permits = [self.permit(name, now_ns) for name in self._channels]
        return min(permits, key=lambda permit: permit[0], default=(0.0, NO_PERMIT))

    def set_truth(
        self,
        q: Floats,
        qd: Floats,
        path_s: float,
        now_ns: int,
        *,
        mounted: Mounted = NOTHING,
    ) -> None:
        """Publish the arm's joints (N,), N up to 12, and its tool."""
        tool = _NO_TOOL if mounted.number is None else float(mounted.number)
        values = [path_s, tool, float(mounted.confirmed)]
        self._write(0, now_ns, [*values, *q.tolist(), *qd.tolist()])

    def truth(self) -> Truth | None:
        """Return the arm's state as last published; ``None`` before the first time."""
        read = self._read(0)
        if read is None:
            return None
        stamp_ns, values = read
        path_s, tool, confirmed, *joints = values
        n = len(joints) // 2
        mounted = Mounted(None if tool == _NO_TOOL else int(tool), confirmed == 1.0)
        return Truth(np.array(joints[:n]), np.array(joints[n:]), path_s, stamp_ns, mounted)

    def close(self) -> None:
        """Release the file."""
        if isinstance(self._buffer, mmap.mmap):
            self._buffer.close()

    def _write(self, register: int, stamp_ns: int, values: list[float]) -> None:
        padded = values + [0.0] * (_VALUES - len(values))
        body = _BODY.pack(stamp_ns, len(values), *padded)
        start = register * _REGISTER + self._next_slot[register] * _SLOT
        self._next_slot[register] ^= 1
        self._buffer[start : start + _SLOT] = struct.pack("<II", zlib.crc32(body), 0) + body

    def _read(self, register: int) -> tuple[int, list[float]] | None:
        newest: tuple[int, list[float]] | None = None
        for slot in (0, 1):
            start = register * _REGISTER + slot * _SLOT
            raw = bytes(self._buffer[start : start + _SLOT])
            crc, _ = struct.unpack_from("<II", raw)
            if crc == 0 or zlib.crc32(raw[8:]) != crc:  # empty, or just being written
                continue
            stamp_ns, count, *values = _BODY.unpack_from(raw, 8)
            if newest is None or stamp_ns >= newest[0]:
                newest = (stamp_ns, values[: min(count, _VALUES)])
        return newest


class _InMemory(Wiring):
    """Wires within one thread: writes cannot be torn, so plain values replace bytes and CRCs."""

    def __init__(self, channels: Sequence[str]) -> None:
        super().__init__(bytearray(), channels)
        self._registers: list[tuple[int, list[float]] | None] = [None] * (1 + len(channels))

    def _write(self, register: int, stamp_ns: int, values: list[float]) -> None:
        self._registers[register] = (stamp_ns, values)

    def _read(self, register: int) -> tuple[int, list[float]] | None:
        return self._registers[register]
