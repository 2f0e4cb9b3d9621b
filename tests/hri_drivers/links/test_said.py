"""What a link says of bytes that hold no frame, and of whole messages that it refuses."""

import math

import pytest
from can.interfaces.slcan import slcanBus

from hri_drivers.links.can.transport import _read_any_line_end
from hri_drivers.links.framed import NOISE_BYTES
from hri_predict.base.clock import VirtualClock
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.protocol.serial import SerialSender
from tests.hri_drivers.links.pairs import make


def in_degrees(counter):
    return RobotState(
        robot=0, mode=RobotMode.AUTOMATIC, counter=counter,
        positions=(90.0,) * 6, velocities=(0.0,) * 6,
    )  # fmt: skip


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


def test_an_adapter_that_ends_lines_with_line_feed_too_is_understood():
    bus = slcanBus.__new__(slcanBus)
    lines = iter(["t6801AA\r", "\nt6801BB\r", "\n", "", None])
    bus._read = lambda timeout: next(lines)  # type: ignore[method-assign]
    _read_any_line_end(bus)
    assert [bus._read(0.0) for _ in range(5)] == ["t6801AA\r", "t6801BB\r", "", "", None]
