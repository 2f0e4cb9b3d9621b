"""``kind: serial_skeleton``: the node's own scene stream over a serial line.

The datagrams are those of the UDP stream (``drivers/SCENE_STREAM.md``), with their CRC or tag. Each
datagram is COBS-encoded and ends with a zero byte, as on the links: corrupt bytes affect only their
own frame.
"""

from pathlib import Path
from typing import ClassVar, Literal, Self

from cobs import cobs
from pydantic import Field, field_validator, model_validator

from hri_drivers.sources.scene_stream.codec import MAX_DATAGRAM
from hri_drivers.sources.scene_stream.receiver import SceneStream
from hri_drivers.sources.scene_stream.stream_source import StreamSettings, StreamSource
from hri_drivers.sources.sent import SentScene
from hri_drivers.wires.serial import Parity, SerialTransport, StopBits, demand_serial_device
from hri_drivers.wires.usb_ports import UsbDevice
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.serial import Delimited

MAX_ENCODED = MAX_DATAGRAM + MAX_DATAGRAM // 254 + 1  # COBS adds one byte for each 254 begun


class SerialSkeletonSettings(StreamSettings):
    """``source:`` of ``kind: serial_skeleton``."""

    kind: Literal["serial_skeleton"]
    port: str | None = Field(
        None, min_length=1, description="device path or pyserial URL; not with 'usb'"
    )
    usb: UsbDevice | None = Field(
        None,
        description="instead of 'port': a USB adapter, identified independently of its port name",
    )
    baudrate: int = Field(
        921_600, ge=1200, le=12_000_000, description="bit rate of the line, same as the sender's"
    )
    parity: Parity = Field("none", description="parity bit, same as the sender's")
    stop_bits: StopBits = Field(1, description="stop bits, same as the sender's")
    rtscts: bool = Field(False, description="hardware handshake")

    safety: ClassVar[Safety] = harmless("baudrate", "stop_bits", "rtscts")

    @model_validator(mode="after")
    def _has_port(self) -> Self:
        if (self.port is None) == (self.usb is None):
            raise ValueError("give either 'port' (a device path or URL) or 'usb'")
        return self

    @field_validator("port")
    @classmethod
    def _is_serial(cls, value: str | None) -> str | None:
        return None if value is None else demand_serial_device(value)


class FramedStream:
    """Turns COBS frames into scenes; buffers at most one frame.

    See ``hri_drivers.sources.live.Decoder``.

    Args:
        stream: decodes the content of the frames.
        counters: shared with ``stream``.
    """

    def __init__(self, stream: SceneStream, counters: SourceCounters) -> None:
        self._stream = stream
        self._counters = counters
        self._frames = Delimited(b"\0", MAX_ENCODED)

    def reset(self) -> None:
        """Discard the current frame and scene."""
        self._stream.reset()
        self._frames.reset()

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """Take bytes as they arrive; return the scenes that they complete."""
        frames = self._frames.feed(data)
        return [scene for frame in frames for scene in self._frame(frame, received_ns)]

    def _frame(self, encoded: bytes, received_ns: int) -> list[SentScene]:
        if len(encoded) > MAX_ENCODED:
            self._refuse(f"more than {MAX_ENCODED} bytes without an end of frame")
            return []
        try:
            datagram = cobs.decode(encoded)
        except cobs.DecodeError:
            self._refuse("a frame is not COBS; check baud rate and parity")
            return []
        return self._stream.feed(datagram, received_ns)

    def _refuse(self, why: str) -> None:
        self._counters.packets += 1
        self._counters.malformed += 1
        self._counters.note(why)


class SerialSkeletonSource(StreamSource):
    """See ``StreamSource``."""

    settings_model = SerialSkeletonSettings

    @staticmethod
    def _make_receiver(settings: SerialSkeletonSettings, base_dir: Path) -> SerialTransport:
        return SerialTransport(
            settings.usb or settings.port or "",
            settings.baudrate,
            rtscts=settings.rtscts,
            parity=settings.parity,
            stop_bits=settings.stop_bits,
        )

    @staticmethod
    def _make_decoder(stream: SceneStream) -> FramedStream:
        return FramedStream(stream, stream.counters)


def framed(datagram: bytes) -> bytes:
    """Return a datagram in its form on the line."""
    return bytes(cobs.encode(datagram)) + b"\0"
