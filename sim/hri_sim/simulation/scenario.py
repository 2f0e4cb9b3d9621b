"""Scenarios: motions, their places, and the phases of the robots' cycles, all drawn from a seed.

A motion is turned about z and moved over the floor, never lifted, so that one of its joints passes
through a point of the workspace at the joint's own height. The workspace is a cylinder around the
robot's base, as wide and as high as the space that the robot sweeps in its cycle.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import UnusableRecordingError
from hri_predict.base.geometry import Capsules, capsule_distance, transform
from hri_predict.robots.model import RobotModel
from hri_predict.robots.trajectory import Trajectory
from hri_sim.referee import body_capsules
from hri_sim.simulation.approach import over_floor
from hri_sim.simulation.motion import Motion

ENTER_M = 2.0
"""Minimum distance from a robot at full speed at which a person may appear.

It is about the protective separation distance of ISO/TS 15066.
"""
_TRIES = 40
_FREE_M = 0.05  # at the start nobody is nearer to the swept space
_LATE = 0.25  # share of a motion before which nobody passes
_PHASES = 48
STARTS = 32
"""Number of phases at which a robot may start: approaches that share one share its free course."""
_MOVES_M = 0.05  # a capsule that moves less in a cycle sweeps no space


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One approach.

    Attributes:
        index: its number, which with the seed determines everything else.
        motions: names of the motions, one for each person.
        places: (x, y, yaw) of each motion.
        lead_in_s: seconds of empty room before; 0 if a person starts near the robot.
        start: number of the robots' start in their cycle, of ``STARTS`` at even intervals.
        phase_s: each robot's phase in its cycle at the start.
        link_seed: random seed of the losses on the wire.
    """

    index: int
    motions: tuple[str, ...]
    places: tuple[tuple[float, float, float], ...]
    lead_in_s: float
    start: int
    phase_s: float
    link_seed: int


@dataclass(frozen=True, eq=False)
class Workspace:
    """The space in which all robots work.

    Attributes:
        rounds: (x, y, radius, lowest z, highest z) for each robot, metres, room frame.
        capsules: (C,) capsules of all robots over a cycle, which cover the swept space.
        cycle_s: duration of the longest trajectory.
    """

    rounds: Floats
    capsules: Capsules
    cycle_s: float

    @classmethod
    def of(cls, robots: Sequence[tuple[RobotModel, Trajectory]]) -> "Workspace":
        """Return the space that these robots sweep on their trajectories."""
        swept, rounds = [], []
        for model, trajectory in robots:
            times = np.arange(_PHASES) * trajectory.duration_s / _PHASES
            capsules = model.capsules(trajectory.at(times)[0])  # (K, C)
            ends = np.stack([capsules.a, capsules.b], axis=2)  # (K, C, 2, 3)
            moves = np.ptp(ends, axis=0).max(axis=(-2, -1)) > _MOVES_M
            points, radius = ends[:, moves].reshape(-1, 3), capsules.radius.max()
            base = model.base
            if base is None:  # about the middle of where it drives
                places = np.array([model.base_at(q) for q in trajectory.at(times)[0]])
                base = (places.min(0) + places.max(0)) / 2
            reach = np.linalg.norm(points[:, :2] - base[:2], axis=-1).max() + radius
            low, high = points[:, 2].min() - radius, points[:, 2].max() + radius
            rounds.append([*base[:2], reach, low, high])
            swept.append(capsules)
        flat = Capsules(
            np.concatenate([c.a.reshape(-1, 3) for c in swept]),
            np.concatenate([c.b.reshape(-1, 3) for c in swept]),
            np.concatenate([c.radius.reshape(-1) for c in swept]),
        )
        longest_s = max(trajectory.duration_s for _, trajectory in robots)
        return cls(np.array(rounds), flat, longest_s)


def draw(
    *, seed: int, index: int, motions: Sequence[Motion], workspace: Workspace, lead_in_s: float
) -> Scenario:
    """Draw scenario number ``index`` of ``seed`` with these motions.

    Raises:
        UnusableRecordingError: no place lets a motion pass through a workspace.
    """
    rng = np.random.default_rng([seed, index])
    start = int(rng.integers(STARTS))
    link_seed = int(rng.integers(2**31))
    placed = [_place(rng, motion, workspace) for motion in motions]
    far = all(start_m >= ENTER_M for _, start_m in placed)
    return Scenario(
        index=index,
        motions=tuple(motion.name for motion in motions),
        places=tuple(place for place, _ in placed),
        lead_in_s=lead_in_s if far else 0.0,
        start=start,
        phase_s=start * workspace.cycle_s / STARTS,
        link_seed=link_seed,
    )


def _place(
    rng: np.random.Generator, motion: Motion, workspace: Workspace
) -> tuple[tuple[float, float, float], float]:
    """Draw a place; return it and the distance between the motion's start and the swept space.

    The result is the first of several tries that starts beyond ``ENTER_M``, otherwise the farthest.
    """
    best: tuple[tuple[float, float, float], float] | None = None
    for _ in range(_TRIES):
        place = _through(rng, motion, workspace)
        if place is None:
            continue
        start_m = _start_m(motion, place, workspace)
        if best is None or start_m > best[1]:
            best = place, start_m
        if start_m >= ENTER_M:
            break
    if best is None or best[1] < _FREE_M:
        raise UnusableRecordingError(
            f"recording {motion.name}: cannot be placed so that it passes through the robot's "
            f"workspace and starts outside it; leave it out"
        )
    return best


def _through(
    rng: np.random.Generator, motion: Motion, workspace: Workspace
) -> tuple[float, float, float] | None:
    """Draw a place where a joint passes through a workspace; ``None`` if there is none."""
    frame = int(rng.integers(int(_LATE * len(motion.positions)), len(motion.positions)))
    joints = motion.positions[frame][motion.observed[frame]]
    yaw = float(rng.uniform(-math.pi, math.pi))
    if not len(joints):
        return None
    joint = joints[rng.integers(len(joints))]
    x, y, radius, low, high = workspace.rounds[rng.integers(len(workspace.rounds))]
    if not low <= joint[2] <= high:
        return None
    out, around = radius * math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)  # even by area
    turned = transform(over_floor([0.0, 0.0, yaw]), joint)
    at_x, at_y = x + out * math.cos(around), y + out * math.sin(around)
    return float(at_x - turned[0]), float(at_y - turned[1]), yaw


def _start_m(motion: Motion, place: Sequence[float], workspace: Workspace) -> float:
    """Return the distance in metres between the body at its first capture and the swept space."""
    body, counts = body_capsules(
        transform(over_floor(place), motion.positions[0]), motion.observed[0]
    )
    chosen = Capsules(
        body.a[counts][:, None], body.b[counts][:, None], body.radius[counts][:, None]
    )
    return float(capsule_distance(chosen, workspace.capsules).min())
