"""The whole node on the virtual clock, from the datagrams of each kind of sender to advice."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import pytest

from hri_drivers.sources.live import LiveSource
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person, Scene
from hri_predict.protocol.messages import Level
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.people.procedural import ProceduralSource
from hri_sim.senders.mocap_ends import PROGRAMS, Program

S, MS = 10**9, 10**6
UTC = 1_790_000_000 * S
BEGINS_S, ENDS_S = 3.5, 6.0
ACTS_S = 0.3
"""A fault shows within this time: two periods and a tick, with what a late tick adds."""
REACHED_S = BEGINS_S + 2.3
"""By now a person 6 m away who runs (at 1.6 m/s) is near enough to count."""
NOWHERE = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
STANDS: list[dict[str, Any]] = [{"do": "wait", "seconds": 60}]
WALKS = [{"do": "wait", "seconds": 1.0}, {"do": "walk", "to": [0.7, 0.3]}, *STANDS]

Script = list[dict[str, Any]]
Units = Callable[["Sender", float, Scene], list[bytes]]


def some(cases: Iterable[Any], *daily: Any) -> list[Any]:
    """All cases, of which only these run daily."""
    marks = [pytest.mark.long]
    return [
        pytest.param(*(c if isinstance(c, tuple) else (c,)), marks=[] if c in daily else marks)
        for c in cases
    ]


class Sender:
    """A program on the virtual clock, which shows one person."""

    def __init__(self, end: Program, script: Script, rate_hz: float) -> None:
        self.end, self.period_ns = end, round(S / rate_hz)
        data = {
            "kind": "procedural", "room_from_source": NOWHERE, "rate_hz": rate_hz, "noise_m": 0.002,
            "people": [{"start": [6.0, 0.3], "script": script}],
        }  # fmt: skip
        self._person = ProceduralSource(validated(ProceduralSource.settings_model, data, "source"))
        self._person.open(0)
        end._began_ns = UTC

    def scene(self, k: int) -> Scene:
        due_ns = self._person.next_ns()
        assert due_ns is not None
        scene = self._person.poll(due_ns)
        assert scene is not None
        (person,) = scene.people
        return Scene(
            UTC + k * self.period_ns, k, True, (Person(1, person.positions, person.observed),)
        )


class Played:
    """The real source without its socket, on the node's virtual clock."""

    live = None

    def __init__(self, source: LiveSource, sender: Sender, units: Units) -> None:
        self.joint_map, self.rate_hz = source.joint_map, source.rate_hz
        self.declares_noise, self.counters = source.declares_noise, source.counters
        self._source, self._sender, self._units = source, sender, units
        self._k = self._start_ns = 0
        self._scenes: deque[Any] = deque()

    def open(self, start_ns: int) -> None:
        self._start_ns = start_ns
        for unit in self._sender.end.greeting:
            self._source._decoder.feed(unit, start_ns)

    def next_ns(self) -> int:
        return self._start_ns + self._k * self._sender.period_ns + 5 * MS

    def poll(self, now_ns: int) -> Scene | None:
        while (at_ns := self.next_ns()) <= now_ns:
            since_s = self._k * self._sender.period_ns / S
            for unit in self._units(self._sender, since_s, self._sender.scene(self._k)):
                self._scenes += self._source._decoder.feed(unit, at_ns)
            self._k += 1
        pose = self._source._room_from_sent
        return self._scenes.popleft().in_room(pose) if self._scenes else None

    def close(self) -> None:
        pass


class Levels(View):
    def __init__(self) -> None:
        self.seen: list[tuple[float, Level]] = []

    def bind(self, _assembly: object) -> None:
        pass

    def on_tick(self, tick: Any) -> None:
        (advice,) = tick.advices
        self.seen.append((tick.now_ns / S, advice.level))

    def between(self, begin_s: float, end_s: float) -> set[Level]:
        begin_s, end_s = (self.seen[0][0] + each for each in (begin_s, end_s))
        return {level for at_s, level in self.seen if begin_s <= at_s < end_s}


Watch = Callable[..., tuple[Levels, Any]]


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Watch:
    def ran(kind: str, script: Script, units: Units, **settings: Any) -> tuple[Levels, Any]:
        config = configuration.load(configuration.shipped(f"live_{kind}.yaml"))
        config = config.with_source(config.source.model_dump() | settings)
        source = assemble.build_source(config)
        assert isinstance(source, LiveSource)
        sender = Sender(PROGRAMS[kind](), script, config.source.rate_hz)  # type: ignore[attr-defined]
        played, levels = Played(source, sender, units), Levels()
        monkeypatch.setattr(assemble, "build_source", lambda *_, **__: played)
        run(config, Options(factor=None, duration_s=ENDS_S, view=levels))
        return levels, played.counters

    return ran


def sent(sender: Sender, _: float, scene: Scene) -> list[bytes]:
    return sender.end.encode(scene)


def until_fault(fault: Units) -> Units:
    return lambda sender, since_s, scene: (
        sent(sender, since_s, scene) if since_s < BEGINS_S else fault(sender, since_s, scene)
    )


@pytest.mark.parametrize("kind", some(PROGRAMS, "vmc"))
def test_a_person_who_walks_to_the_robot_stops_it(watch: Watch, kind: str) -> None:
    levels, counters = watch(kind, WALKS, sent)
    assert Level.CLEAR in levels.between(1.8, 3.0)
    assert levels.between(ENDS_S - 0.3, ENDS_S - 0.1) == {Level.STOP}
    assert counters.malformed == counters.lost == counters.out_of_order == 0


def silent(_sender: Sender, _since_s: float, _scene: Scene) -> list[bytes]:
    return []


