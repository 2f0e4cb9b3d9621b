"""The far end of an slcan line: a serial CAN adapter in software, over a pseudo-terminal.

It lets a real CAN driver (python-can's ``slcan``) be run where the kernel has no CAN: the driver
opens the pseudo-terminal as its serial port, this adapter answers on the other side and hands the
frames to whoever stands in for the bus. Protocol: LAWICEL CANUSB manual v1.0A and the CAN FD
extension of the CANable 2.0 firmware (commands d, D, b, B, Y), as python-can speaks it.
"""

import contextlib
import errno
import os
import select
import tty
from collections.abc import Callable

from hri_drivers.transport import TransportBusy

from hri_predict.errors import LinkError
from hri_predict.protocol.can_codec import CanFrame

OK = b"\r"
ERROR = b"\a"
BITRATES = {
    "0": 10_000,
    "1": 20_000,
    "2": 50_000,
    "3": 100_000,
    "4": 125_000,
    "5": 250_000,
    "6": 500_000,
    "7": 750_000,
    "8": 1_000_000,
    "9": 83_300,
}
DATA_BITRATES = {"2": 2_000_000, "5": 5_000_000}
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
MAX_LINE = 1 + 8 + 1 + 128
WRITE_TIMEOUT_S = 0.05


def open_pty() -> tuple[int, str]:
    """Open a raw pseudo-terminal.

    Returns:
        The master's file descriptor, and the path that the other side opens as its serial port.
        The caller closes the descriptor; the path is gone with it.
    """
    master, slave = os.openpty()
    try:
        tty.setraw(slave)
        return master, os.ttyname(slave)
    finally:
        os.close(slave)


