"""Worst-case bits on the wire."""

import pytest

from hri_predict.protocol.can import FD_LENGTHS
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    RobotState,
    Schema,
    Status,
    Zone,
)
from hri_predict.protocol.wire import StateShape, classic_bits, fd_bits, wire_bits


def test_wire_bits() -> None:
    assert classic_bits(8) == 135
    assert classic_bits(8, extended=True) == 160
    assert wire_bits(Advice, "can") == (3 * 135, 0)
    assert wire_bits(RobotState, "can") == (5 * 135, 0)
    for joints, moving_base, parts in ((7, False, 6), (9, False, 7), (6, True, 7), (9, True, 9)):
        shape = StateShape(joints, moving_base)
        assert wire_bits(RobotState, "can", shape=shape) == (parts * 135, 0)
    with pytest.raises(ValueError, match="does not carry"):
        wire_bits(Zone, "can")
    assert wire_bits(Zone, "can_fd", items=17) == tuple(6 * a for a in fd_bits(64))
    for kind in (Advice, Status, RobotState, Schema, Acknowledge):
        assert wire_bits(kind, "can_fd").data >= 8 * 9


def stuffed(bits: str) -> int:
    """Length of a bit sequence with a stuff bit after each five equal ones (a stuff bit counts)."""
    count, run, last = 0, 0, ""
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        count += 1
        if run == 5:
            count, run, last = count + 1, 1, "10"[int(bit)]
    return count


@pytest.mark.parametrize("length", [0, 1, 4, 8])
@pytest.mark.parametrize("extended", [False, True])
def test_the_worst_pattern_of_a_classic_frame_reaches_the_bound(
    length: int, extended: bool
) -> None:
    """From start to CRC a frame has 34 (54) + 8 n bits under stuffing, 13 without, pause included.

    The worst pattern begins with five equal bits, then alternates in fours.
    """
    under = (54 if extended else 34) + 8 * length
    worst = "00000" + "11110000" * (under // 8 + 1)
    assert classic_bits(length, extended) == stuffed(worst[:under]) + 13


@pytest.mark.parametrize("length", FD_LENGTHS)
def test_an_fd_frame_is_never_shorter_than_its_parts(length: int) -> None:
    """17 + 5 + 8 n bits under dynamic stuffing, then the fixed-stuffed CRC field and the end."""
    worst = ("00000" + "11110000" * (length + 3))[: 22 + 8 * length]
    crc = 4 + 17 + 6 if length <= 16 else 4 + 21 + 7
    assert sum(fd_bits(length)) == stuffed(worst) + crc + 14
