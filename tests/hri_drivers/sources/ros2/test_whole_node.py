"""The whole node on the virtual clock, from bytes of ROS messages to advice: no fault is clear.

The person stands 6 m from the robot, so the healthy cell says clear, and would go on to. What real
nodes and Fast DDS add is in ``test_never_clear``.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from hri_drivers.sources.ros2.decoder import Ros2Decoder
from hri_drivers.sources.ros2.settings import KINDS, Ros2SourceSettings
from hri_drivers.sources.sent import SentScene
from hri_drivers.wires.ros2_heard import NO_SEQUENCE, TF, Heard
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.messages import Level
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.messages import TF_MESSAGE
from hri_predict.protocol.ros.placing import PeopleReader
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_drivers.sources.scene_streaming import hri_sender
from tests.hri_predict.protocol.ros.sent import UPRIGHT, Maker

MAKER = Maker()
S, MS = 10**9, 10**6
UTC = 1_790_000_000 * S
PERIOD_NS = 33_333_333
BEGINS_S, ENDS_S = 3.5, 6.0
ACTS_S = 0.5
"""A fault shows within this time: 0.2 s for transforms, and the time after which input is stale."""
ONE, OTHER = b"a" * 16, b"b" * 16
CANONICAL = load_joint_map("canonical").source_joints
FILES = {"pose_array": "live_ros2", "ros4hri": "live_ros4hri", "zed": "live_zed"}
CONFIGS = {k: configuration.load(configuration.shipped(f"{f}.yaml")) for k, f in FILES.items()}


def settings_of(message: str) -> Ros2SourceSettings:
    source = CONFIGS[message].source
    assert isinstance(source, Ros2SourceSettings)
    return source


@dataclass
class Sender:
    """What is sent at one capture; a test changes it when the fault begins."""

    message: str
    now: bool = True
    """Whether it is switched on."""
    shows: bool = True
    """Whether the frames of ros4hri are sent, and the list."""
    lists: bool = True
    shift_ns: int = 0
    stamped: bool = True
    frame: str = ""
    prefix: str = ""
    people: int = 1
    held: int | None = None
    """Number of the capture whose frames are sent again and again."""
    delay_ns: int = 0
    other_people: int | None = None
    other_frames_m: float | None = None
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def units(self, k: int) -> list[bytes]:
        """The messages of capture ``k``."""
        if not self.now:
            return []
        at_ns = (UTC + k * PERIOD_NS + self.shift_ns) * self.stamped
        found = [self._unit(0, ONE, self._people(at_ns, k, self.people))] if self.lists else []
        if self.other_people is not None:
            found.append(self._unit(0, OTHER, self._people(at_ns + MS, k, self.other_people)))
        if self.message == "ros4hri" and self.shows:
            held = k if self.held is None else self.held
            frames_ns = UTC + held * PERIOD_NS + self.shift_ns
            found.append(self._unit(TF, ONE, self._frames(frames_ns, held, 0.0), TF_MESSAGE))
            if self.other_frames_m is not None:
                frames = self._frames(at_ns, k, self.other_frames_m)
                found.append(self._unit(TF, OTHER, frames, TF_MESSAGE))
        return found

    def _unit(self, topic, gid, message, kind=None):
        content = MAKER.cdr(message, kind or KINDS[self.message])
        return Heard(topic, gid, NO_SEQUENCE, content).packed()

    def _points(self, k):
        points = np.array(hri_sender().swaying(k * PERIOD_NS / S, (2.0, 0.0)))
        return points + self.rng.normal(0.0, 0.002, points.shape)

    def _people(self, at_ns, k, people):
        frame = self.frame or settings_of(self.message).frame
        if self.message == "ros4hri":
            return MAKER.tracked(*(["abc"] * people), at_ns=at_ns)
        if self.message == "zed":
            bodies = {number: self._of_34(self._points(k)) for number in range(people)}
            return MAKER.objects(bodies, frame, at_ns)
        points = self._points(k) if people else np.zeros((0, 3))
        return MAKER.poses(points, frame, at_ns)

    def _of_34(self, points):
        found = np.full((34, 3), np.nan)
        names = load_joint_map("zed34")
        for joint, row in zip(CANONICAL, names.weights, strict=True):
            for source in np.flatnonzero(row):
                found[source] = points[CANONICAL.index(joint)]
        ears, hips = [29, 31], [18, 22]
        found[ears] = points[CANONICAL.index("head")] + [[0, 0.07, 0], [0, -0.07, 0]]
        found[hips] = points[[CANONICAL.index(f"{side}_hip") for side in "lr"]]
        shoulders = [CANONICAL.index(f"{side}_shoulder") for side in "lr"]
        found[[5, 12]] = points[shoulders]
        return found

    def _frames(self, at_ns, k, left_m):
        points = dict(zip(CANONICAL, self._points(k) + np.array([0, left_m, 0]), strict=True))
        points["body"] = points["waist"]
        edges = [
            (self.frame or "map", f"{self.prefix}{name}_abc", tuple(points[name]), UPRIGHT)
            for name in load_joint_map("ros4hri").source_joints
        ]
        return MAKER.transforms(*edges, at_ns=at_ns)


class Played:
    """A source that hears a sender on the node's virtual clock."""

    live = None
    declares_noise = True

    def __init__(self, sender: Sender, fault: dict[str, object]) -> None:
        settings = settings_of(sender.message)
        made = load_joint_map(settings.joint_map)
        self.joint_map = made.with_units(1.0).with_axes(settings.axes)
        self.rate_hz = 30.0
        self.counters = SourceCounters()
        tree = FrameTree()
        self._decoder = Ros2Decoder(
            kind=KINDS[sender.message],
            topics=list(settings.topics),
            reader=PeopleReader(self.joint_map.source_joints, settings.frame, tree),
            tree=tree,
            counters=self.counters,
            sees_room=True,
        )
        self._sender, self._fault = sender, fault
        self._k = 0
        self._start_ns = 0
        self._line: deque[tuple[int, bytes]] = deque()
        self._scenes: deque[SentScene] = deque()

    def open(self, start_ns: int) -> None:
        self._start_ns = start_ns

    def next_ns(self) -> int:
        return self._line[0][0] if self._line else self._start_ns + self._k * PERIOD_NS + 5 * MS

    def poll(self, now_ns: int):
        while (at_ns := self._start_ns + self._k * PERIOD_NS + 5 * MS) <= now_ns:
            if self._k * PERIOD_NS >= BEGINS_S * S:
                for name, value in self._fault.items():
                    setattr(self._sender, name, value)
            late_ns = at_ns + self._sender.delay_ns
            self._line += [(late_ns, unit) for unit in self._sender.units(self._k)]
            self._k += 1
        while self._line and self._line[0][0] <= now_ns:
            at_ns, unit = self._line.popleft()
            self._scenes += self._decoder.feed(unit, at_ns)
        pose = np.eye(4)
        pose[0, 3] = 4.0
        return self._scenes.popleft().in_room(pose) if self._scenes else None

    def close(self) -> None:
        pass


