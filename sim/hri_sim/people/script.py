"""Scripts of procedural people: a sequence of acts, as written in YAML."""

import itertools
import math
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import MAX_ANGLE_RAD, Point, Settings, Vector3
from hri_sim.people.acts import Absent, Act, Reach, Stand, Turn, Walk
from hri_sim.people.body import Body, Stance
from hri_sim.people.walking import wrapped

_SAME_HEADING = math.radians(1)  # a smaller change needs no turn
_REACH_AHEAD = math.radians(35)  # the person first turns to a target farther aside than this
_NEAR_M = 0.05  # two places nearer than this count as one


class WalkTo(Settings):
    """Turn towards a point, then walk there through waypoints."""

    do: Literal["walk"] = Field(description="walk to a point")
    to: Point = Field(description="[x, y], m")
    via: list[Point] = Field([], description="points on the way, m")
    speed_m_s: float = Field(
        1.2,
        ge=0.1,
        le=8.0,
        description="maximum speed; from about 2 m/s people run; sharp bends are slower",
    )
    backwards: bool = Field(False, description="walk backwards")


class Wait(Settings):
    """Stand still."""

    do: Literal["wait"] = Field(description="stand still")
    seconds: float = Field(gt=0, le=3600, description="duration")


class TurnTo(Settings):
    """Turn on the spot, to a yaw (radians) or towards a point."""

    do: Literal["turn"] = Field(description="turn on the spot")
    yaw: float | None = Field(
        None,
        ge=-MAX_ANGLE_RAD,
        le=MAX_ANGLE_RAD,
        description="new direction, from +x counter-clockwise",
    )
    toward: Point | None = Field(None, description="instead of yaw: a point to look at, m")


class ReachTo(Settings):
    """Turn to a point if needed, reach for it with the fingertips of one hand, stay, and return."""

    do: Literal["reach"] = Field(description="reach out with one hand")
    to: Vector3 = Field(description="[x, y, z] of the fingertips, m")
    hand: Literal["left", "right"] = Field("right", description="hand that reaches out")
    hold_s: float = Field(1.0, ge=0, le=3600, description="time that the hand stays there")
    duration_s: float | None = Field(
        None, gt=0, le=60, description="duration of the outward movement; default: an easy pace"
    )


class Leave(Settings):
    """Leave the room; return at ``start``."""

    do: Literal["leave"] = Field(description="leave the room")
    seconds: float = Field(3.0, gt=0, le=3600, description="duration")


Step = Annotated[WalkTo | Wait | TurnTo | ReachTo | Leave, Field(discriminator="do")]


class PersonSettings(Settings):
    """One procedural person."""

    id: int | None = Field(None, ge=0, le=65535, description="default: 1, 2, ... as listed")
    height_m: float = Field(1.75, ge=1.4, le=2.1, description="body height")
    start: Point = Field(description="[x, y] of the starting point, m")
    yaw: float | None = Field(
        None,
        ge=-MAX_ANGLE_RAD,
        le=MAX_ANGLE_RAD,
        description="initial heading, radians; default: the direction of the first walk",
    )
    enter_s: float = Field(
        0.0, ge=0, le=3600, description="time at which the person enters the room"
    )
    repeat: bool = Field(True, description="start again after the last step")
    script: list[Step] = Field(
        min_length=1, max_length=200, description="the person's actions, step by step"
    )


