"""A robot in the room: capsule positions, speeds and stopping."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.errors import RobotError
from hri_predict.base.geometry import Capsules
from hri_predict.base.machine.compiled import plain
from hri_predict.robots.body.ahead import Tables, straight
from hri_predict.robots.body.shape import Shape
from hri_predict.robots.body.sweep import Pieces
from hri_predict.robots.body.sweeping import capsules_of, ends_of, moving_capsules, swept_capsules
from hri_predict.robots.file import RobotFile, read_robot_file
from hri_predict.robots.kinematics import Chain
from hri_predict.robots.mobile_base import (
    COORDINATES,
    FARTHEST,
    MobileBase,
    PartCourse,
    base_joints,
)
from hri_predict.robots.settings import (
    POSITION_TOLERANCE,
    MobileBaseSettings,
    RobotSettings,
    StandingMotion,
    StateMotion,
    ToolSettings,
    TrajectoryMotion,
)
from hri_predict.robots.stopping import StoppingTable

__all__ = [
    "RobotModel",
    "RobotSettings",
    "StandingMotion",
    "StateMotion",
    "TrajectoryMotion",
    "load_robot",
]


_NO_BASE = np.empty(0)


class RobotModel:
    """A robot's geometry and stopping behaviour, placed in the room. N joints, C capsules.

    With ``tools``, the model is the worst case: every tool's capsules, and the longest times and
    distances. With ``base``, three coordinates of the base come before the joints: x, y (m) and yaw
    (rad) of the base in the room.

    Args:
        file: the robot file.
        room_from_robot: (4, 4) pose of the chain's base in the room; in the moving base's frame, if
            there is one.
        payload_kg: heaviest load carried; ``None`` means the heaviest of the stopping table. With
            0 the file's payload capsules are left out.
        name: name of the robot in the configuration.
        tools: tools that may be mounted, instead of the file's tool and payload.
        base: settings of a moving base.

    Attributes:
        name: as configured.
        dof: N, with the base's coordinates.
        joint_names: N names, the base's first, then in the order of RobotState.
        units: N times "rad" or "m".
        capsule_names: C names: links from the base outwards, tool, payload.
        position_min, position_max: (N,) rad, m.
        velocity_max: (N,) rad/s, m/s.
        base: (3,) the base's origin in the room; ``None`` for a moving base.
        mobile: the moving base; ``None`` for a fixed base.
        reach_m: maximum distance of any capsule point from the base's origin.
        table: stopping table of the arm.
        tools: each tool's own model by its name; empty without tools.
        numbering: (C,) index, in the worst-case model, of each capsule of a tool's own model;
            otherwise ``None``.
        moves: (C,) whether the capsule is after the first joint.
        contact: properties for contact with a person; ``None`` if the file has none.
        effective_kg: m_R = M / 2 + m_L (ISO/TS 15066:2016, A.3.6), with ``contact``; else 0.
    """

    def __init__(
        self,
        file: RobotFile,
        room_from_robot: Floats,
        payload_kg: float | None,
        name: str,
        *,
        tools: Sequence[ToolSettings] = (),
        base: MobileBaseSettings | None = None,
    ) -> None:
        self.name = name
        lead = 0 if base is None else len(COORDINATES)
        self.dof = lead + len(file.joints)
        self.joint_names = (*COORDINATES[:lead], *(j.name for j in file.joints))
        joints = [j.joint() for j in file.joints]
        if base is not None:
            joints = base_joints(room_from_robot) + joints
        self.units = tuple("m" if joint.slides else "rad" for joint in joints)
        self._limit(file, base)
        self.base: Floats | None = room_from_robot[:3, 3].copy() if base is None else None
        self._chain = Chain(np.eye(4) if base is not None else room_from_robot, joints)
        self._lead = lead

        shape = Shape.of(file, lead=lead, tools=tools, with_payload=payload_kg != 0, base=base)
        self.capsule_names = shape.names
        self._link, self._ends, self._radius = shape.link, shape.ends, shape.radius
        self.moves: Bools = self._link > lead
        # (C, 4, 2) for products with (3, 4) poses
        ends = np.pad(self._ends, ((0, 0), (0, 0), (0, 1)), constant_values=1.0).swapaxes(1, 2)
        self._geometry = *self._chain.geometry, self._link, plain(ends), plain(self._radius)
        self._pieces = self._measured()
        root = float(np.linalg.norm(joints[lead].pre[:3, 3]))
        on_base = np.max(np.linalg.norm(self._ends, axis=-1), axis=-1)
        pieces = self._pieces
        along = (pieces.arms + pieces.behind * pieces.extent)[:, lead:].sum(axis=1)
        from_base = np.where(self._link == lead, on_base, root + along)
        self.reach_m = float(np.max(from_base + self._radius))
        loads = [tool.payload_kg for tool in tools] or [payload_kg]
        self.table = StoppingTable.of(file.stopping, loads)
        self.contact, self.effective_kg = file.contact, file.effective_kg(loads)
        self.mobile: MobileBase | None = None
        if base is not None:  # the axis of turning is the last of the base's joints
            spread = float((pieces.beyond[:, lead - 1] + self._radius).max())
            self.mobile = MobileBase(base, spread)
        self.tools: dict[str, RobotModel] = {}
        self._by_number: dict[int, RobotModel] = {}
        self.numbering: Ints | None = None
        for tool in tools if len(tools) > 1 else ():
            own = RobotModel(file, room_from_robot, None, name, tools=[tool], base=base)
            own.numbering = np.array([self.capsule_names.index(n) for n in own.capsule_names])
            self._add(tool, own)
        if len(tools) == 1:
            self._add(tools[0], self)

    def _add(self, tool: ToolSettings, own: "RobotModel") -> None:
        self.tools[tool.name] = own
        if tool.number is not None:
            self._by_number[tool.number] = own

    def _limit(self, file: RobotFile, base: MobileBaseSettings | None) -> None:
        low, high = ([j.position[i] for j in file.joints] for i in (0, 1))
        fastest = [j.velocity for j in file.joints]
        if base is not None:
            low, high = [-v for v in FARTHEST] + low, [*FARTHEST, *high]
            fastest = [base.max_speed_m_s, base.max_speed_m_s, base.max_turn_rad_s, *fastest]
        self.position_min, self.position_max = np.array(low), np.array(high)
        self.velocity_max = np.array(fastest)

    def _measured(self) -> Pieces:
        """Return the distances of the capsules from the joints."""
        arms = [
            np.maximum(*(self._chain.arms(int(link), end) for end in ends))
            for link, ends in zip(self._link, self._ends, strict=True)
        ]
        slides = np.array([unit == "m" for unit in self.units])
        farthest = np.maximum(np.abs(self.position_min), np.abs(self.position_max))
        extent = np.where(slides, farthest + POSITION_TOLERANCE, 0.0)
        extent[: self._lead] = 0.0  # nothing turns before the base's x and y
        return Pieces.of(np.array(arms), slides, self._link, extent)

    @property
    def stretch(self) -> float:
        """Factor on times and distances of the stopping tables: more than 1 for a robot that was
        measured to stop late. It applies to all tools."""
        return self.table.stretch

    @stretch.setter
    def stretch(self, stretch: float) -> None:
        self.table.stretch = stretch
        if self.mobile is not None:
            self.mobile.table.stretch = stretch
        for own in self.tools.values():
            if own is not self:
                own.stretch = stretch

    @property
    def reported(self) -> int:
        """Number of joints in RobotState, without the base's coordinates."""
        return self.dof - self._lead

    @property
    def tool_numbers(self) -> frozenset[int]:
        """The valid tool numbers in RobotState."""
        return frozenset(self._by_number)

    def counting(self, tool: int | None) -> "RobotModel":
        """Return the model with one tool; ``None``: the worst case."""
        return self if tool is None else self._by_number[tool]

    def base_at(self, q: Floats) -> Floats:
        """Return the origin (3,) of the arm's base in the room at ``q`` (N,)."""
        if self.base is not None:
            return self.base
        place: Floats = self._chain.links(q)[self._lead, :, 3]
        return place

    def capsules(self, q: Floats) -> Capsules:
        """Capsules (..., C) in the room at joint positions ``q`` (..., N) rad, m."""
        return capsules_of(self._geometry, ends_of(self._geometry, self._chain.links(q)))

    def tool_position(self, q: Floats, tool: Floats) -> Floats:
        """(3,) room position of the point ``tool`` (3,) of the last link at positions ``q``."""
        last = self._chain.links(q)[-1]
        position: Floats = last[:, :3] @ tool + last[:, 3]
        return position

    def tip_speed(self, q: Floats, qd: Floats) -> Floats:
        """Speed bound (...,) m/s of the fastest point of any capsule.

        It is exact for the axes: speed is convex along an axis, so an end is the fastest point. A
        point off the axis adds at most |omega| x radius; this is added, which gives an upper bound.
        The speed of a moving base is added to the arm's speed relative to its base.
        """
        return self.moving(q, qd)[1]

    def moving(self, q: Floats, qd: Floats) -> tuple[Capsules, Floats]:
        """Return ``capsules`` and ``tip_speed`` together."""
        q, qd = np.asarray(q, np.float64), np.asarray(qd, np.float64)
        by_base = 0.0 if self.mobile is None else self.mobile.speed(qd)
        capsules, speed = moving_capsules(self._geometry, q, self._of_arm(qd))
        return capsules, speed + by_base

    def _of_arm(self, qd: Floats) -> Floats:
        """Return ``qd`` (..., N) without the base's motion."""
        if not self._lead:
            return qd
        arm = np.array(qd, float)
        arm[..., : self._lead] = 0.0
        return arm

    def stopping(self, speed_m_s: float) -> tuple[float, float]:
        """Return time (s) and distance (m) from the onset of braking to rest, with this payload.

        The row for the next heavier payload is used; see ``StoppingTable``. With a moving base, see
        ``MobileBase``.
        """
        if np.isnan(speed_m_s):
            raise ValueError("speed is NaN")
        if self.mobile is None:
            return self.table.at(speed_m_s)
        speed = np.array(speed_m_s)
        return float(self.stopping_times(speed)), float(self.mobile.distances_m(self.table, speed))

    @property
    def stopping_tables(self) -> Tables:
        """Stopping tables, as arrays; see ``ahead``."""
        speeds = times = _NO_BASE
        if self.mobile is not None:
            speeds, times, _ = self.mobile.table.rows
        return *self.table.rows, speeds, times, self.stretch

    def stopping_times(self, speeds: Floats) -> Floats:
        """Return the times of ``stopping`` for any number of speeds."""
        if self.mobile is not None:
            return self.mobile.times_s(self.table, speeds)
        return self.table.times_s(speeds)

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
        """Return capsules (..., K, C) that contain the stopping robot in each interval.

        Every joint keeps its velocity until ``reaction_s``; all decelerate uniformly and come to
        rest together at ``reaction_s + stopping_s``. If the stopping table gives a longer distance
        at this speed, braking starts later by the time that makes up the difference. Entry k
        contains the robot during the whole of [times_s[k-1], times_s[k]]; entry 0 at the instant
        times_s[0].

        The proof is at ``sweep``: all joints share one path parameter, q(u) = q + qd u, whose
        second derivative is 0. A moving base has its own path parameter: base and arm brake at the
        same moment, each according to its own table, and the path is a function of time.

        Args:
            q, qd: (N,) rad and rad/s, m and m/s at time 0.
            times_s: (K,) seconds, non-decreasing; negative times are treated as 0.
            reaction_s: time until braking starts, >= 0.
            stopping_s: (...,) time from then to rest, >= 0.
            scale: (...,) factors on ``qd``, for several speeds in one direction.
            speed_m_s: ``tip_speed(q, qd)``, if already known.
        """
        q, qd = np.asarray(q, float), np.asarray(qd, float)
        factor = np.asarray(scale, float)[..., None]  # (..., 1)
        if self.mobile is not None:
            at_s = np.maximum(np.asarray(times_s, float), 0.0)
            by_arm = factor * float(self.tip_speed(q, self._of_arm(qd)))
            arm = PartCourse.of(self.table, by_arm, at_s, reaction_s)
            path = self.mobile.stopping_path(
                arm, q=q, qd=qd, factor=factor, times_s=at_s, reaction_s=reaction_s
            )
            swept = self.swept_capsules(path.q, path.dq_most, path.ddq_most, path.half)
            return Capsules(swept.a, swept.b, swept.radius + path.veer_m[..., None])
        if speed_m_s is None:
            speed_m_s = float(self.tip_speed(q, qd))
        lead = np.broadcast_shapes(np.shape(scale), np.shape(stopping_s))
        each = [plain(np.broadcast_to(v, lead).reshape(-1)) for v in (scale, stopping_s)]
        at_s = plain(np.asarray(times_s))
        moves = each[0], each[1], speed_m_s
        joints = plain(q), plain(qd)
        places, half = straight(joints, self.stopping_tables, moves, (at_s, reaction_s))
        shape, none = (*lead, *places.shape[1:]), np.zeros(self.dof)
        half = half.reshape(shape[:-1])
        return self.swept_capsules(places.reshape(shape), np.abs(qd), none, half)

    def swept_capsules(
        self, q: Floats, dq_most: Floats, ddq_most: Floats, half: Floats
    ) -> Capsules:
        """Return capsules (..., K, C) that contain the robot along each stretch of a path q(u).

        Entry k contains it from u_{k-1} to u_k; entry 0 at the instant u_0.

        The proof is at ``sweep``. A point of the axis is a fixed convex combination of the two ends
        and moves no farther than the end that moves more; a point of the capsule stays within the
        radius of its axis point. So the capsule around the midpoints, with its radius increased by
        that bound, contains the point.

        Args:
            q: (..., K, N) the path at u_0, u_1, ...
            dq_most, ddq_most: (..., K, N) or (N,) bounds of its absolute derivatives, on each
                stretch.
            half: (..., K) h of each stretch; 0 for entry 0.
        """
        return swept_capsules(self._geometry, self._pieces, q, (dq_most, ddq_most, half))

    def shift_m(self, off: Floats) -> float:
        """Return any point's maximum error, m, if each joint is off by at most ``off`` (N,) rad."""
        return float((self._pieces.beyond @ off).max())

    def travel_s(
        self,
        speeds: Floats,
        times_s: Floats,
        reaction_s: float,
        stopping_s: Floats,
    ) -> Floats:
        """Return the path parameter u (..., K): progress along the path, in seconds at full speed.

        ``speeds`` and ``stopping_s`` are (..., 1).
        """
        return self.table.travel_s(speeds, times_s, reaction_s, stopping_s)


