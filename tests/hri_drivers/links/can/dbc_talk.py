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
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.can import CanFrame, CanSender
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    NodeState,
    OperatingMode,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty

DBC = Path(__file__).resolve().parents[4] / "drivers" / "dbc"
MULTICAST = "239.74.163.2"
ROUNDS = 40
NOT_AVAILABLE = {"m": -32.768, "s": 65.535, "m/s": 65.535, "echo": 65535}
NOT_AVAILABLE |= {"index": 63, "tool": 255, "soon": 4.095}
LIMIT = {"m": 32.767, "s": 65.534, "m/s": 65.534, "soon": 4.094}


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
    def maybe(low: float, high: float) -> float | None:
        return None if rng.random() < 0.2 else float(rng.uniform(low, high))

    def index() -> int | None:
        return None if rng.random() < 0.2 else int(rng.integers(0, 63))

    def point() -> tuple[float, float, float]:
        x, y, z = rng.uniform(-40, 40, 3)
        return float(x), float(y), float(z)

    messages: list[Message] = [
        Advice(
            robot=int(robot),
            level=Level(int(rng.integers(0, 6))),
            reason=Reason(int(rng.choice([r.value for r in Reason]))),
            latch_id=int(rng.integers(0, 65536)),
            separation_m=maybe(-40, 40),
            predicted_separation_m=maybe(-40, 40),
            time_to_breach_s=maybe(0, 80),
            speed_limit_m_s=maybe(0, 80),
            body_part=index(),
            robot_link=index(),
            mode=OperatingMode(int(rng.integers(0, 4))),
            tool=index(),
        )
        for robot in rng.permutation(8)[:3]
    ]
    messages.append(
        Status(
            node_state=NodeState(int(rng.integers(0, 6))),
            reason=Reason(int(rng.choice([r.value for r in Reason]))),
            people=int(rng.integers(0, 15)),
            predictor=int(rng.integers(0, 256)),
            cycle=int(rng.integers(0, 256)),
            age_s=maybe(0, 80),
        )
    )
    messages.append(Schema(int(rng.integers(0, 65536)), int(rng.integers(0, 2**32))))
    if fd:
        capsules = tuple(
            ZoneCapsule(int(i), point(), point(), float(rng.uniform(0, 3))) for i in range(3)
        )
        joints = tuple((int(i), *point()) for i in range(7))
        person, step = int(rng.integers(0, 65536)), int(rng.integers(0, 256))
        messages.append(
            Zone(person=person, step=step, horizon_s=float(rng.uniform(0, 3)), capsules=capsules)
        )
        messages.append(
            Pose(person=person, step=step, horizon_s=float(rng.uniform(0, 3)), joints=joints)
        )
    return messages


def expected(message: Message) -> dict[str, tuple[Any, str]]:
    """Signal -> (value, unit) of a message, written down by hand from the messages' meaning."""
    match message:
        case Advice():
            return {
                "LEVEL": (message.level, ""),
                "REASON": (message.reason, ""),
                "LATCH_ID": (message.latch_id, ""),
                "SEPARATION": (message.separation_m, "m"),
                "PREDICTED_SEPARATION": (message.predicted_separation_m, "m"),
                "TIME_TO_BREACH": (message.time_to_breach_s, "soon"),
                "SPEED_LIMIT": (message.speed_limit_m_s, "m/s"),
                "BODY_PART": (message.body_part, "index"),
                "ROBOT_LINK": (message.robot_link, "index"),
                "ECHO": (message.echo, "echo"),
                "OPERATING_MODE": (message.mode, ""),
                "TOOL": (message.tool, "tool"),
                "AGE": (message.age_s, "s"),
            }
        case Status():
            return {
                "NODE_STATE": (message.node_state, ""),
                "REASON": (message.reason, ""),
                "PEOPLE": (message.people, ""),
                "PREDICTOR": (message.predictor, ""),
                "CYCLE": (message.cycle, ""),
                "AGE": (message.age_s, "s"),
            }
        case Schema():
            return {"SCHEMA_VERSION": (message.version, ""), "SCHEMA_HASH": (message.hash, "")}
        case Zone():
            signals: dict[str, tuple[Any, str]] = {
                "PERSON": (message.person, ""),
                "STEP": (message.step, ""),
                "HORIZON": (message.horizon_s, "s"),
            }
            for i, capsule in enumerate(message.capsules):
                signals[f"SEGMENT_{i}"] = (capsule.segment, "")
                signals[f"RADIUS_{i}"] = (capsule.radius, "s")  # unsigned, as times are
                for axis, a, b in zip("XYZ", capsule.a, capsule.b, strict=True):
                    signals[f"A_{axis}_{i}"], signals[f"B_{axis}_{i}"] = (a, "m"), (b, "m")
            return signals
        case Pose():
            signals = {"PERSON": (message.person, ""), "STEP": (message.step, "")}
            for i, (joint, *xyz) in enumerate(message.joints):
                signals[f"JOINT_{i}"] = (joint, "")
                signals |= {f"{a}_{i}": (v, "m") for a, v in zip("XYZ", xyz, strict=True)}
            return signals
    raise AssertionError(message)


def agrees(value: Any, unit: str, decoded: float) -> bool:
    """Whether a decoded signal is the value within the field's resolution, 1 mm, 1 ms, 1 mm/s."""
    if value is None:
        return abs(decoded - NOT_AVAILABLE[unit]) < 1e-6
    if unit in LIMIT:
        value = max(-LIMIT[unit], min(LIMIT[unit], value))
        return abs(decoded - value) <= 0.001 + 1e-9
    return decoded == value


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
    for name, signals in decoded:
        heard.setdefault(name, []).append(signals)
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
        for signal, (value, unit) in expected(message).items():
            compared += 1
            if signal == "ECHO":  # filled by the link: what the listener itself has sent
                fine = signal in merged and merged[signal] in {65535, *range(256)}
            else:
                fine = signal in merged and agrees(value, unit, merged[signal])
            if not fine:
                wrong.append(f"{stem} {at} {signal}: {value} != {merged.get(signal)}")
    return {"frames": len(decoded), "compared": compared, "wrong": wrong[:5]}


if __name__ == "__main__":
    role, interface, *rest = sys.argv[1:]
    if role == "listener":
        listen(interface, "fd" in rest, int(rest[-1]))
    else:
        print(json.dumps(talk(interface, "fd" in rest)))