class SlcanAdapter:
    """An slcan adapter on file descriptor ``fd``; a ``Transport[CanFrame]`` for the bus's side.

    ``write`` sends a frame to the driver, ``read`` answers the driver's commands and returns the
    frames that it has sent. While the driver has not opened the channel, frames do not pass, as on
    the real thing.

    Args:
        fd: the master side of the pseudo-terminal; ``close`` closes it.

    Attributes:
        bitrate, data_bitrate: as the driver has set them, ``None`` before it has.
        listen_only: the driver opened the channel with ``L``.
        channel_open: whether frames pass.
        malformed: lines that were no command or no frame.
        remote_frames: remote frames, which carry nothing and are only acknowledged.
        not_passed: frames for the driver while the channel was closed.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._buffer = bytearray()
        self._skip_line = False
        self._closed = False
        self.bitrate: int | None = None
        self.data_bitrate: int | None = None
        self.listen_only = False
        self.channel_open = False
        self.malformed = 0
        self.remote_frames = 0
        self.not_passed = 0
        self._commands: dict[str, Callable[[str], bytes | None]] = {
            "S": self._set_bitrate,
            "s": lambda arg: OK if _is_hex(arg, 4) and not self.channel_open else None,
            "Y": self._set_data_bitrate,
            "O": lambda arg: self._open_channel(arg, listen_only=False),
            "L": lambda arg: self._open_channel(arg, listen_only=True),
            "C": self._close_channel,
            "V": lambda arg: b"V1013" + OK if not arg else None,
            "N": lambda arg: b"NHRI1" + OK if not arg else None,
            "F": lambda arg: b"F00" + OK if not arg else None,
            "Z": lambda arg: OK if arg in ("0", "1") else None,
        }

    def open(self) -> None:
        """Begin; the descriptor is open already.

        Raises:
            LinkError: it was closed.
        """
        if self._closed:
            raise LinkError("slcan adapter: its pseudo-terminal is closed; open a new one")
        os.set_blocking(self._fd, False)

    def write(self, unit: CanFrame) -> None:
        """Send ``unit`` to the driver, as received from the bus."""
        if not self.channel_open:
            self.not_passed += 1
            return
        self._send(to_line(unit).encode("ascii") + OK)

    def read(self, timeout_s: float) -> list[CanFrame]:
        """Answer what the driver has asked; return the frames that it has sent."""
        frames: list[CanFrame] = []
        for line in self._lines(timeout_s):
            answer = self._answer(line, frames)
            if answer is None:
                self.malformed += 1
                answer = ERROR
            if answer:
                with contextlib.suppress(TransportBusy):  # it does not read; its loss
                    self._send(answer)
        return frames

    def close(self) -> None:
        """Close the descriptor: the driver sees its adapter unplugged."""
        if not self._closed:
            self._closed = True
            self.channel_open = False
            with contextlib.suppress(OSError):
                os.close(self._fd)

    # -- commands ---------------------------------------------------------------------------------

    def _answer(self, line: str, frames: list[CanFrame]) -> bytes | None:
        """Answer one line; ``None`` if it is wrong, and then nothing was done."""
        if not line:
            return OK
        kind, argument = line[0], line[1:]
        if kind in self._commands:
            return self._commands[kind](argument)
        if not self.channel_open or self.listen_only:
            return None
        if kind in "rR":
            digits = 3 if kind == "r" else 8
            if not _is_hex(argument[:digits], digits) or argument[digits:] not in "012345678":
                return None
            self.remote_frames += 1
        else:
            frame = from_line(line)
            if frame is None:
                return None
            frames.append(frame)
        return b"z\r" if kind in "trdb" else b"Z\r"

    def _set_bitrate(self, argument: str) -> bytes | None:
        if argument not in BITRATES or self.channel_open:
            return None
        self.bitrate = BITRATES[argument]
        return OK

    def _set_data_bitrate(self, argument: str) -> bytes | None:
        if argument not in DATA_BITRATES or self.channel_open:
            return None
        self.data_bitrate = DATA_BITRATES[argument]
        return OK

    def _open_channel(self, argument: str, listen_only: bool) -> bytes | None:
        if argument or self.channel_open:
            return None
        self.channel_open, self.listen_only = True, listen_only
        return OK

    def _close_channel(self, argument: str) -> bytes | None:
        if argument:
            return None
        self.channel_open = False
        return OK

    # -- bytes ------------------------------------------------------------------------------------

    def _lines(self, timeout_s: float) -> list[str]:
        """Complete lines that have come, without their ends; overlong ones count as malformed."""
        self._buffer += self._bytes(timeout_s)
        *lines, rest = bytes(self._buffer).split(OK)
        if lines and self._skip_line:
            lines, self._skip_line = lines[1:], False
        if len(rest) > MAX_LINE:
            self.malformed += not self._skip_line
            rest, self._skip_line = b"", True
        self._buffer = bytearray(rest)
        return [line.decode("latin-1") for line in lines]

    def _bytes(self, timeout_s: float) -> bytes:
        if self._closed:
            raise LinkError("slcan adapter: closed")
        try:
            if not select.select([self._fd], [], [], timeout_s)[0]:
                return b""
            return os.read(self._fd, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno != errno.EIO:
                raise LinkError(f"slcan adapter: lost ({error})") from error
            # Nobody has the other side open: the channel is closed, but a driver may come (again).
            self.channel_open = False
            if timeout_s > 0:
                select.select([], [], [], min(timeout_s, 0.02))
            return b""

    def _send(self, data: bytes) -> None:
        try:
            while data:
                if not select.select([], [self._fd], [], WRITE_TIMEOUT_S)[1]:
                    raise TransportBusy("slcan adapter: the driver does not read")
                data = data[os.write(self._fd, data) :]
        except OSError as error:
            raise LinkError(f"slcan adapter: lost ({error})") from error


def to_line(frame: CanFrame) -> str:
    """Return the slcan line of a frame, without its end."""
    identifier = f"{frame.arbitration_id:08X}" if frame.extended else f"{frame.arbitration_id:03X}"
    kind = "b" if frame.fd else "t"
    length = FD_LENGTHS.index(len(frame.data)) if frame.fd else len(frame.data)
    return f"{kind.upper() if frame.extended else kind}{identifier}{length:X}{frame.data.hex()}"


def from_line(line: str) -> CanFrame | None:
    """Return the data frame of an slcan line; ``None`` if it is none."""
    kind = line[:1]
    if kind not in tuple("tTdDbB"):
        return None
    fd, extended = kind in "dDbB", kind.isupper()
    digits = 8 if extended else 3
    identifier, length, data = (
        line[1 : 1 + digits],
        line[1 + digits : 2 + digits],
        line[2 + digits :],
    )
    if not _is_hex(identifier, digits) or not _is_hex(length, 1):
        return None
    code = int(length, 16)
    if not fd and code > 8:
        return None
    size = FD_LENGTHS[code]
    arbitration_id = int(identifier, 16)
    if not _is_hex(data, 2 * size) or arbitration_id > (0x1FFFFFFF if extended else 0x7FF):
        return None
    return CanFrame(arbitration_id, bytes.fromhex(data), fd=fd, extended=extended)


def _is_hex(text: str, digits: int) -> bool:
    return len(text) == digits and all(c in "0123456789abcdefABCDEF" for c in text)