class Levels(View):
    def __init__(self) -> None:
        self.seen: list[tuple[float, Level]] = []

    def bind(self, _assembly: object) -> None:
        pass

    def on_tick(self, tick) -> None:
        (advice,) = tick.advices
        self.seen.append((tick.now_ns / S, advice.level))

    def between(self, begin_s: float, end_s: float) -> set[Level]:
        begin_s, end_s = (self.seen[0][0] + each for each in (begin_s, end_s))
        return {level for at_s, level in self.seen if begin_s <= at_s < end_s}


@pytest.fixture
def watch(monkeypatch):
    def ran(message, **fault):
        played, levels = Played(Sender(message), fault), Levels()
        monkeypatch.setattr(assemble, "build_source", lambda *_, **__: played)
        run(CONFIGS[message], Options(factor=None, duration_s=ENDS_S, view=levels))
        return levels, played.counters

    return ran


@pytest.mark.parametrize("message", FILES)
def test_the_healthy_cell_says_clear(watch, message):
    levels, counters = watch(message)
    assert levels.between(3.0, ENDS_S - 0.1) == {Level.CLEAR}
    assert counters.malformed <= 1  # the first list comes before the first frames


FAULTS: dict[str, dict[str, Any]] = {
    "unplugged": {"now": False},
    "wrong frame": {"frame": "lidar"},
    "earlier stamps": {"shift_ns": -1000 * S},
    "stamps of zero": {"stamped": False},
    "delayed 0.5 s": {"delay_ns": S // 2},
    "two publishers, one sees no one": {"other_people": 0},
}
OF_FRAMES: dict[str, dict[str, Any]] = {
    "the list stops": {"lists": False},
    "frames stop": {"shows": False},
    "frames repeat": {"held": 100},
    "wrong names": {"prefix": "human_"},
    "two publishers of the frames": {"other_frames_m": 1.0},
}
CASES = [(m, name) for m in FILES for name in FAULTS] + [("ros4hri", name) for name in OF_FRAMES]
DAILY = ("frames repeat", "two publishers of the frames")


@pytest.mark.parametrize(
    ("message", "name"),
    [pytest.param(*c, marks=[] if c[1] in DAILY else [pytest.mark.long]) for c in CASES],
)
def test_no_fault_is_clear(watch, message, name):
    levels, _ = watch(message, **(FAULTS | OF_FRAMES)[name])
    assert Level.CLEAR in levels.between(3.0, BEGINS_S)
    until_s = BEGINS_S + 1.0 if name in ("earlier stamps", "delayed 0.5 s") else ENDS_S
    assert Level.CLEAR not in levels.between(BEGINS_S + ACTS_S, until_s)
