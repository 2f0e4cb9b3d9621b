"""CAN ids keep robots and links apart, with 11 and 29 bits."""

from typing import Any

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanReceiver, CanSender
from hri_predict.protocol.messages import (
    Advice,
    Level,
)
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.protocol.drawn import (
    sent_through,
)
from tests.hri_predict.protocol.samples import ADVICE


def test_robots_and_links_keep_apart() -> None:
    sender, receiver = CanSender(), CanReceiver()
    for i in range(50):
        for robot in range(8):
            frames = sender.encode(
                Advice(robot=robot, level=Level.WARN, reason=Reason.NONE, latch_id=i)
            )
            assert [f.arbitration_id for f in frames] == [
                DEFAULT_BASE_ID + 8 * robot + part for part in range(3)
            ]
            assert [m for f in frames for m in receiver.feed(f)] == [
                Advice(robot=robot, level=Level.WARN, reason=Reason.NONE, latch_id=i)
            ]
    elsewhere = CanReceiver(base_id=0x100)
    assert elsewhere.feed(frames[0]) == []
    assert elsewhere.counters.ignored == 1


@pytest.mark.parametrize("fd", [False, True])
def test_extended_ids(fd: bool) -> None:
    ids: dict[str, Any] = {"base_id": 0x18FF4000, "extended": True}
    assert sent_through(ADVICE, fd, **ids)
    assert all(f.extended for f in CanSender(fd, **ids).encode(ADVICE))
    standard = CanReceiver(fd)
    for frame in CanSender(fd, extended=True).encode(ADVICE):
        assert standard.feed(frame) == []
    assert standard.counters.received == 0


@pytest.mark.parametrize(("base", "extended"), [(0x7C0, False), (-1, False), (0x1FFFFFFF, True)])
def test_a_base_id_without_room_is_refused(base: int, extended: bool) -> None:
    with pytest.raises(ConfigError, match="choose one between 0x0 and"):
        CanSender(base_id=base, extended=extended)
