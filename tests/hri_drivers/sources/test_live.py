"""What all live sources share, with a receiver and a decoder of the test's own."""

import queue
import threading
import time
from asyncio import CancelledError
from typing import Any

import numpy as np
import pytest

from hri_drivers.sources import live
from hri_drivers.sources.live import LiveSettings, LiveSource, sender_joints
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.settings import Pose, validated
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import NOT_KNOWN_NS, SourceCounters

pytestmark = pytest.mark.realtime

PATIENCE_S = 20.0


class Receiver:
    """Gives what the test puts; an exception among it is raised."""

    def __init__(self) -> None:
        self.queue: queue.Queue[Any] = queue.Queue()
        self.refuse: Exception | None = None
        self.may_open = threading.Event()
        self.may_open.set()
        self.opened = self.closed = 0

    def open(self) -> None:
        self.may_open.wait()
        if self.refuse is not None:
            raise self.refuse
        self.opened += 1

    def read(self, timeout_s: float) -> list[bytes]:
        try:
            item = self.queue.get(timeout=timeout_s)
        except queue.Empty:
            return []
        if isinstance(item, BaseException):
            raise item
        return [item]

    def close(self) -> None:
        self.closed += 1


class Decoder:
    """``b"session:sequence"`` is a scene with one person."""

    def __init__(self) -> None:
        self.resets = 0

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        session, sequence = (int(number) for number in data.split(b":"))
        positions = np.array([[1000.0, 2000.0, 3000.0], [np.nan] * 3])
        person = SentPerson(5, positions, np.array([True, False]))
        return [
            SentScene(
                stamp_ns=received_ns,
                sequence=sequence,
                sees_room=True,
                people=(person,),
                session=session,
            )
        ]

    def reset(self) -> None:
        self.resets += 1


class Rig:
    def __init__(self, map_path: str, **settings: Any) -> None:
        data = {
            "kind": "mine",
            "room_from_source": {
                "xyz": [10, 0, 0],
                "quaternion_xyzw": [0, 0, 2**-0.5, 2**-0.5],
            },
            "rate_hz": 1000,
            "joint_map": map_path,
        }
        self.receiver, self.decoder, self.counters = Receiver(), Decoder(), SourceCounters()
        model = validated(LiveSettings, data | settings, "source")
        self.source = LiveSource(
            settings=model,
            receiver=self.receiver,
            decoder=self.decoder,
            counters=self.counters,
            joint_map=sender_joints(model, None),
        )

    def put(self, *items: Any) -> None:
        for item in items:
            self.receiver.queue.put(item)

    def scenes(self, count: int) -> list[Scene]:
        """The next scenes, each waited for as the runtime does."""
        found: list[Scene] = []
        end_s = time.monotonic() + PATIENCE_S
        while len(found) < count:
            assert time.monotonic() < end_s, self.counters
            self.source.arrived.wait(0.1)
            self.source.arrived.clear()
            while (scene := self.source.poll(time.monotonic_ns())) is not None:
                found.append(scene)
        return found

    def wait(self, reached: Any) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not reached():
            assert time.monotonic() < end_s, self.counters
            time.sleep(0.002)


@pytest.fixture
def map_path(tmp_path):
    """Two joints in millimetres, y up."""
    path = tmp_path / "mine.yaml"
    path.write_text(
        "{name: mine, reference: test, units: mm, axes: [z, x, y], joints: [a, b], map: {head: a}}"
    )
    return str(path)


@pytest.fixture
def rig(map_path):
    rig = Rig(map_path)
    rig.source.open(0)
    yield rig
    rig.source.close()


def test_joints_come_in_metres_in_the_room(rig):
    rig.put(b"1:0")
    (scene,) = rig.scenes(1)
    (person,) = scene.people
    # source: x 1, y 2 (up), z 3 (forward) m -> forward 3, left 1, up 2 -> turned by 90 degrees
    np.testing.assert_allclose(person.positions[0], [10 - 1, 3, 2], atol=1e-9)
    assert np.isnan(person.positions[1]).all()
    assert (person.id, person.observed.tolist()) == (5, [True, False])


def test_nothing_is_due_until_something_came(rig):
    assert rig.source.next_ns() == NOT_KNOWN_NS
    rig.put(b"1:0")
    rig.wait(lambda: rig.source.next_ns() < time.monotonic_ns())
    assert rig.source.arrived.is_set()


def test_a_new_session_goes_on_counting_where_the_old_one_ended(rig):
    rig.put(b"1:7", b"1:8", b"2:0", b"2:2", b"2:1", b"1:9")
    scenes = rig.scenes(6)
    assert [s.sequence for s in scenes] == [7, 8, 9, 11, 10, 11]
    assert rig.counters.restarts == 2


