"""Two real nodes with the same ids on one CAN bus, and every receiver listening to both.

Not a test itself: ``python two_nodes.py DRIVER`` (``driver.c``, built) runs them by udp_multicast,
so call it in a network of its own. The first node sees a person beside the robot, the second an
empty room. Prints what each receiver permitted, in JSON:

    together: with both nodes alive    alone: after the first has ended
"""

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_drivers.links.can.link import CanCodec, CanLink, CanLinkSettings
from hri_predict.base.files import data_path
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver
from hri_predict.protocol.messages import Advice, Status
from hri_sim.baseline_demo import BASELINE
from hri_sim.controllers.controller import ControllerCore, ControllerSettings
from tests.hri_drivers.plc.conftest import everything

CHANNEL = "239.74.163.2"
SILENCE_MS, MAX_AGE_MS = 600, 3000  # patient: the machine may be busy with other things
STEP_MS = 20
NAIVE = 1_000_000_000  # errors that a controller tolerates which only counts them
TOGETHER_S, LIMIT_S = 8.0, 120.0
NEAR = [{"start": [0.9, 0.1], "script": [{"do": "wait", "seconds": 600.0}]}]


def configured(folder: Path, name: str, people: list[Any]) -> Path:
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    bus = {"name": "bus", "kind": "can", "interface": "udp_multicast", "channel": CHANNEL}
    data["links"] = [bus | {"silence_timeout_s": SILENCE_MS / 1000}]
    data["predictor"] = BASELINE
    data["source"]["people"] = people
    data["people"] = {}  # with this delay the demo's exit is too close to the robot
    data["risk"] = {"mode": "iso"}
    data["alerts"] = {"terminal": False}
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