def load_robot(settings: RobotSettings, base_dir: Path | None) -> RobotModel:
    """Read a robot's file, check it, and place it in the room.

    Args:
        settings: the robot's entry in the configuration.
        base_dir: base of relative paths in it.

    Raises:
        RobotError: broken chain, missing capsule, decreasing stopping table, payload above the
            table, ...; starts with the key of the entry.
    """
    try:
        file = read_robot_file(settings.model, base_dir)
    except RobotError as error:
        raise RobotError(f"model: {error}") from error
    loads = {"payload_kg": settings.payload_kg}
    for i, tool in enumerate(settings.tools or ()):
        loads[f"tools.{i}.payload_kg"] = tool.payload_kg
    heaviest = file.stopping.rows[-1].payload_kg
    if settings.contact is not None and file.contact is None:
        raise RobotError(
            f"contact: '{settings.model}' has no contact properties; add 'contact: {{source, "
            "moving_mass_kg, area_cm2}' to the robot file, or remove 'contact: allowed' here"
        )
    for key, load in loads.items():
        if load is not None and load > heaviest:
            raise RobotError(
                f"{key}: {load:g} of '{settings.name}' is above the stopping table of "
                f"'{settings.model}', which ends at {heaviest:g} kg; measure the stopping "
                "behaviour with this load and add a row"
            )
    if settings.base is not None:
        pose = settings.base.base_from_robot
    else:
        assert settings.room_from_robot is not None  # the settings have one or the other
        pose = settings.room_from_robot
    return RobotModel(
        file,
        pose.matrix(),
        settings.payload_kg,
        settings.name,
        tools=settings.tools or (),
        base=settings.base,
    )