def test_a_lost_device_is_opened_again(rig):
    rig.put(b"1:0", SourceError("cable pulled\nsecond line"), b"1:1")
    assert [s.sequence for s in rig.scenes(2)] == [0, 1]
    assert (rig.counters.disconnects, rig.counters.reconnects) == (1, 1)
    assert rig.counters.last_error == "cable pulled"
    assert (rig.receiver.opened, rig.decoder.resets) == (2, 2)
    assert rig.source.connected


def test_a_device_whose_library_panics_is_opened_again(rig):
    rig.put(b"1:0", CancelledError("in its own loop"), b"1:1")
    assert [s.sequence for s in rig.scenes(2)] == [0, 1]
    assert rig.counters.last_error == "CancelledError: in its own loop"


def test_a_device_that_stays_away_is_tried_ever_more_seldom(rig, monkeypatch):
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 8:
            rig.receiver.refuse = None

    monkeypatch.setattr(rig.source._stopping, "wait", wait)
    rig.receiver.refuse = SourceError("not there")
    rig.put(SourceError("pulled"), b"1:1")
    assert len(rig.scenes(1)) == 1
    assert waits == [0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0]
    assert (rig.counters.disconnects, rig.counters.reconnects) == (1, 1)


def test_a_decoder_that_fails_loses_those_bytes_alone(rig):
    rig.put(b"1:0", b"nonsense", b"1:1")
    assert len(rig.scenes(2)) == 2
    assert rig.counters.malformed == 1


def test_a_device_that_is_absent_at_start_is_refused_in_one_line(map_path):
    rig = Rig(map_path)
    rig.receiver.refuse = SourceError("port x: not there; plug it in")
    with pytest.raises(SourceError, match="source 'mine': port x: not there; plug it in"):
        rig.source.open(0)


def test_or_waited_for_if_so_configured(map_path):
    rig = Rig(map_path, wait_for_device=True)
    rig.receiver.refuse = SourceError("not there")
    rig.source.open(0)
    assert not rig.source.connected
    rig.receiver.refuse = None
    rig.put(b"1:0")
    assert len(rig.scenes(1)) == 1
    rig.source.close()


def test_an_opening_without_an_end_ends_the_start(map_path, monkeypatch):
    monkeypatch.setattr(live, "OPEN_S", 0.05)
    rig = Rig(map_path)
    rig.receiver.may_open.clear()
    with pytest.raises(SourceError, match="source 'mine': not open within"):
        rig.source.open(0)
    rig.receiver.may_open.set()
    rig.wait(lambda: rig.receiver.closed)  # nothing stays open


def test_or_only_delays_it_if_the_device_may_be_absent(map_path, monkeypatch):
    monkeypatch.setattr(live, "WAIT_FOR_S", 0.05)
    rig = Rig(map_path, wait_for_device=True)
    rig.receiver.may_open.clear()
    rig.source.open(0)
    assert not rig.source.connected
    rig.receiver.may_open.set()
    rig.put(b"1:0")
    assert len(rig.scenes(1)) == 1
    rig.source.close()


def test_it_ends_and_may_be_ended_twice(rig):
    rig.source.close()
    rig.source.close()
    assert not rig.source.connected
    assert rig.receiver.closed == 1


def test_trouble_is_logged_once_for_many(rig, caplog, monkeypatch):
    monkeypatch.setattr(rig.source, "_log_ns", 0)
    rig.put(*[b"nonsense"] * 50)
    rig.wait(lambda: rig.counters.malformed == 50)
    rig.source.close()
    lines = [r.getMessage() for r in caplog.records if "malformed" in r.getMessage()]
    assert len(lines) == 1


def test_an_unknown_joint_map_is_refused(tmp_path):
    settings = LiveSettings(kind="udp", rate_hz=30, room_from_source=Pose(), joint_map="nothing")
    with pytest.raises(ConfigError, match="no joint map 'nothing'"):
        sender_joints(settings, tmp_path)


def test_a_joint_map_is_found_beside_the_configuration(map_path, tmp_path):
    settings = LiveSettings(kind="udp", rate_hz=30, room_from_source=Pose(), joint_map="mine.yaml")
    assert sender_joints(settings, tmp_path).source_joints == ("a", "b")


def test_what_is_refused_is_logged_at_once_and_then_seldom(rig, caplog):
    def said() -> list[str]:
        return [line for line in caplog.messages if "malformed" in line]

    with caplog.at_level("WARNING"):
        rig.put(b"no scene")
        rig.wait(said)
        rig.put(b"no scene", b"no scene", b"1:0")
        rig.scenes(1)
        rig.wait(lambda: rig.counters.malformed == 3)
    assert said() == [
        "source 'mine': 1 malformed (invalid literal for int() with base 10: b'no scene')"
    ]


def test_a_sender_that_starts_again_is_logged_without_an_error(rig, caplog):
    with caplog.at_level("WARNING"):
        rig.put(b"1:7", b"2:0")
        rig.scenes(2)
        rig.put(b"2:1")
        rig.wait(lambda: caplog.messages)
    assert caplog.messages == ["source 'mine': 1 restart of the sender"]
