"""The far end of an slcan line: a serial CAN adapter in software, over a pseudo-terminal.

With it a real CAN driver (python-can's ``slcan``) runs on kernels without CAN: the driver opens the
pseudo-terminal as its serial port, and this adapter answers on the other side and passes the frames
to the simulated bus. Protocol: LAWICEL CANUSB manual v1.0A and the CAN FD extension of the CANable
2.0 firmware (commands d, D, b, B, Y), as python-can uses it.
"""

import contextlib
from collections.abc import Callable

from hri_drivers.wires.transport import TransportBusy
from hri_predict.protocol.can import CanFrame
from hri_sim.wires.pty import PtyTransport, open_pty

__all__ = ["SlcanAdapter", "from_line", "open_pty", "to_line"]

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
_LENGTHS = tuple("012345678")
MAX_LINE = 1 + 8 + 1 + 128


class SlcanAdapter:
    """An slcan adapter on file descriptor ``fd``; a ``Transport[CanFrame]`` for the bus's side.

    ``write`` sends a frame to the driver, ``read`` answers the driver's commands and returns the
    frames that it has sent. Until the driver opens the channel, no frames pass, as on a real
    adapter.

    Args:
        fd: the master side of the pseudo-terminal; ``close`` closes it.

    Attributes:
        bitrate, data_bitrate: as set by the driver; ``None`` before.
        listen_only: whether the driver opened the channel with ``L``.
        channel_open: whether frames pass.
        malformed: number of lines that were neither a valid command nor a valid frame.
        refused: number of valid commands and frames at the wrong time, such as frames while the
            channel is closed.
        remote_frames: number of remote frames, which carry no data and are only acknowledged.
        not_passed: number of frames for the driver while the channel was closed.
    """

    def __init__(self, fd: int) -> None:
        self._port = PtyTransport(fd)
        self._buffer = bytearray()
        self._skip_line = False
        self.bitrate: int | None = None
        self.data_bitrate: int | None = None
        self.listen_only = False
        self.channel_open = False
        self.malformed = 0
        self.remote_frames = 0
        self.not_passed = 0
        self.refused = 0
        self._commands: dict[str, Callable[[str], bytes | None]] = {
            "S": self._set_bitrate,
            "s": self._set_register,
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
        """Check that the descriptor is still open.

        Raises:
            LinkError: it was closed.
        """
        self._port.open()

    def write(self, unit: CanFrame) -> None:
        """Send ``unit`` to the driver, as received from the bus."""
        if not self.channel_open:
            self.not_passed += 1
            return
        self._port.write(to_line(unit).encode("ascii") + OK)

    def read(self, timeout_s: float) -> list[CanFrame]:
        """Answer the driver's commands; return the frames that it has sent."""
        frames: list[CanFrame] = []
        for line in self._lines(timeout_s):
            answer = self._answer(line, frames)
            if answer is None:
                self.malformed += 1
                answer = ERROR
            if answer:
                with contextlib.suppress(TransportBusy):  # it does not read; its loss
                    self._port.write(answer)
        return frames

    def close(self) -> None:
        """Close the descriptor; for the driver, its adapter is unplugged."""
        self.channel_open = False
        self._port.close()

    # -- commands ---------------------------------------------------------------------------------

    def _answer(self, line: str, frames: list[CanFrame]) -> bytes | None:
        """Return the answer to one line; ``None`` if it is wrong and has no effect."""
        if not line:
            return OK
        kind, argument = line[0], line[1:]
        if kind in self._commands:
            return self._commands[kind](argument)
        if kind in "rR":
            digits = 3 if kind == "r" else 8
            if not _is_hex(argument[:digits], digits) or argument[digits:] not in _LENGTHS:
                return None
            frame = None
        else:
            frame = from_line(line)
            if frame is None:
                return None
        if not self.channel_open or self.listen_only:
            return self._refuse()
        if frame is None:
            self.remote_frames += 1
        else:
            frames.append(frame)
        return b"z\r" if kind in "trdb" else b"Z\r"

    def _set_bitrate(self, argument: str) -> bytes | None:
        if argument not in BITRATES:
            return None
        if self.channel_open:
            return self._refuse()
        self.bitrate = BITRATES[argument]
        return OK

    def _set_register(self, argument: str) -> bytes | None:
        if not _is_hex(argument, 4):
            return None
        return self._refuse() if self.channel_open else OK

    def _set_data_bitrate(self, argument: str) -> bytes | None:
        if argument not in DATA_BITRATES:
            return None
        if self.channel_open:
            return self._refuse()
        self.data_bitrate = DATA_BITRATES[argument]
        return OK

    def _open_channel(self, argument: str, listen_only: bool) -> bytes | None:
        if argument:
            return None
        if self.channel_open:
            return self._refuse()
        self.channel_open, self.listen_only = True, listen_only
        return OK

    def _close_channel(self, argument: str) -> bytes | None:
        if argument:
            return None
        self.channel_open = False
        return OK

    def _refuse(self) -> bytes:
        """Return the answer to a valid command at the wrong time."""
        self.refused += 1
        return ERROR

    # -- bytes ------------------------------------------------------------------------------------

    def _lines(self, timeout_s: float) -> list[str]:
        """Return the complete lines received, without their ends; overlong ones are malformed."""
        self._buffer += b"".join(self._port.read(timeout_s))
        if self._port.hung_up:  # the driver has closed the port; it may open it again
            self.channel_open = False
        *lines, rest = bytes(self._buffer).split(OK)
        if lines and self._skip_line:
            lines, self._skip_line = lines[1:], False
        if len(rest) > MAX_LINE:
            self.malformed += not self._skip_line
            rest, self._skip_line = b"", True
        self._buffer = bytearray(rest)
        return [line.decode("latin-1") for line in lines]


def to_line(frame: CanFrame) -> str:
    """Return the slcan line of a frame, without its end.

    FD data are filled up with zeros to a length that FD knows.
    """
    identifier = f"{frame.arbitration_id:08X}" if frame.extended else f"{frame.arbitration_id:03X}"
    kind = "b" if frame.fd else "t"
    size = next(n for n in FD_LENGTHS if n >= len(frame.data))
    data = frame.data + bytes(size - len(frame.data))
    kind = kind.upper() if frame.extended else kind
    return f"{kind}{identifier}{FD_LENGTHS.index(size):X}{data.hex()}"


def from_line(line: str) -> CanFrame | None:
    """Return the data frame of an slcan line; ``None`` if it is not a data frame."""
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
