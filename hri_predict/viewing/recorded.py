"""Pictures of a recording, from /view/scene, /zones, /forecast, /status and /advice.

It is read in windows, so that a recording of hours needs no more memory than one of minutes.
"""

import bisect
import itertools
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import PARENTS
from hri_predict.protocol.messages import Advice, Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.recording import RecordingInfo, Told, read_messages, recording_info
from hri_predict.recording.mcap.clocks import iso
from hri_predict.recording.mcap.view import PAIR
from hri_predict.recording.mcap.well_known import DAMAGED, FARTHEST_M, capsules_of, lines_of
from hri_predict.risk.types import Grounds
from hri_predict.viewing.levels import worst
from hri_predict.viewing.packing import bodies_of, robot_facts, state_facts, steps_of
from hri_predict.viewing.picture import Picture, Shapes, empty_shapes
from hri_predict.viewing.recorded_times import RecordedTimes
from hri_predict.viewing.room import band_of_text, room_of_text, sees

WINDOW_NS = 30_000_000_000
WINDOWS = 4
"""Number of windows kept in memory."""
BEFORE_NS = 2_000_000_000
OLD_NS = 600_000_000
"""Maximum age of zones and forecasts in a picture; older means that three are missing."""
BONE_M = 0.06
_CHILDREN = [joint for joint, parent in enumerate(PARENTS) if parent >= 0]
"""Joints with a recorded bone to their parent."""
_TOPICS = ("/status", "/advice", "/zones", "/forecast", "/view/scene")


