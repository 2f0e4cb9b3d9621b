"""Measures the true distances and touches between people and robots.

Unlike the node, the referee knows the true positions of every body and of the arm. Bodies are
capsules with their real radii, without any margin. A joint that is missing in the recording is
skipped, never guessed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import Source
from hri_predict.robots.model import RobotModel

MOVING_M_S = 0.010  # faster than this, a touch is a contact
RELEASE_M = 0.02  # a touch is over when the surfaces are this far apart
_STEP_S = 0.010
_LONGEST_GAP_S = 0.5  # no interpolation across a longer gap

Bodies = Mapping[int, tuple[Floats, Bools]]
"""Person id -> canonical joints (J, 3), metres, room frame, and which of them are known (J,)."""

Joints = Mapping[str, tuple[Floats, Floats]]
"""Robot name -> (N,) rad, m and (N,) rad/s, m/s; a moving base's coordinates first."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Contact:
    """Touches of people and one robot between two observations.

    Arrays have P people and K instants.

    Attributes:
        robot: name of the robot.
        bodies: (P, K, B) capsules, see ``body_capsules``.
        velocity: (P, B, 3) of both ends of each capsule, m/s.
        links: (K, C) the robot's capsules.
        distance: (P, K, B, C); infinite for capsules that do not count.
        speed: (K,) speed of the robot's fastest point.
    """

    robot: str
    bodies: Capsules
    velocity: tuple[Floats, Floats]
    links: Capsules
    distance: Floats
    speed: Floats

    @property
    def moving(self) -> Bools:
        """Return (K,) whether the robot moves."""
        result: Bools = self.speed > MOVING_M_S
        return result


@dataclass(slots=True)
class _Touch:
    """The current touch between one person and one robot."""

    touching: bool = False
    counted_moving: bool = False


@dataclass(kw_only=True)
class Tally:
    """The sums of a referee.

    Attributes:
        contacts: touches during which some point of the robot moved faster than 10 mm/s.
        contacts_standing: touches during which the robot did not move.
        min_separation_m: smallest distance of any body from any robot, at most 0 after a touch;
            ``None`` before the first person.
        moving_separation_m: the same while the robot moved (faster than 10 mm/s).
        violation_s, violation_m: time in which any robot moved (faster than 10 mm/s) while a person
            was nearer to it than C + Z_d + Z_r, and the maximum shortfall.
    """

    contacts: int = 0
    contacts_standing: int = 0
    min_separation_m: float | None = None
    moving_separation_m: float | None = None
    violation_s: float = 0.0
    violation_m: float = 0.0

    def tally(self) -> dict[str, Any]:
        """Return only these sums."""
        return {each.name: getattr(self, each.name) for each in fields(Tally)}