def started(config: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "hri_predict", "run", str(config), "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


class InC:
    """The C code, asked line by line; it also makes the RobotStates that go onto the bus."""

    def __init__(self, driver: str, tolerated: int):
        command = ["stdbuf", "-oL", driver]
        self._child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        numbers = (0, 0, DEFAULT_BASE_ID, 0, SILENCE_MS, MAX_AGE_MS, tolerated, 500, 0)
        assert self._answer("init " + " ".join(map(str, numbers))) == "1"

    def step(self, ms: int, frames: list[CanFrame]) -> bool:
        for frame in frames:
            self._tell(f"rx {frame.arbitration_id} {frame.data.hex()}")
        self._tell(f"at {ms}")
        return not self._answer("ask").startswith("0 ")

    def state(self) -> list[CanFrame]:
        pairs = [word.split(":") for word in self._answer("state 1 6" + " 0" * 12).split()]
        return [CanFrame(int(number, 16), bytes.fromhex(data)) for number, data in pairs]

    def close(self) -> None:
        self._child.kill()

    def _tell(self, line: str) -> None:
        assert self._child.stdin is not None
        self._child.stdin.write(line + "\n")

    def _answer(self, line: str) -> str:
        self._tell(line)
        assert self._child.stdout is not None
        return self._child.stdout.readline().strip()


class InPlc:
    """The structured-text example."""

    def __init__(self, tolerated: int):
        self._block = everything()["HRI_ADVICE"]
        limits = self._block.variables["Rule"].variables
        limits |= {"TOLERATED_ERRORS": tolerated, "SILENCE_MS": SILENCE_MS}
        limits["MAX_AGE_MS"] = MAX_AGE_MS
        self._counter, self._sent_ms = 0, [0] * 32

    def step(self, ms: int, frames: list[CanFrame]) -> bool:
        state: dict[str, Any] = {"StateCounter": self._counter, "Sent": min(self._counter, 32)}
        state |= {"SentMs": self._sent_ms, "NowMs": ms}
        for f in frames:
            data = [*f.data, *bytes(8)][:8]
            self._block(NewFrame=1, Id=f.arbitration_id, Length=len(f.data), Data=data, **state)
        self._block(NewFrame=0, **state)
        self._counter += 1  # a RobotState goes out after this step
        self._sent_ms[self._counter % 32] = ms
        return bool(self._block.variables["PermittedSpeed"])


class InMock:
    """The mock controller's logic, with its own counter of RobotStates in step with the others'."""

    def __init__(self, tolerated: int):
        can = CanLinkSettings(name="can", interface="virtual", channel="none")
        settings = ControllerSettings(
            reaction_s=0.0,
            silence_timeout_s=1e-3 * SILENCE_MS,
            state_rate_hz=1000 / STEP_MS,
            max_age_s=1e-3 * MAX_AGE_MS,
            tolerated_errors=tolerated,
        )
        codec = CanCodec(can)
        self._core = ControllerCore(
            name="mock", settings=settings, robot=0, codec=codec, full_speed_m_s=1.0
        )

    def step(self, ms: int, frames: list[CanFrame]) -> bool:
        now_ns = 1_000_000 * ms
        self._core.receive(frames, now_ns)
        permitted = self._core.permit(now_ns).speed_m_s > 0
        assert self._core.outgoing(now_ns, np.zeros(6), np.zeros(6))
        return permitted


class Bus:
    """The bus, every receiver on it, and what they say."""

    def __init__(self, driver: str):
        can = CanLinkSettings(name="t", interface="udp_multicast", channel=CHANNEL)
        self._wire = CanLink.make_transport(can)
        self._wire.open()
        self._first_s = time.monotonic()
        self._ms = 0
        self._own: set[CanFrame] = set()
        self._ears = CanReceiver()
        self._sender = InC(driver, 0)
        self.receivers: dict[str, Any] = {
            "c": self._sender,
            "c, naive": InC(driver, 65535),
            "plc": InPlc(0),
            "plc, naive": InPlc(NAIVE),
            "mock": InMock(0),
            "mock, naive": InMock(NAIVE),
        }
        self.said: Counter[str] = Counter()

    def step(self) -> dict[str, bool]:
        """One cycle of all controllers."""
        due_s = self._first_s + 1e-3 * self._ms
        frames: list[CanFrame] = []
        while (left_s := due_s - time.monotonic()) > 0 or not frames:
            got = self._wire.read(max(0.0, left_s))
            frames += [f for f in got if f not in self._own]
            if not got and left_s <= 0:
                break
        for frame in frames:
            for message in self._ears.feed(frame):
                if isinstance(message, Advice):
                    self.said[f"{message.level.name} {message.reason.name}"] += 1
                elif isinstance(message, Status):
                    self.said[message.node_state.name] += 1
        moved = {name: r.step(self._ms, frames) for name, r in self.receivers.items()}
        for name, receiver in self.receivers.items():
            if isinstance(receiver, InC):
                states = receiver.state()
                if name == "c":
                    for frame in states:
                        self._own.add(frame)
                        self._wire.write(frame)
        self._ms += STEP_MS
        return moved

    def run(self, until: Any, limit_s: float = LIMIT_S) -> Counter[str]:
        """Step until something is so; return how often each receiver permitted motion."""
        permitted: Counter[str] = Counter(dict.fromkeys(self.receivers, 0))
        end_s = time.monotonic() + limit_s
        while not until(permitted):
            assert time.monotonic() < end_s, (permitted, self.said)
            permitted.update({name: int(moved) for name, moved in self.step().items()})
        return permitted

    def close(self) -> None:
        for receiver in self.receivers.values():
            getattr(receiver, "close", lambda: None)()
        self._wire.close()


def main(driver: str) -> None:
    folder = Path(tempfile.mkdtemp(prefix="hri-two-nodes-"))
    bus = Bus(driver)
    first = started(configured(folder, "person", NEAR))
    second = None
    try:
        # a node on a busy machine is DEGRADED, for its ticks are late
        bus.run(lambda _: bus.said["STOP PERSON_NEAR"] > 25)
        second = started(configured(folder, "empty", []))
        bus.said.clear()
        bus.run(lambda _: bus.said["FAULT SECOND_SENDER"] > 0)
        end_s = time.monotonic() + TOGETHER_S
        together = bus.run(lambda _: time.monotonic() > end_s)
        said = dict(bus.said)
        first.send_signal(signal.SIGTERM)
        summary = json.loads(first.communicate(timeout=30)[0])
        bus.said.clear()
        alone = bus.run(lambda permitted: all(permitted.values()))
    finally:
        for node in (first, second):
            if node is not None:
                node.kill()
                node.wait()
        bus.close()
    foreign = [link["foreign"] for link in summary["links"]]
    state = summary["node_state"]
    print(
        json.dumps(
            {"together": together, "said": said, "alone": alone, "foreign": foreign, "state": state}
        )
    )


if __name__ == "__main__":
    main(sys.argv[1])