class RecordedPictures:
    """A recording's pictures by time, and its levels.

    All times are those of the node's clock: the wall clock may have been set back meanwhile, so
    that one UTC names two moments.

    Attributes:
        info: description of the recording.
        start_ns, end_ns: times of the first and last advice.
        changes: (ns, the worst level from then on).
        first_ns: time of the first person, otherwise of the first change of level.

    Raises:
        RecordingError: it is not a recording of this node, has no content, or is damaged.
        OSError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.info: RecordingInfo = recording_info(path)
        self.changes: list[tuple[int, str]] = []
        self._times = RecordedTimes()
        times: list[int] = []
        levels: dict[str, str] = {}
        met_ns: int | None = None
        for told in read_messages(path, ("/advice",)):
            self._times.note(told)
            times.append(told.node_ns)
            levels[told.topic] = str(told.data.get("level"))
            level = worst(levels.values())
            if met_ns is None and told.data.get("separation_m") is not None:
                met_ns = told.node_ns
            if not self.changes or self.changes[-1][1] != level:
                self.changes.append((told.node_ns, level))
        if not times:
            raise RecordingError(f"recording {path}: no advice to show; name another file")
        self.start_ns, self.end_ns = min(times), max(times)
        self.first_ns = self.changes[:2][-1][0] if met_ns is None else met_ns
        self._room = room_of_text(self.info.config, self.info.cell or path.stem)
        self._band_m = band_of_text(self.info.config)
        self._windows: OrderedDict[int, list[tuple[int, Picture]]] = OrderedDict()

    @property
    def duration_s(self) -> float:
        """Return the time from the first to the last advice, in seconds."""
        return (self.end_ns - self.start_ns) * 1e-9

    def opening_ns(self) -> int:
        """Return the start of a view: the first picture that has a person in it, if any does."""
        try:
            picture = self.at(self.first_ns)
        except RecordingError:  # whoever goes there is told
            return self.first_ns
        is_before = picture is not None and not picture.facts["people"]
        return self.picture_beside(self.first_ns, 1) if is_before else self.first_ns

    def level_at(self, ns: int) -> str:
        """Return the worst level at that time."""
        index = bisect.bisect_right(self.changes, ns, key=lambda change: change[0])
        return self.changes[max(0, index - 1)][1]

    def levels(self, parts: int) -> list[str]:
        """Return the worst level in each of this number of equal parts of the recording."""
        span = max(1, self.end_ns - self.start_ns)
        edges = [self.start_ns + span * k // parts for k in range(parts + 1)]
        found = []
        for start, end in itertools.pairwise(edges):
            first = bisect.bisect_right(self.changes, start, key=lambda change: change[0])
            last = bisect.bisect_left(self.changes, end, key=lambda change: change[0])
            within = [level for _, level in self.changes[first:last]]
            found.append(worst([self.level_at(start), *within]))
        return found

    def change_beside(self, ns: int, by: int) -> int:
        """Return the time of the next change of level, or (``by`` -1) of the last one before."""
        times = [then_ns for then_ns, _ in self.changes]
        if by > 0:
            index = bisect.bisect_right(times, ns)
            return times[index] if index < len(times) else self.end_ns
        index = bisect.bisect_left(times, ns)
        return times[index - 1] if index else self.start_ns

    def picture_beside(self, ns: int, by: int) -> int:
        """Return the time of the next picture, or (``by`` -1) of the last picture before a time."""
        number = (ns - self.start_ns) // WINDOW_NS
        for each in (number, number + by):
            times = [then_ns for then_ns, _ in self._window(each)]
            found = [t for t in times if (t - ns) * by > 0]
            if found:
                return min(found, key=lambda t: abs(t - ns))
        return min(max(ns + by * WINDOW_NS, self.start_ns), self.end_ns)

    def at(self, ns: int) -> Picture | None:
        """Return the newest picture at a time; ``None`` if there is none in the seconds before."""
        window = self._window((ns - self.start_ns) // WINDOW_NS)
        index = bisect.bisect_right(window, ns, key=lambda each: each[0])
        return window[index - 1][1] if index and ns - window[index - 1][0] < BEFORE_NS else None

    def _window(self, number: int) -> list[tuple[int, Picture]]:
        """Return the pictures of one window, and of the seconds before it."""
        if number not in self._windows:
            self._windows[number] = self._read(self.start_ns + number * WINDOW_NS)
            while len(self._windows) > WINDOWS:
                self._windows.popitem(last=False)
        self._windows.move_to_end(number)
        return self._windows[number]

    def _read(self, start_ns: int) -> list[tuple[int, Picture]]:
        try:
            return list(self._pictures(self._messages(start_ns - BEFORE_NS, start_ns + WINDOW_NS)))
        except DAMAGED as error:
            raise RecordingError(
                f"recording {self._path}: a message is damaged ({error}); it cannot be shown"
            ) from error

    def _messages(self, start_ns: int, end_ns: int) -> Iterator[Told]:
        """Yield the messages from ``start_ns`` to before ``end_ns``, in the order of time."""
        spans = self._times.utc(start_ns, end_ns)
        read = (
            read_messages(self._path, _TOPICS, start_utc_ns=low, end_utc_ns=high)
            for low, high in spans
        )
        found = (m for m in itertools.chain.from_iterable(read) if start_ns <= m.node_ns < end_ns)
        return iter(sorted(found, key=lambda told: told.node_ns)) if len(spans) > 1 else found

    def _pictures(self, messages: Iterator[Told]) -> Iterator[tuple[int, Picture]]:
        """A picture after each /view/scene, and wherever an advice changes between two of them.

        Status and advice of a scene's tick precede it.
        """
        said = _Said(self._band_m)
        for told in messages:
            if told.topic.startswith("/advice"):
                before = said.advice.get(told.topic)
                said.advice[told.topic] = told
                if before is not None and _says(before) == _says(told):
                    continue
            else:
                said.newest[told.topic] = told
                if told.topic != "/view/scene":
                    continue
            scene = said.newest.get("/view/scene")
            if scene is not None and told.node_ns - scene.node_ns < BEFORE_NS:
                picture = said.picture(self._room, self.info.forecast_rate_hz, told)
                picture.facts["coverage"] = self.info.coverage or "not recorded"
                yield told.node_ns, picture


def _says(advice: Told) -> tuple[Any, ...]:
    """Return an advice in words for a screen."""
    return advice.data.get("level"), advice.data.get("reason"), advice.data.get("latch_id")


@dataclass(slots=True)
class _Said:
    """The newest message of each topic, and the configured ``risk.band_m``."""

    band_m: float | None
    newest: dict[str, Told] = field(default_factory=dict)
    advice: dict[str, Told] = field(default_factory=dict)

    def picture(self, room: dict[str, Any], rate_hz: float, now: Told) -> Picture:
        """Return the picture at a message: the newest scene and later messages."""
        scene = self.newest["/view/scene"]
        shapes = empty_shapes()
        people, lost, robots, lines = _entities(scene.data["entities"])
        ids = [*people, *lost]
        bones = [*people.values(), *lost.values()]
        shapes["bodies"] = _padded(bones)
        facts = self._facts(room, ids, len(people), now)
        facts["places"] = [each[:, :2].mean(axis=0).tolist() for each in people.values()]
        if (zones := self._fresh("/zones", scene)) is not None:
            steps = steps_of(len(zones["times_s"]))
            facts["zones"] = [int(id_) for id_ in zones["ids"]]
            facts["times_s"] = [float(zones["times_s"][k]) for k in steps]
            rows = _floats(zones["capsules"])
            shapes["zones"] = rows.reshape(len(facts["zones"]), -1, rows.shape[-2], 7)[:, steps]
            forecast = self._fresh("/forecast", scene)
            if forecast is not None and forecast["ids"]:
                shapes["forecast"] = _forecast(forecast, facts["times_s"], rate_hz)
        parts = []
        for robot in facts["robots"]:
            rows = robots.get(robot["name"], shapes["robots"][:0])
            robot["capsules"] = len(rows)
            robot["line"] = lines.get(robot["name"])
            parts.append(rows)
        if parts:
            shapes["robots"] = np.concatenate(parts)
        return Picture(facts, **shapes)

    def _fresh(self, topic: str, scene: Told) -> dict[str, Any] | None:
        told = self.newest.get(topic)
        if told is None or scene.node_ns - told.node_ns > OLD_NS:
            return None
        return told.data

    def _facts(
        self, room: dict[str, Any], ids: list[int], tracked: int, now: Told
    ) -> dict[str, Any]:
        status = self.newest["/status"].data if "/status" in self.newest else {}
        named = status.get("named_zones", {})
        state = _known(status.get("node_state"), NodeState)
        reasons = [_reason(name) for name in status.get("reasons", [])]
        return {
            "node_s": now.node_ns * 1e-9,
            "utc": iso(now.utc_ns),
            **state_facts(NodeState[state], reasons),
            "robots": [_robot(told.data, self.band_m) for told in self.advice.values()],
            "people": ids,
            "tracked": tracked,
            "age_s": _number(status.get("age_s")),
            "sees": bool(status) and sees(reasons),
            "named": {name: [z["occupied"], z["entry_s"]] for name, z in named.items()},
            "zones": [],
            "times_s": [0.0],
            "room": room,
        }


def _robot(data: dict[str, Any], band_m: float | None) -> dict[str, Any]:
    why = data.get("grounds") or {}
    advice = Advice(
        robot=0,
        level=Level[_known(data["level"], Level)],
        reason=_reason(data["reason"]),
        latch_id=data.get("latch_id", 0),
        separation_m=_number(data.get("separation_m")),
        speed_limit_m_s=_number(data.get("speed_limit_m_s")),
        detail=str(data.get("detail", "")),
    )
    grounds = Grounds(
        speed_m_s=_number(data.get("speed_m_s")),
        person=why.get("person"),
        segment=str(why.get("segment", "")),
        pair_m=_number(why.get("pair_m")),
        slack_m=_number(why.get("slack_m")),
        milder_slack_m=_number(why.get("milder_slack_m")),
        hidden_ends=why.get("hidden_ends") or 0,
    )
    name, link = str(data.get("name", data.get("robot"))), str(why.get("robot_capsule") or "")
    return robot_facts(name, advice, grounds, link=link, band_m=band_m)


def _known(name: Any, kind: type[Level] | type[NodeState]) -> str:
    """Return the name of a level or state; UNKNOWN for any other value."""
    return str(name) if name in kind.__members__ else "UNKNOWN"


def _reason(name: Any) -> Reason:
    return Reason[name] if name in Reason.__members__ else Reason.NODE_FAULT


def _entities(
    entities: list[dict[str, Any]],
) -> tuple[dict[int, Shapes], dict[int, Shapes], dict[str, Shapes], dict[str, Any]]:
    """Return bones by id of people and of lost people, capsules by robot, and nearest points.

    The points are those of each robot's deciding pair; older recordings lack them.
    """
    people: dict[int, Shapes] = {}
    lost: dict[int, Shapes] = {}
    robots: dict[str, Shapes] = {}
    pairs: dict[str, Any] = {}
    for entity in entities:
        kind, _, name = entity["id"].partition(" ")
        if kind == "person":
            seen = entity["lines"][0]["color"]["a"] >= 1.0
            bones = lines_of(entity).reshape(-1, 6).astype(np.float32)
            (people if seen else lost)[int(name)] = _body(bones)
        elif kind == "robot":
            robots[name] = capsules_of(entity).astype(np.float32)
        elif kind == PAIR:
            line = lines_of(entity)[0]
            pairs[name] = line.tolist() if np.isfinite(line).all() else None
    return people, lost, robots, pairs


def _body(bones: Shapes) -> Shapes:
    """Return a body (S, 7) from its (B, 6) bones; only the bones if it was not fully seen."""
    if len(bones) != len(_CHILDREN):
        radii = np.full((len(bones), 1), BONE_M, np.float32)
        return np.concatenate((bones, radii), axis=1)
    joints = np.empty((1, len(PARENTS), 3))
    joints[0, [PARENTS[child] for child in _CHILDREN]] = bones[:, 3:]
    joints[0, _CHILDREN] = bones[:, :3]
    return bodies_of(joints)[0]


def _padded(bones: list[Shapes]) -> Shapes:
    """Stack people with different numbers of seen bones; missing ones are NaN."""
    most = max((len(each) for each in bones), default=1)
    rows = np.full((len(bones), most, 7), np.nan, np.float32)
    for row, each in zip(rows, bones, strict=True):
        row[: len(each)] = each
    return rows


def _forecast(data: dict[str, Any], times_s: list[float], rate_hz: float) -> Shapes:
    """Return the recorded steps nearest to each time, as bodies."""
    joints: Floats = np.asarray(data["positions"], dtype=np.float64)
    ahead_s = (np.asarray(data["steps"]) + 1) / (rate_hz or 25.0)
    nearest = [int(np.abs(ahead_s - time_s).argmin()) for time_s in times_s]
    return bodies_of(joints[:, nearest])


def _floats(values: Any) -> Shapes:
    """Those that no room has become NaN, and are not drawn."""
    found = np.array(values, dtype=np.float64)
    return np.where(np.abs(found) < FARTHEST_M, found, np.nan).astype(np.float32)


def _number(value: Any) -> float | None:
    """Return a number from a message; ``None`` if it is not a number."""
    return float(value) if isinstance(value, int | float) else None