class Referee(Tally):
    """Counts touches of every person with every robot.

    Bodies and joints are interpolated between two observations, so that the referee detects touches
    shorter than a cycle of the node. A touch counts once for each person and robot, however long it
    lasts: as a contact if any point of the robot moved faster than 10 mm/s during the touch,
    otherwise as a contact with a standing robot.

    Attributes:
        observations: number of instants judged.
    """

    def __init__(
        self,
        robots: Sequence[RobotModel],
        clearance_m: float = 0.0,
        tool_of: Callable[[str], int | None] | None = None,
        on_contact: Callable[[Contact], None] | None = None,
    ) -> None:
        """Start without observations.

        Args:
            robots: robots by name, as in ``observe``.
            clearance_m: C + Z_d + Z_r.
            tool_of: robot name -> number of the tool that it carries; ``None``: all tools. Without
                this function: all tools.
            on_contact: called with the touches of a moving robot.
        """
        super().__init__()
        self._tool_of = tool_of or (lambda _: None)
        self._on_contact = on_contact
        self._robots = {robot.name: robot for robot in robots}
        self._touches: dict[tuple[int, str], _Touch] = {}
        self._last: tuple[int, Bodies, Joints] | None = None
        self._clearance_m = clearance_m
        self.observations = 0

    def observe(self, now_ns: int, people: Bodies, robots: Joints) -> None:
        """Judge the time since the last observation, given the true state at ``now_ns``."""
        times = self._instants(now_ns)
        elapsed_s = 0.0 if self._last is None else (now_ns - self._last[0]) * 1e-9
        if people:
            ids = sorted(people)
            bodies = self._bodies(ids, people, times)
            near = np.zeros(len(times), dtype=bool)
            for name, (q, qd) in robots.items():
                robot, speed = self._motion(name, q, qd, times)
                gaps = self._judge(
                    ids=ids,
                    bodies=bodies,
                    name=name,
                    robot=robot,
                    speed=speed,
                    elapsed_s=elapsed_s,
                )
                near |= self._too_near(gaps.min(axis=0), speed)
            self.violation_s += elapsed_s / len(times) * np.count_nonzero(near)
        gone = [key for key in self._touches if key[0] not in people]
        for key in gone:
            del self._touches[key]
        self._last = (now_ns, people, robots)
        self.observations += len(times)

    def _instants(self, now_ns: int) -> Floats:
        """Return (K,) fractions of the way from the last observation to this one; the last is 1."""
        elapsed_s = 0.0 if self._last is None else (now_ns - self._last[0]) * 1e-9
        if not 0 < elapsed_s <= _LONGEST_GAP_S:
            return np.ones(1)
        count = math.ceil(elapsed_s / _STEP_S)
        return np.arange(1, count + 1) / count

    def _bodies(self, ids: Sequence[int], people: Bodies, times: Floats) -> tuple[Capsules, Bools]:
        """Return capsules (P, K, S + J), segments then lone joints as spheres, and which count."""
        shape = (len(ids), len(times), len(CANONICAL.joints))
        positions = np.zeros((*shape, 3))
        known = np.zeros(shape, dtype=bool)
        before = self._last[1] if self._last is not None else {}
        for p, person in enumerate(ids):
            now, now_known = people[person]
            if person not in before:  # new: its earlier positions are not known
                positions[p], known[p, -1] = now, now_known
                continue
            then, then_known = before[person]
            start = np.where(then_known[:, None], then, now)
            end = np.where(now_known[:, None], now, then)
            positions[p] = start + (end - start) * times[:, None, None]
            known[p] = then_known | now_known
        return body_capsules(positions, known)

    def _motion(self, name: str, q: Floats, qd: Floats, times: Floats) -> tuple[Capsules, Floats]:
        """Return the robot's capsules (K, C) and its fastest point's speed (K,) at each instant."""
        model = self._robots[name].counting(self._tool_of(name))
        if self._last is not None and name in self._last[2]:
            q0, qd0 = self._last[2][name]
            q = q0 + (q - q0) * times[:, None]
            qd = qd0 + (qd - qd0) * times[:, None]
        else:
            q, qd = (np.repeat(v[None], len(times), axis=0) for v in (q, qd))
        return model.capsules(q), np.asarray(model.tip_speed(q, qd))

    def _judge(
        self,
        *,
        ids: Sequence[int],
        bodies: tuple[Capsules, Bools],
        name: str,
        robot: Capsules,
        speed: Floats,
        elapsed_s: float,
    ) -> Floats:
        """Record every touch; return the distance (P, K) of each person from this robot."""
        body, counts = bodies
        distance = capsule_distance(
            Capsules(body.a[..., :, None, :], body.b[..., :, None, :], body.radius[..., :, None]),
            Capsules(robot.a[:, None], robot.b[:, None], robot.radius[:, None]),
        )
        distance = np.where(counts[..., None], distance, np.inf)  # (P, K, B, C)
        if self._on_contact is not None and (distance[:, speed > MOVING_M_S] <= 0).any():
            self._on_contact(
                Contact(
                    robot=name,
                    bodies=body,
                    velocity=(_mean_velocity(body.a, elapsed_s), _mean_velocity(body.b, elapsed_s)),
                    links=robot,
                    distance=distance,
                    speed=speed,
                )
            )
        distance = distance.min(axis=(-2, -1))  # (P, K)
        self._note(ids, name, distance, speed)
        return distance

    def _note(self, ids: Sequence[int], name: str, distance: Floats, speed: Floats) -> None:
        """Follow every touch (P, K) of one robot; ``speed`` (K,) of its fastest point, m/s."""
        least = float(distance.min())
        if math.isfinite(least):
            known = self.min_separation_m
            self.min_separation_m = least if known is None else min(known, least)
        for person, row in zip(ids, distance, strict=True):
            touch = self._touches.setdefault((person, name), _Touch())
            for gap, fastest in zip(row.tolist(), speed.tolist(), strict=True):
                self._follow(touch, gap, fastest)

    def _too_near(self, gaps: Floats, speed: Floats) -> Bools:
        """Measure one robot's distances (M,), m, at instants with the speed (M,) of its fastest
        point; return at which ones it moves nearer than permitted (M,).
        """
        moving = speed > MOVING_M_S
        least = float(gaps[moving].min(initial=np.inf))
        if math.isfinite(least):
            known = self.moving_separation_m
            self.moving_separation_m = least if known is None else min(known, least)
            self.violation_m = max(self.violation_m, self._clearance_m - least)
        near: Bools = moving & (gaps < self._clearance_m)
        return near

    def _follow(self, touch: _Touch, gap: float, fastest: float) -> None:
        if gap > RELEASE_M:
            touch.touching = touch.counted_moving = False
        elif gap <= 0 or touch.touching:
            moving = gap <= 0 and fastest > MOVING_M_S
            if not touch.touching:
                touch.touching = True
                self.contacts_standing += 1
            if moving and not touch.counted_moving:  # it was, or became, a contact
                touch.counted_moving = True
                self.contacts_standing -= 1
                self.contacts += 1