def empty(sender: Sender, _: float, scene: Scene) -> list[bytes]:
    """The person is gone from what the program sends."""
    nobody = Scene(scene.stamp_ns, scene.sequence, True, ())
    return sender.end.encode(nobody)


def repeated(sender: Sender, _: float, scene: Scene) -> list[bytes]:
    """The program hangs: its time stands still."""
    return sender.end.encode(Scene(UTC + round(BEGINS_S * S), 100, True, scene.people))


def half_lost(sender: Sender, _: float, scene: Scene) -> list[bytes]:
    """The second half of each datagram is missing."""
    return [unit[: len(unit) // 2] for unit in sender.end.encode(scene)]


FAULTS = {"silent": silent, "empty": empty, "repeated": repeated, "cut": half_lost}
DAILY = (("vmc", "silent"), ("rokoko", "empty"), ("zed_livelink", "cut"))


@pytest.mark.parametrize(
    ("kind", "fault"), some([(kind, fault) for kind in PROGRAMS for fault in FAULTS], *DAILY)
)
def test_no_fault_of_the_sender_is_clear(watch: Watch, kind: str, fault: str) -> None:
    levels, counters = watch(kind, STANDS, until_fault(FAULTS[fault]))
    assert levels.between(3.0, BEGINS_S) == {Level.CLEAR}
    if fault == "empty" and kind in (
        "rokoko",
        "natnet",
    ):  # a scene without people; the person is lost
        assert Level.CLEAR not in levels.between(REACHED_S, ENDS_S - 0.1)
    else:
        assert levels.between(BEGINS_S + ACTS_S, ENDS_S - 0.1) == {Level.UNKNOWN}
    assert fault != "cut" or counters.malformed > 0
    assert fault != "repeated" or counters.replayed > 0


def two_programs(others: Callable[[Person], tuple[Person, ...]]) -> Units:
    """A second program behind the same address, 3 ms ahead, which does not see the person who is
    beside the robot, as the first one does."""

    def units(sender: Sender, _: float, scene: Scene) -> list[bytes]:
        (far,) = scene.people
        near = Person(1, far.positions - [5.0, 0.0, 0.0], far.observed)
        ahead = Scene(scene.stamp_ns + 3 * MS, scene.sequence + 9, True, others(far))
        beside = Scene(scene.stamp_ns, scene.sequence, True, (near,))
        return sender.end.encode(ahead) + sender.end.encode(beside)

    return units


AHEAD = {"far": lambda far: (far,), "empty": lambda _: ()}


@pytest.mark.parametrize(
    ("kind", "shows"),
    some(
        [("rokoko", "empty"), ("rokoko", "far"), ("vmc", "far"), ("natnet", "far")],
        ("rokoko", "empty"),
        ("vmc", "far"),
    ),
)
def test_a_person_whom_only_the_later_of_two_programs_sees_is_not_left_out(
    watch: Watch, kind: str, shows: str
) -> None:
    levels, counters = watch(kind, STANDS, until_fault(two_programs(AHEAD[shows])))
    assert levels.between(3.0, BEGINS_S) == {Level.CLEAR}
    assert levels.between(BEGINS_S + ACTS_S, ENDS_S - 0.1) <= {Level.UNKNOWN, Level.STOP}
    assert "two programs send to this port" in counters.last_error


@pytest.mark.parametrize("kind", some(PROGRAMS, "vmc"))
def test_a_sender_that_comes_back_is_believed_again(watch: Watch, kind: str) -> None:
    def paused(sender: Sender, since_s: float, scene: Scene) -> list[bytes]:
        return [] if since_s < BEGINS_S + 0.5 else sent(sender, since_s, scene)

    levels, counters = watch(kind, STANDS, until_fault(paused))
    assert levels.between(BEGINS_S + ACTS_S, BEGINS_S + 0.5) == {Level.UNKNOWN}
    assert levels.between(ENDS_S - 0.3, ENDS_S - 0.1) & {Level.CLEAR, Level.SLOW}
    assert counters.malformed == counters.out_of_order == 0


@pytest.mark.parametrize("kind", some(["vmc", "rokoko"], "vmc"))
def test_a_stream_whose_hips_stay_at_one_point_is_refused_by_name(watch: Watch, kind: str) -> None:
    def relative(sender: Sender, _: float, scene: Scene) -> list[bytes]:
        (person,) = scene.people
        waist = JOINTS.index("waist")
        centred = person.positions - person.positions[waist] * [1.0, 1.0, 0.0]
        centred[waist, :2] = 0.0  # exactly
        shown = Person(1, centred, person.observed)
        return sender.end.encode(Scene(scene.stamp_ns, scene.sequence, True, (shown,)))

    levels, counters = watch(kind, STANDS, relative)
    assert levels.between(0.5, ENDS_S - 0.1) == {Level.UNKNOWN}
    assert "relative stream" in counters.last_error


def test_who_is_not_tracked_by_the_performer_is_not_seen(watch: Watch) -> None:
    from hri_sim.senders import vmc

    def lost(sender: Sender, _: float, scene: Scene) -> list[bytes]:
        time_s = sender.end.time_s(scene)
        return vmc.capture(scene.people[0].positions, time_s, ok=(1, 3, 1, 0))

    levels, counters = watch("vmc", STANDS, until_fault(lost))
    assert levels.between(BEGINS_S + ACTS_S, ENDS_S - 0.1) == {Level.UNKNOWN}
    assert "lost its trackers" in counters.last_error


@pytest.mark.parametrize("kind", some(PROGRAMS, "rokoko"))
def test_a_source_that_does_not_cover_the_room_is_never_clear(watch: Watch, kind: str) -> None:
    levels, _ = watch(kind, STANDS, sent, sees_room=False)
    assert Level.CLEAR not in {level for _, level in levels.seen}