class Timeline:
    """A person's acts in time.

    Without a ``leave`` at the end, a script that repeats ends by walking back to its start.

    Raises:
        ConfigError: a step cannot be done, such as a target out of reach.
    """

    def __init__(self, settings: PersonSettings, where: str, left_first: bool) -> None:
        self.body = Body(settings.height_m)
        self._enter_s, self._repeat, self._left_first = (
            settings.enter_s,
            settings.repeat,
            left_first,
        )
        self._start = np.array(settings.start, dtype=np.float64)
        self._xy, self._heading = self._start, self._first_heading(settings)
        start_heading = self._heading
        self._acts: list[Act] = []
        for i, step in enumerate(settings.script):
            try:
                self._do(step)
            except ValueError as error:
                raise ConfigError(f"{where}.script.{i} ({step.do}): {error}") from error
        if settings.repeat and not isinstance(self._acts[-1], Absent):
            self._walk_back(start_heading)
        self._ends = np.cumsum([act.duration_s for act in self._acts])
        self.cycle_s = float(self._ends[-1])

    def stance(self, t: float) -> Stance | None:
        """Return the stance ``t`` seconds after the start; ``None`` if not in the room."""
        t -= self._enter_s
        if t < 0:
            return None
        if self._repeat:
            t %= self.cycle_s
        k = min(int(np.searchsorted(self._ends, t, side="right")), len(self._acts) - 1)
        begin = float(self._ends[k]) - self._acts[k].duration_s
        return self._acts[k].stance(min(t - begin, self._acts[k].duration_s))

    def joints(self, t: float, sway: Floats) -> Floats | None:
        """Return (21, 3) canonical joints, or ``None``; ``sway`` (2,) metres moves the pelvis."""
        stance = self.stance(t)
        if stance is None:
            return None
        return self.body.joints(replace(stance, xy=stance.xy + sway))

    def _first_heading(self, settings: PersonSettings) -> float:
        if settings.yaw is not None:
            return settings.yaw
        first = next((s for s in settings.script if isinstance(s, WalkTo)), None)
        if first is None:
            return 0.0
        dx, dy = np.array((first.via or [first.to])[0]) - self._start
        return math.atan2(dy, dx) + (math.pi if first.backwards else 0.0)

    def _do(self, step: WalkTo | Wait | TurnTo | ReachTo | Leave) -> None:
        if isinstance(step, WalkTo):
            self._walk([*step.via, step.to], step.speed_m_s, step.backwards)
        elif isinstance(step, Wait):
            self._add(Stand(self.body, self._xy, self._heading, step.seconds))
        elif isinstance(step, TurnTo):
            if (step.yaw is None) == (step.toward is None):
                raise ValueError("give either 'yaw' or 'toward'")
            self._turn(step.yaw if step.yaw is not None else self._toward(step.toward or []))
        elif isinstance(step, ReachTo):
            toward = self._toward(step.to[:2])
            if abs(wrapped(toward - self._heading)) > _REACH_AHEAD:
                self._turn(toward)
            target = np.array(step.to)
            here, heading = self._xy, self._heading
            reach = Reach(
                body=self.body,
                xy=here,
                heading=heading,
                target=target,
                hand=step.hand,
                hold_s=step.hold_s,
                duration_s=step.duration_s,
            )
            self._add(reach)
        else:
            self._add(Absent(self._xy, self._heading, step.seconds))
            self._xy = self._start

    def _walk(self, points: list[list[float]], speed_m_s: float, backwards: bool) -> None:
        waypoints = [self._xy, *(np.array(p, dtype=np.float64) for p in points)]
        for before, after in itertools.pairwise(waypoints):
            if np.linalg.norm(after - before) < _NEAR_M:
                raise ValueError(
                    f"waypoint [{after[0]:g}, {after[1]:g}] repeats the one before it; remove it"
                )
        walk = Walk(
            body=self.body,
            waypoints=waypoints,
            speed_m_s=speed_m_s,
            backwards=backwards,
            left_first=self._left_first,
        )
        self._turn(walk.first_heading)
        self._add(walk)

    def _walk_back(self, heading: float) -> None:
        if np.linalg.norm(self._start - self._xy) >= _NEAR_M:
            self._walk([self._start.tolist()], 1.2, backwards=False)
        elif np.linalg.norm(self._start - self._xy) > 0:
            raise ConfigError(
                "a script that repeats must end at its start, or clearly away from it"
            )
        self._turn(heading)

    def _turn(self, heading: float) -> None:
        if abs(wrapped(heading - self._heading)) > _SAME_HEADING:
            self._add(
                Turn(
                    body=self.body,
                    xy=self._xy,
                    heading=self._heading,
                    to_heading=heading,
                    left_first=self._left_first,
                )
            )

    def _toward(self, point: list[float]) -> float:
        dx, dy = np.array(point) - self._xy
        if math.hypot(dx, dy) < _NEAR_M:
            raise ValueError("the point is where the person stands; give another")
        return math.atan2(dy, dx)

    def _add(self, act: Act) -> None:
        self._acts.append(act)
        self._xy, self._heading = act.xy, act.heading