def _mean_velocity(places: Floats, elapsed_s: float) -> Floats:
    """Return velocities (P, B, 3) of points (P, K, B, 3), evenly spaced over ``elapsed_s``."""
    count = places.shape[1]
    if count < 2:
        return np.zeros_like(places[:, 0])
    step_s = elapsed_s / count
    return (places[:, -1] - places[:, 0]) / ((count - 1) * step_s)


def body_capsules(positions: Floats, known: Bools) -> tuple[Capsules, Bools]:
    """Return capsules (..., S + J) and which of them count: segments, then lone joints as spheres.

    Args:
        positions: (..., J, 3) canonical joints, metres.
        known: (..., J) which of them are known.
    """
    known = known & np.isfinite(positions).all(axis=-1)
    positions = np.where(known[..., None], positions, 0.0)
    whole = known[..., _ENDS[:, 0]] & known[..., _ENDS[:, 1]]
    lone = known & ~(whole @ _BELONGS)
    capsules = Capsules(
        np.concatenate([positions[..., _ENDS[:, 0], :], positions], axis=-2),
        np.concatenate([positions[..., _ENDS[:, 1], :], positions], axis=-2),
        np.broadcast_to(_RADII, (*known.shape[:-1], len(_RADII))),
    )
    return capsules, np.concatenate([whole, lone], axis=-1)


@runtime_checkable
class KnowsTruth(Protocol):
    """A source that knows people's true positions, without noise, dropout and late stamps."""

    def open(self, start_ns: int) -> None:
        """Start, at the same time as the node's own copy."""

    def truth(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return id -> canonical joints (J, 3) and which are known (J,), at ``now_ns``."""


class KnownPeople:
    """The true positions of all people at any time, from a source that knows them."""

    def __init__(self, source: KnowsTruth) -> None:
        self.open, self.at = source.open, source.truth


class TruePeople:
    """The true positions of all people at any time, from a copy of the source without faults.

    The copy is polled slightly ahead, so that people can be interpolated between two scenes. A live
    source cannot deliver future scenes, so its newest scene is held.
    """

    def __init__(self, source: Source) -> None:
        """``source`` belongs to this object; nothing else may poll it."""
        self._source = source
        self._ahead_ns = round(2e9 / source.rate_hz)
        self._scenes: list[Scene] = []

    def open(self, start_ns: int) -> None:
        """Open the source, at the same time as the node's own copy."""
        self._source.open(start_ns)

    def at(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return id -> canonical joints (J, 3) and which are known (J,), at ``now_ns``."""
        while (scene := self._source.poll(now_ns + self._ahead_ns)) is not None:
            self._scenes.append(scene)
        while len(self._scenes) > 1 and self._scenes[1].stamp_ns <= now_ns:
            self._scenes.pop(0)
        if not self._scenes or self._scenes[0].stamp_ns > now_ns:
            return {}
        here = self._mapped(self._scenes[0])
        if len(self._scenes) < 2:
            return here
        then_ns, next_ns = (scene.stamp_ns for scene in self._scenes[:2])
        if next_ns - then_ns > _LONGEST_GAP_S * 1e9:
            return here
        fraction = (now_ns - then_ns) / (next_ns - then_ns)
        later = self._mapped(self._scenes[1])
        for person, (end, end_known) in later.items():
            if person in here:
                start, known = here[person]
                both = (known & end_known)[:, None]
                here[person] = (np.where(both, start + (end - start) * fraction, start), known)
        return here

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def _mapped(self, scene: Scene) -> dict[int, tuple[Floats, Bools]]:
        joint_map = self._source.joint_map
        return {p.id: joint_map.map(p.positions, p.observed) for p in scene.people}


_ENDS = np.array([(s.joint_a, s.joint_b) for s in CANONICAL.segments])  # (S, 2)
_BELONGS = np.zeros((len(_ENDS), len(CANONICAL.joints)), dtype=bool)  # (S, J)
_BELONGS[np.arange(len(_ENDS))[:, None], _ENDS] = True
# the head's centre lies within the head's capsule, at neither end
_BELONGS[[s.name == "head" for s in CANONICAL.segments], CANONICAL.index("head")] = True
# A lone joint is at least as thick as the thinnest segment that ends there.
_JOINT_RADII = np.array(
    [
        min(s.radius for s, has in zip(CANONICAL.segments, _BELONGS[:, j], strict=True) if has)
        for j in range(len(CANONICAL.joints))
    ]
)
_RADII = np.concatenate([[s.radius for s in CANONICAL.segments], _JOINT_RADII])  # (S + J,)
