"""A robot in the room: where its capsules are, how fast they move, how it stops."""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hri_predict.arrays import Floats
from hri_predict.errors import RobotError
from hri_predict.geometry import Capsules, cross, norm
from hri_predict.robots.file import CapsuleFile, RobotFile, StoppingFile, read_robot_file
from hri_predict.robots.kinematics import Chain
from hri_predict.robots.modes import ModeSettings
from hri_predict.settings import Pose, Settings

STANDING_M_S = 0.001
"""A robot whose fastest point is slower is at rest: stopping takes no time and no distance."""


class StateMotion(Settings):
    """The robot's motion is what its controller reports in RobotState."""

    kind: Literal["state"] = "state"
    stale_s: float = Field(0.1, gt=0, le=2, description="age at which RobotState is stale")
    delay_s: float = Field(
        0.0, ge=0, le=1, description="age of a RobotState at receipt: its link's delay"
    )
    acceleration_m_s2: float = Field(
        5.0, ge=0, description="of the fastest point, at most; bounds its motion since RobotState"
    )
    plan: str | None = Field(
        None,
        min_length=1,
        description="trajectory that it follows, shipped name or path of a YAML file; while its"
        " state lies on it, the robot is predicted along it",
    )


class TrajectoryMotion(Settings):
    """The robot follows a trajectory file, whatever its controller says."""

    kind: Literal["trajectory"]
    file: str = Field(min_length=1, description="shipped name or path of a YAML file")
    start_s: float = Field(0.0, ge=0, description="time within the cycle at the node's start")


class StandingMotion(Settings):
    """The robot stands still."""

    kind: Literal["standing"]
    positions: Annotated[list[float], Field(min_length=1)]


Motion = Annotated[StateMotion | TrajectoryMotion | StandingMotion, Field(discriminator="kind")]


class RobotSettings(Settings):
    """One entry of ``robots:`` in the configuration."""

    name: str = Field(min_length=1, max_length=64)
    model: str = Field(min_length=1, description="shipped name (ur5e) or path of a YAML file")
    room_from_robot: Pose
    payload_kg: float | None = Field(
        None, ge=0, description="heaviest load; default: the heaviest of the stopping table"
    )
    max_speed_m_s: float = Field(gt=0, le=20, description="fastest point in production")
    motion: Motion = StateMotion()
    modes: ModeSettings = Field(ModeSettings(), description="operating modes that are allowed")

    @model_validator(mode="after")
    def _modes_can_be_asked_for(self) -> Self:
        allowed = self.modes.allowed
        if allowed and not isinstance(self.motion, StateMotion):
            raise ValueError(
                f"modes.{allowed[0]} is asked for by RobotState; set motion: {{kind: state}}, or "
                "leave modes out"
            )
        if self.modes.recovery and isinstance(self.motion, StateMotion) and not self.motion.plan:
            raise ValueError(
                "modes.recovery needs motion.plan: without the robot's path nobody knows which "
                "way it would back out; name its trajectory, or leave recovery out"
            )
        return self


