"""Every registered source keeps its contract, and one that breaks it is caught.

Those that hear a sender are sent to by ``hri_sim``'s own senders, over their real sockets.
"""

import socket
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_predict.base.settings import validated
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts import registry
from hri_predict.contracts.scene import Person, Scene
from hri_predict.library.conformance.checks import run_checks
from hri_predict.library.conformance.sources import CHECKS, SourcePart, check_source
from hri_sim.people.body import Body
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.senders.live_ends import LIVE_ENDS

FORESEEN: dict[str, dict[str, Any]] = {
    "procedural": {"noise_m": 0.01, "dropout": 0.2, "duration_s": 4.0},
    "approach": {"motions": ["procedural:1"], "places": [[4.4, 0.1, 3.1]], "lead_in_s": 0.5},
}


def verdicts(name: str, base_dir: Path, **settings: Any) -> dict[str, str]:
    """What came of the checks; none may fail."""
    cls = registry.load("sources", name)
    data = {"kind": name, "room_from_source": {"xyz": [1.0, 2.0, 0.0]}} | settings
    findings = check_source(name, validated(cls.settings_model, data, name), base_dir, 3.0)
    assert [f for f in findings if f.verdict == "fail"] == []
    return {f.check: f.verdict for f in findings}


@pytest.mark.parametrize("name", FORESEEN)
def test_a_source_that_foresees_its_scenes_keeps_its_contract(name, tmp_path):
    assert set(verdicts(name, tmp_path, **FORESEEN[name]).values()) == {"pass"}


def test_a_recording_keeps_the_contract(tmp_path):
    """Two seconds of arms that a camera saw, at 30 Hz."""
    rest = np.array([[x, y, 0.7] for y in (0.25, 0.1, -0.1) for x in (0.2, -0.2)])
    positions = rest + 0.1 * np.sin(np.arange(60) / 30)[:, None, None]
    np.savez(tmp_path / "arms.npz", positions=positions.astype(np.float32), fps=np.float32(30))
    found = verdicts("recording", tmp_path, path="arms.npz")
    assert set(found.values()) == {"pass"}


def test_every_source_is_checked_here():
    tried = {*FORESEEN, "recording", "udp", "serial_skeleton", "mvn", "json", "websocket", "zenoh"}
    tried |= {"vmc", "rokoko", "zed_livelink", "natnet", "qualisys"}
    by_real_nodes = {"ros2"}  # tests/hri_drivers/sources/ros2
    # it cannot foresee whether a sensor's scene completes one of its own
    by_its_sensors = {"merged"}  # tests/hri_predict/people/merging
    assert set(registry.names("sources")) == tried | by_real_nodes | by_its_sensors


@pytest.mark.realtime
@pytest.mark.parametrize(
    "end", [pytest.param(e, marks=[] if e == "udp" else [pytest.mark.long]) for e in LIVE_ENDS]
)
def test_a_source_that_hears_a_sender_keeps_its_contract(end, tmp_path):
    sender = LIVE_ENDS[end](tmp_path)
    body = Body(1.75)
    joints = body.joints(body.standing(np.zeros(2), 0.0))
    over = threading.Event()

    def send() -> None:
        sender.start()
        sequence = 0
        while not over.wait(1 / 60):
            seen = np.ones(len(JOINTS), np.bool_)
            person = Person(1, joints + 0.001 * np.sin(sequence), seen)
            for unit in sender.encode(Scene(time.time_ns(), sequence, True, (person,))):
                sender.write(unit)
            sequence += 1

    thread = threading.Thread(target=send)
    thread.start()
    try:
        data = {k: v for k, v in sender.source.items() if k != "kind"}
        found = verdicts(sender.source["kind"], tmp_path, rate_hz=60.0, **data)
    finally:
        over.set()
        thread.join()
        sender.stop()
    skipped = {check for check, verdict in found.items() if verdict == "skipped"}
    assert skipped == {"comes when it said", "stands in the room", "gives the same again"}


