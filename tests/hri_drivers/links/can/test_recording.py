"""python-can's own loggers and players record the node's traffic and give it back."""

import dataclasses
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import can
import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.can import CanFrame, CanSender
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    Schema,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty
from tests.hri_drivers.links.can.can_pairs import CHANNELS, Controller, connected
from tests.messages import make_advice, make_state, make_status
from tests.waiting import eventually

pytestmark = pytest.mark.realtime
FORMATS = [".blf", ".log"]  # Vector's binary log, and can-utils' candump
ZONE = Zone(
    person=7,
    step=2,
    horizon_s=0.08,
    capsules=(ZoneCapsule(3, (0.5, -1.0, 0.25), (1.0, 2.0, 3.0), 0.125),) * 21,
    age_s=0.02,
)


def said_by_node() -> list[Message]:
    status = make_status(people=1, cycle=7)
    slow = make_advice(Level.SLOW, Reason.PERSON_NEAR, latch_id=5, speed_limit_m_s=0.25)
    return [slow, status, Schema(1, 2), ZONE]


def said_by_controller() -> list[Message]:
    state = make_state((0.25,) * 6, counter=41)
    return [state, Acknowledge(5, 77)]


def talk(link: CanLink, controller: Controller) -> None:
    """A conversation, one message after the other."""
    for number, message in enumerate(said_by_node()):
        link.post(message)
        eventually(lambda: link.counters.messages_sent > number)  # noqa: B023
    for number, message in enumerate(said_by_controller()):
        controller.say(message)
        eventually(lambda: link.counters.messages_received > number)  # noqa: B023


def decoded(settings: CanLinkSettings, frames: list[CanFrame]) -> list[Message]:
    receiver = CanLink.receiver(settings)
    messages = [m for frame in frames for m in receiver.feed(frame)]
    counters = dataclasses.asdict(receiver.counters)
    assert not any(counters[name] for name in ("crc_errors", "malformed", "incomplete"))
    return messages


def whole(messages: list[Message]) -> list[Message]:
    """The same with the frames of a Zone put together."""
    zones = [m for m in messages if isinstance(m, Zone)]
    capsules = tuple(c for z in zones for c in z.capsules)
    others = [m for m in messages if not isinstance(m, Zone)]
    return [*others, *([dataclasses.replace(zones[0], capsules=capsules)] if zones else [])]


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("fd", [False, True], ids=["classic", "fd"])
def test_a_recording_played_back_is_the_same_conversation(tmp_path: Path, suffix, fd):
    path = tmp_path / f"monday{suffix}"
    more: dict[str, Any] = {} if fd else {"isotp": {"peer_id": 0x6C7}}
    with connected("virtual fd" if fd else "virtual", **more) as (link, controller):
        channel = link._transport.channel  # type: ignore[attr-defined]
        tap = can.Bus(interface="virtual", channel=channel, ignore_config=True)
        tapped: list[can.Message] = []
        notifier = can.Notifier(tap, [can.Logger(path), tapped.append], timeout=0.05)
        talk(link, controller)
        eventually(lambda: any(m.arbitration_id == 0x6C1 for m in tapped))  # the last word
        notifier.stop()
        tap.shutdown()

    settings = CanLinkSettings(name="l", interface="virtual", channel="x", fd=fd)
    again = CanTransport(interface="virtual", channel=f"again-{next(CHANNELS)}", fd=fd)
    again.open()
    player = can.Bus(
        interface="virtual",
        channel=again.channel,
        ignore_config=True,
        protocol=can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20,
    )
    with can.LogReader(path) as reader:
        for recorded in can.MessageSync(reader, timestamps=False, gap=0):
            player.send(recorded)
    frames: list[CanFrame] = []
    while got := again.read(0.2):
        frames += got
    player.shutdown()
    again.close()

    node = said_by_node()
    heard = whole(decoded(settings, frames))
    assert {type(m) for m in heard} == {type(m) for m in node + said_by_controller()}
    for message in [*node[1:], *said_by_controller()]:
        assert message in heard
    assert [m.latch_id for m in heard if isinstance(m, Advice)] == [5]


@pytest.mark.long
def test_the_players_command_gives_it_back(tmp_path: Path):
    """``python -m can.player`` over a real driver: what comes out is what was recorded."""
    path = tmp_path / "monday.log"
    sender = CanSender()
    sent = [m for m in said_by_node() if not isinstance(m, Zone)]
    with can.Logger(path) as logger:
        for number, frame in enumerate(f for m in sent for f in sender.encode(m)):
            logger.on_message_received(
                can.Message(
                    timestamp=1_700_000_000 + 0.01 * number,
                    arbitration_id=frame.arbitration_id,
                    data=frame.data,
                    is_extended_id=False,
                )
            )
    master, tty = open_pty()
    adapter = SlcanAdapter(master)
    adapter.open()
    command = [sys.executable, "-m", "can.player", "-i", "slcan", "-c", tty, "-b", "500000"]
    player = subprocess.Popen([*command, str(path)], stdout=subprocess.PIPE)
    frames: list[CanFrame] = []
    settings = CanLinkSettings(name="l", interface="virtual", channel="x")
    try:
        while len(frames) < 5:
            frames += adapter.read(0.05)
    finally:
        player.terminate()
        player.wait(20)
        adapter.close()
    assert decoded(settings, frames) == sent


@pytest.mark.long
def test_the_loggers_command_records_a_link(tmp_path: Path):
    """``python -m can.logger`` over a real driver, beside the link, hears every frame of it."""
    path = tmp_path / "monday.blf"
    master, tty = open_pty()
    tap = SlcanAdapter(master)
    tap.open()
    command = [sys.executable, "-m", "can.logger", "-i", "slcan", "-c", tty, "-b", "500000"]
    logger = subprocess.Popen([*command, "-f", str(path)], stdout=subprocess.DEVNULL)
    try:
        eventually(lambda: (tap.read(0.05), tap.channel_open)[1])
        clock = MonotonicClock()
        sent = [f for m in said_by_node()[:3] for f in CanSender().encode(m)]
        for frame in sent:
            tap.write(frame)
        until = clock.now_ns() + 500_000_000  # let it take what is on the line
        eventually(lambda: clock.now_ns() > until)
    finally:
        logger.send_signal(signal.SIGINT)  # Ctrl-C, as a user ends it
        logger.wait(20)
        tap.close()
    with can.LogReader(path) as reader:
        frames = [CanFrame(m.arbitration_id, bytes(m.data)) for m in reader]
    assert frames == sent
