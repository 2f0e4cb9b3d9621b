"""What a link says of bytes that hold no frame, and of whole messages that it refuses."""

import math

import pytest

from hri_drivers.links.can.transport import _Lines
from hri_drivers.links.framed import NOISE_BYTES
from hri_drivers.wires.serial import MAX_READ
from hri_predict.base.clock import VirtualClock
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.serial import SerialSender
from tests.hri_drivers.links.pairs import make
from tests.messages import make_state


def in_degrees(counter):
    return make_state((90.0,) * 6, counter=counter)


def test_bytes_without_a_frame_are_said_once(caplog):
    pair = make("serial pipe", VirtualClock())
    pair.link.service(0)
    pair.peer.transport.open()
    for k in range(40):
        pair.peer.transport.write(bytes([0x80, 0x0D, 0x0A, 0xFF] * 25))
        pair.link.service(k)
    lines = [r.getMessage() for r in caplog.records]
    assert len(lines) == 1
    assert f"bytes arrive ({NOISE_BYTES}), but no frame: check" in lines[0]
    assert "same baud rate" in str(pair.link.last_error)


@pytest.mark.parametrize(
    ("kind", "sender"), [("serial pipe", SerialSender), ("can pipe", CanSender)]
)
def test_states_in_degrees_are_refused_with_the_reason(kind, sender, caplog):
    pair = make(kind, VirtualClock())
    pair.link.service(0)
    pair.peer.transport.open()
    encoder = sender()
    for k in range(50):
        encoded = encoder.encode(in_degrees(k))
        for unit in encoded if isinstance(encoded, list) else [encoded]:
            pair.peer.transport.write(unit)
        pair.link.service(k * 20_000_000)
    assert pair.link.take() == []
    (line,) = [r.getMessage() for r in caplog.records]
    assert "messages refused: a joint of RobotState" in line
    assert "radians are meant, not degrees" in line
    assert math.degrees(1) > 8.19  # so degrees mostly lie beyond the field's range


class Port:
    """A serial port that has its chunks, then nothing."""

    timeout = 0.0

    def __init__(self, *chunks):
        self._chunks = list(chunks)

    @property
    def in_waiting(self):
        return len(self._chunks[0]) if self._chunks else 0

    def read(self, size):
        if not self._chunks:
            return b""
        chunk, self._chunks[:1] = self._chunks[0], [self._chunks[0][size:]]
        if not self._chunks[0]:
            del self._chunks[0]
        return chunk[:size]


def test_an_adapter_that_ends_lines_with_line_feed_too_is_understood():
    lines = _Lines(Port(b"t6801AA\r\nt6801", b"BB\r\n", b"\n\r\a", b"z\rt68"))
    assert [lines.read(0.1) for _ in range(4)] == ["t6801AA\r", "t6801BB\r", "z\r", None]


def test_a_line_that_is_not_text_costs_that_line_alone():
    lines = _Lines(Port(b"t68\xff\rt6801AA\r", b"x" * (MAX_READ + 1)))
    with pytest.raises(UnicodeDecodeError):
        lines.read(0.1)
    assert lines.read(0.1) == "t6801AA\r"
    with pytest.raises(ValueError, match="no line ends"):
        lines.read(0.1)
    assert lines.read(0.1) is None
