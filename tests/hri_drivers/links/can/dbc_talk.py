"""Two processes on one CAN: the node's link, and a listener that knows the DBC file alone.

Not a test itself: ``python dbc_talk.py node slcan|udp_multicast [fd]`` starts the listener, posts
random messages, compares what the listener's cantools made of them, and prints the outcome as JSON.
The listener answers each Status with a RobotState, so both ways are busy.
"""

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.can import CanFrame, CanSender
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.fields import MAX_ROBOTS, Field
from hri_predict.protocol.generate.dbc import numbered_items
from hri_predict.protocol.messages import (
    Advice,
    Message,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
)
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty
from tests.random_messages import random_message, signals

DBC = Path(__file__).resolve().parents[4] / "drivers" / "dbc"
MULTICAST = "239.74.163.2"
ROUNDS = 40


# -- the listener ---------------------------------------------------------------------------------


class PlainBus:
    """Python-can without anything of the project."""

    def __init__(self) -> None:
        self._bus = can.Bus(
            interface="udp_multicast", channel=MULTICAST, fd=True, ignore_config=True
        )

    def read(self, timeout_s: float) -> list[CanFrame]:
        message = self._bus.recv(timeout_s)
        if message is None:
            return []
        return [CanFrame(message.arbitration_id, bytes(message.data), fd=message.is_fd)]

    def write(self, frame: CanFrame) -> None:
        self._bus.send(
            can.Message(
                arbitration_id=frame.arbitration_id,
                data=frame.data,
                is_fd=frame.fd,
                is_extended_id=False,
            )
        )


def listen(interface: str, fd: bool, descriptor: int) -> None:
    bus: Any
    if interface == "slcan":
        bus = SlcanAdapter(descriptor)
        bus.open()
    else:
        bus = PlainBus()
    database: Any = cantools.database.load_file(DBC / f"hri_predict{'_fd' if fd else ''}.dbc")
    known = {m.frame_id: m for m in database.messages}
    sender, counter = CanSender(fd), 0
    heard: list[Any] = []
    print("ready", flush=True)
    os.set_blocking(0, False)
    while not _ended():
        for frame in bus.read(0.05):
            message = known.get(frame.arbitration_id)
            if message is None or message.senders != ["NODE"]:
                continue
            signals = message.decode(frame.data, decode_choices=False)
            heard.append([message.name, signals])
            if message.name.startswith("STATUS"):
                state = RobotState(
                    robot=0,
                    mode=RobotMode.AUTOMATIC,
                    counter=counter % 256,
                    positions=(0.5,) * 6,
                    velocities=(0.0,) * 6,
                )
                for answer in sender.encode(state):
                    bus.write(answer)
                counter += 1
    for row in heard:
        print(json.dumps(row))


def _ended() -> bool:
    """Whether the node has closed our standard input."""
    try:
        return os.read(0, 1) == b""
    except BlockingIOError:
        return False


# -- the node -------------------------------------------------------------------------------------


def random_messages(rng: np.random.Generator, fd: bool) -> list[Message]:
    """Messages of the node; numbers go beyond the ranges of their fields."""
    robots = rng.permutation(MAX_ROBOTS)[:3].tolist()
    found: list[Message] = []
    for robot in robots:
        advice = random_message(rng, Advice, beyond=1.2)
        assert isinstance(advice, Advice)
        found.append(replace(advice, robot=robot, echo=None))
    kinds = [Status, Schema, *((Zone, Pose) if fd else ())]
    return found + [random_message(rng, kind, items=4, beyond=1.2) for kind in kinds]


def agrees(field: Field, value: Any, decoded: float) -> bool:
    """Whether a decoded signal is the value within the field's resolution."""
    if value is None:
        assert field.not_available is not None
        return abs(decoded - field.not_available * field.resolution) < 1e-6
    if not field.scale:
        return bool(decoded == value)
    low, high = (raw * field.resolution for raw in field.raw_range)
    return abs(decoded - min(high, max(low, value))) <= field.resolution + 1e-9


def talk(interface: str, fd: bool) -> dict[str, Any]:
    master, path = open_pty() if interface == "slcan" else (-1, MULTICAST)
    listener = subprocess.Popen(
        [sys.executable, __file__, "listener", interface, *(["fd"] if fd else []), str(master)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        pass_fds=() if master < 0 else (master,),
    )
    assert listener.stdin
    assert listener.stdout
    assert listener.stdout.readline() == "ready\n"
    settings = CanLinkSettings(
        name="cell", interface=interface, channel=path, fd=fd, simulate={}, data_bitrate=2_000_000
    )
    link = CanLink(settings, MonotonicClock())
    link.start()
    if interface == "slcan":
        time.sleep(0.5)  # let the adapter read that its channel is open
    rng = np.random.default_rng(7)
    sent: list[Message] = []
    states: list[Any] = []
    for done in range(ROUNDS + 1):
        messages = random_messages(rng, fd) if done < ROUNDS else [sent[3]]  # a Status ends it
        sent += messages
        for message in messages:
            link.post(message)
        deadline = time.monotonic() + 2
        while time.monotonic() < deadline:
            states += [r.message for r in link.take()]
            if link.counters.messages_sent == len(sent) and len(states) == done + 1:
                break
            time.sleep(0.001)
    link.stop()
    listener.stdin.close()
    decoded = [json.loads(line) for line in listener.stdout]
    return {
        "status": listener.wait(20),
        "sent": len(sent),
        "states": [s.counter for s in states if isinstance(s, RobotState)],
        "last_error": link.last_error,
        "counters": {n: getattr(link.counters, n) for n in type(link.counters).__slots__},
        **compare(sent, decoded),
    }


def compare(sent: list[Message], decoded: list[Any]) -> dict[str, Any]:
    """Hold every signal that was decoded against what was posted, stream by stream."""
    heard: dict[str, list[dict[str, float]]] = {}
    for name, row in decoded:
        heard.setdefault(name, []).append(row)
    compared, wrong = 0, []
    position: dict[str, int] = {}
    for message in sent:
        kind = type(message).__name__.upper()
        stem = f"{kind}_R{message.robot}" if isinstance(message, Advice) else kind
        names = [n for n in heard if n == stem or n.startswith(stem + "_P")]
        at = position.setdefault(stem, 0)
        position[stem] += 1
        merged: dict[str, float] = {}
        for name in names:
            if at < len(heard[name]):
                merged |= heard[name][at]
        fields = BY_TYPE[type(message)]
        known = {f.signal: f for f in (*fields.fields, *numbered_items(fields))}
        for signal, value in signals(message).items():
            compared += 1
            if signal == "ECHO":  # filled by the link: what the listener itself has sent
                fine = signal in merged and merged[signal] in {65535, *range(256)}
            else:
                fine = signal in merged and agrees(known[signal], value, merged[signal])
            if not fine:
                wrong.append(f"{stem} {at} {signal}: {value} != {merged.get(signal)}")
    return {"frames": len(decoded), "compared": compared, "wrong": wrong[:5]}


if __name__ == "__main__":
    role, interface, *rest = sys.argv[1:]
    if role == "listener":
        listen(interface, "fd" in rest, int(rest[-1]))
    else:
        print(json.dumps(talk(interface, "fd" in rest)))