@pytest.mark.realtime
def test_a_source_that_makes_nothing_of_what_is_sent_is_caught(tmp_path):
    cls = registry.load("sources", "udp")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    over, out = threading.Event(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send() -> None:
        while not over.wait(1 / 60):
            out.sendto(b"not a scene", ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        data = {"kind": "udp", "room_from_source": {}, "rate_hz": 30.0, "port": port}
        settings = validated(cls.settings_model, data, "udp")
        findings = check_source("udp", settings, tmp_path, 0.5)
    finally:
        over.set()
        thread.join()
        out.close()
    failed = {f.check: f.detail for f in findings if f.verdict == "fail"}
    assert "made no scene of" in failed["gives sound scenes"]


class Wrong(ProceduralSource):
    """Changes the scenes of the procedural source."""

    def poll(self, now_ns):
        scene = super().poll(now_ns)
        return None if scene is None else self.wrong(scene)

    def wrong(self, scene):
        return scene

    def persons(self, scene, change):
        return replace(scene, people=tuple(change(person) for person in scene.people))


class Stuck(Wrong):
    def wrong(self, scene):
        return replace(scene, sequence=5)


class BackInTime(Wrong):
    def wrong(self, scene):
        return replace(scene, capture_ns=-scene.capture_ns)


class Millimetres(Wrong):
    def wrong(self, scene):
        return self.persons(scene, lambda p: replace(p, positions=1000 * p.positions))


class Invents(Wrong):
    def wrong(self, scene):
        return self.persons(scene, lambda p: replace(p, positions=np.nan_to_num(p.positions)))


class Twins(Wrong):
    def wrong(self, scene):
        return replace(scene, people=2 * scene.people)


class NotSeenAtAll(Wrong):
    def wrong(self, scene):
        return self.persons(scene, lambda p: replace(p, error_m=np.inf))


class Blocks(Wrong):
    """Takes long twenty times: more than one call in a hundred."""

    long = 20

    def poll(self, now_ns):
        if self.long:
            self.long -= 1
            time.sleep(0.06)
        return super().poll(now_ns)


class Restless(Wrong):
    def wrong(self, scene):
        shift = np.random.default_rng().normal(0, 1e-3)
        return self.persons(scene, lambda p: replace(p, positions=p.positions + shift))


class InItsOwnFrame(Wrong):
    def __init__(self, settings, base_dir=None):
        super().__init__(settings, base_dir)
        self._room = np.eye(4)


class Early(Wrong):
    def poll(self, now_ns):
        return super().poll(now_ns + 5_000_000)


class ClosesOnce(Wrong):
    def close(self):
        assert self._start_ns is not None
        super().close()


class TalksBeforeItOpens(Wrong):
    def __init__(self, settings, base_dir=None):
        super().__init__(settings, base_dir)
        self._start_ns = 0


@pytest.mark.parametrize(
    ("cls", "check"),
    [
        (Stuck, "counts up"),
        (BackInTime, "counts up"),
        (Millimetres, "gives metres"),
        (Invents, "marks what it did not see"),
        (Twins, "gives sound scenes"),
        (NotSeenAtAll, "gives sound scenes"),
        (Blocks, "never blocks"),
        (Restless, "gives the same again"),
        (InItsOwnFrame, "stands in the room"),
        (Early, "comes when it said"),
        (ClosesOnce, "closes twice"),
        (TalksBeforeItOpens, "is quiet until opened"),
    ],
)
def test_a_source_that_breaks_its_contract_is_caught(cls: Any, check: str):
    settings = ProceduralSettings(kind="procedural", dropout=0.3, duration_s=3.0)
    findings = run_checks(CHECKS, SourcePart(cls, settings, Path(), 1.0))
    failed = {f.check: f.detail for f in findings if f.verdict == "fail"}
    assert check in failed
    assert failed[check]