class RobotModel:
    """A robot's geometry and stopping, placed in the room. N joints, C capsules.

    Args:
        file: the robot file.
        room_from_robot: (4, 4) pose of the chain's base in the room.
        payload_kg: heaviest load carried; ``None`` means the heaviest of the stopping table. With
            0 the file's payload capsules are left out.
        name: of this robot in the configuration.

    Attributes:
        name: as configured.
        dof: N.
        joint_names: N names, in the order of RobotState.
        capsule_names: C names: links from the base outwards, tool, payload.
        position_min, position_max: (N,) rad.
        velocity_max: (N,) rad/s.
        base: (3,) the base's origin in the room.
        reach_m: no point of any capsule is ever farther than this from ``base``.
        stretch: times and distances of the stopping table are multiplied by it: more than 1 for a
            robot that was measured to stop late.
    """

    def __init__(
        self, file: RobotFile, room_from_robot: Floats, payload_kg: float | None, name: str
    ) -> None:
        self.name = name
        self.stretch = 1.0
        self.dof = len(file.joints)
        self.joint_names = tuple(j.name for j in file.joints)
        self.position_min = np.array([j.position[0] for j in file.joints])
        self.position_max = np.array([j.position[1] for j in file.joints])
        self.velocity_max = np.array([j.velocity for j in file.joints])
        self.base = room_from_robot[:3, 3].copy()
        joints = [j.joint() for j in file.joints]
        self._chain = Chain(room_from_robot, joints)
        self._speeds, self._times, self._distances = _stopping_row(file.stopping, payload_kg)
        self._distance_curve = np.append(0.0, self._speeds), np.append(0.0, self._distances)

        links = {link: i for i, link in enumerate(file.links())}
        carried = [] if payload_kg == 0 else file.payload
        capsules: list[tuple[int, CapsuleFile]] = sorted(
            ((links[c.link], c) for c in file.capsules), key=lambda pair: pair[0]
        )
        capsules += [(self.dof, c) for c in (*file.tool, *carried)]
        self.capsule_names = tuple(c.name for _, c in capsules)
        self._link = np.array([link for link, _ in capsules])
        self._radius = np.array([c.radius for _, c in capsules])
        self._ends = np.array([[c.a, c.b] for _, c in capsules])  # (C, 2, 3)
        # (C, 4, 2) for products with (3, 4) poses
        self._ends_h = np.pad(self._ends, ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
        self._ends_h = np.ascontiguousarray(self._ends_h.swapaxes(1, 2))
        # (C, N): rigid pieces of the chain from each joint to the capsule's farther end.
        self._arms = np.array(
            [
                np.maximum(*(self._chain.arms(link, np.array(end)) for end in (c.a, c.b)))
                for link, c in capsules
            ]
        )
        # (C, N): how far a capsule's end is from each joint's axis at most
        self._beyond = np.cumsum(self._arms[:, ::-1], axis=1)[:, ::-1]
        root = float(np.linalg.norm(joints[0].pre[:3, 3]))
        on_base = np.max(np.linalg.norm(self._ends, axis=-1), axis=-1)
        from_base = np.where(self._link == 0, on_base, root + self._arms.sum(axis=1))
        self.reach_m = float(np.max(from_base + self._radius))

    def capsules(self, q: Floats) -> Capsules:
        """Capsules (..., C) in the room at joint positions ``q`` (..., N) rad."""
        return self._capsules(self._ends_at(self._chain.links(q)))

    def tool_position(self, q: Floats, tool: Floats) -> Floats:
        """(3,) room position of the point ``tool`` (3,) of the last link at positions ``q``."""
        last = self._chain.links(q)[-1]
        position: Floats = last[:, :3] @ tool + last[:, 3]
        return position

    def tip_speed(self, q: Floats, qd: Floats) -> Floats:
        """Speed bound (...,) m/s of the fastest point of any capsule.

        It is exact for the axes: speed is convex along an axis, so an end is the fastest point. A
        point off the axis adds at most |omega| x radius; this is added, which gives an upper bound.
        """
        return self.moving(q, qd)[1]

    def moving(self, q: Floats, qd: Floats) -> tuple[Capsules, Floats]:
        """``capsules`` and ``tip_speed`` at once."""
        links = self._chain.links(q)
        ends = self._ends_at(links)
        omega, v0 = self._chain.twists(links, qd)
        turn, shift = (np.moveaxis(v.take(self._link, axis=0), 0, -2) for v in (omega, v0))
        fastest = norm(shift + cross(turn, ends)).max(axis=0)
        speed: Floats = (fastest + norm(turn) * self._radius).max(axis=-1)
        return self._capsules(ends), speed

    def stopping(self, speed_m_s: float) -> tuple[float, float]:
        """Time (s) and distance (m) from the onset of braking to rest, with this payload.

        Linear between the table's speeds. Below its first: the first's time, distance in
        proportion. Above its last: constant deceleration, time in proportion to the speed and
        distance to its square. The row is that of the next heavier payload.
        """
        if np.isnan(speed_m_s):
            raise ValueError("speed is NaN")
        speed = np.array(speed_m_s)
        return float(self.stopping_times(speed)), float(self._stopping_m(speed))

    def stopping_times(self, speeds: Floats) -> Floats:
        """The times of ``stopping``, for any number of speeds at once."""
        beyond = np.maximum(speeds / self._speeds[-1], 1.0)
        times: Floats = np.interp(speeds, self._speeds, self._times) * (beyond * self.stretch)
        return np.where(speeds >= STANDING_M_S, times, 0.0)

    def _stopping_m(self, speeds: Floats) -> Floats:
        """The distances of ``stopping``, for any number of speeds at once."""
        knots, distances = self._distance_curve
        beyond = np.maximum(speeds / knots[-1], 1.0) ** 2
        distance: Floats = np.interp(speeds, knots, distances) * (beyond * self.stretch)
        return np.where(speeds >= STANDING_M_S, distance, 0.0)

    def stopping_capsules(
        self,
        q: Floats,
        qd: Floats,
        *,
        times_s: Floats,
        reaction_s: float,
        stopping_s: Floats | float,
        scale: Floats | float = 1.0,
        speed_m_s: float | None = None,
    ) -> Capsules:
        """Capsules (..., K, C) that contain the stopping robot, interval by interval.

        Every joint keeps its velocity until ``reaction_s`` and all come to rest together at
        ``reaction_s + stopping_s``, decelerating uniformly; if the stopping table's distance at
        this speed is longer than that, the braking sets in later by as much as makes up for it.
        Entry k contains the robot during the whole of [times_s[k-1], times_s[k]]; entry 0 at the
        instant times_s[0].

        The proof is at ``swept_capsules``: all joints share one path parameter, q(u) = q + qd u,
        whose second derivative is 0.

        Args:
            q, qd: (N,) rad and rad/s at time 0.
            times_s: (K,) seconds, not falling; before 0 counts as 0.
            reaction_s: until braking begins, >= 0.
            stopping_s: (...,) from there to rest, >= 0.
            scale: (...,) factors of ``qd``: several speeds in one direction at once.
            speed_m_s: ``tip_speed(q, qd)``, if already known.
        """
        q, qd = np.asarray(q, float), np.asarray(qd, float)
        factor = np.asarray(scale, float)[..., None]  # (..., 1)
        stopping = np.asarray(stopping_s, float)[..., None]
        if speed_m_s is None:
            speed_m_s = float(self.tip_speed(q, qd))
        travel = self.travel_s(factor * speed_m_s, np.asarray(times_s, float), reaction_s, stopping)
        u = factor * travel  # seconds at qd itself, from here on
        half = np.diff(u, axis=-1, prepend=u[..., :1]) / 2
        return self.swept_capsules(q + u[..., None] * qd, np.abs(qd), np.zeros(self.dof), half)

    def swept_capsules(
        self, q: Floats, dq_most: Floats, ddq_most: Floats, half: Floats
    ) -> Capsules:
        """Capsules (..., K, C) that contain the robot along each stretch of a path q(u).

        Entry k contains it from u_{k-1} to u_k; entry 0 at the instant u_0.

        Proof: let x be an end of a capsule's axis and h half the stretch. From the chord between
        the stretch's ends x departs by at most max|x''| h^2 / 2, and the chord from its own middle
        by half its length; so |x(u) - (x_{k-1} + x_k) / 2| <= |x_k - x_{k-1}| / 2 + max|x''| h^2/2.
        The end is a sum of rigid pieces, piece i fixed to link i with |omega_i| <= W_i = sum over
        j <= i of max|q_j'|; so its second derivative is at most the sum of length_i (W_i^2 +
        |omega_i'|), and omega_i' = sum over j <= i of q_j'' axis_j + q_j' omega_{j-1} x axis_j is
        at most sum of |q_j''| + sum of |q_j'| W_{j-1} = sum of |q_j''| + (W_i^2 - sum q_j'^2) / 2.
        Likewise x is at most h x sum of |q_j'| x (pieces beyond j) from that middle; the smaller
        bound serves. A point of the axis is a fixed convex combination of the two ends and moves by
        no more than the farther; a point of the capsule stays within the radius of its point of the
        axis. So the capsule about the middles, its radius grown by that bound, contains it.

        Args:
            q: (..., K, N) the path at u_0, u_1, ...
            dq_most, ddq_most: (..., K, N) or (N,) bounds of its derivatives' amounts, on each
                stretch.
            half: (..., K) h of each stretch; 0 for entry 0.
        """
        ends = self._ends_at(self._chain.links(q))
        before = np.concatenate([ends[..., :1, :, :], ends[..., :-1, :, :]], axis=-3)
        a, b = 0.5 * (ends + before)
        reach_a, reach_b = 0.5 * norm(ends - before)
        # the sum of length_i times the sum over j <= i of q_j' is that of q_j' times (beyond j)
        turning = np.cumsum(dq_most, axis=-1)
        bend = (1.5 * turning**2) @ self._arms.T + (ddq_most - dq_most**2 / 2) @ self._beyond.T
        h = half[..., None]
        grow = np.maximum(reach_a, reach_b) + bend * (h * h / 2)
        return Capsules(a, b, self._radius + np.minimum(grow, (dq_most @ self._beyond.T) * h))

    def shift_m(self, off: Floats) -> float:
        """How far any point may be off if each joint is off by at most ``off`` (N,) rad."""
        return float((self._beyond @ off).max())

    def travel_s(
        self,
        speeds: Floats,
        times_s: Floats,
        reaction_s: float,
        stopping_s: Floats,
    ) -> Floats:
        """Path parameter u (..., K) in seconds of full speed: how far along its path it is.

        ``speeds`` and ``stopping_s`` are (..., 1).
        """
        distance = self._stopping_m(speeds)
        # Holding for h and then braking uniformly over T - h covers speed x (T + h) / 2.
        moving = np.where(speeds > 0, speeds, 1.0)
        hold = np.where(speeds > 0, 2 * distance / moving - stopping_s, 0.0)
        hold = np.minimum(np.maximum(hold, 0.0), stopping_s)
        onset, braking = reaction_s + hold, stopping_s - hold
        after = np.minimum(np.maximum(times_s - onset, 0.0), braking)
        lost = after**2 / np.where(braking > 0, 2 * braking, np.inf)
        travel: Floats = np.minimum(np.maximum(times_s, 0.0), onset) + after - lost
        return travel

    def _ends_at(self, links: Floats) -> Floats:
        """(2, ..., C, 3) both ends of every capsule on links (N+1, ..., 3, 4)."""
        lead, count = links.shape[1:-2], len(self._link)
        at = links.take(self._link, axis=0).reshape(count, -1, 4)
        # one product of matrices for each capsule's ends
        ends = np.matmul(at, self._ends_h).reshape(count, -1, 3, 2)
        return np.ascontiguousarray(ends.transpose(3, 1, 0, 2)).reshape(2, *lead, count, 3)

    def _capsules(self, ends: Floats) -> Capsules:
        return Capsules(ends[0], ends[1], np.broadcast_to(self._radius, ends.shape[1:-1]))


def load_robot(settings: RobotSettings, base_dir: Path | None) -> RobotModel:
    """Read a robot's file, check it, and place it in the room.

    Args:
        settings: the robot's entry in the configuration.
        base_dir: base of relative paths in it.

    Raises:
        RobotError: broken chain, missing capsule, stopping table that falls, payload above it, ...;
            begins with the key of the entry.
    """
    try:
        file = read_robot_file(settings.model, base_dir)
    except RobotError as error:
        raise RobotError(f"model: {error}") from error
    heaviest = file.stopping.rows[-1].payload_kg
    if settings.payload_kg is not None and settings.payload_kg > heaviest:
        raise RobotError(
            f"payload_kg: {settings.payload_kg:g} of '{settings.name}' is above the stopping "
            f"table of '{settings.model}', which ends at {heaviest:g} kg; "
            f"measure the stopping time with this load and add a row"
        )
    matrix = settings.room_from_robot.matrix()
    return RobotModel(file, matrix, settings.payload_kg, settings.name)


def _stopping_row(stopping: StoppingFile, payload_kg: float | None) -> tuple[Floats, ...]:
    """Speeds, times and distances of the lightest row that covers the payload."""
    rows = stopping.rows
    row = next((r for r in rows if payload_kg is not None and r.payload_kg >= payload_kg), rows[-1])
    return np.array(stopping.speed_m_s), np.array(row.time_s), np.array(row.distance_m)
