"""One complete mock controller: its logic, its arm, and the wires to the robot's other controller.

The same object runs in a separate process in real time, and on the virtual clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from hri_drivers.links.can.link import CanCodec, CanLinkSettings
from hri_drivers.links.codec import Codec
from hri_drivers.links.framed import SerialCodec
from hri_drivers.links.serial.link import SerialLinkSettings
from hri_drivers.wires.transport import Transport
from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.settings import validated
from hri_predict.contracts.link import LinkSettings
from hri_predict.protocol.messages import OperatingMode, RobotMode
from hri_predict.robots.model import RobotModel, RobotSettings, TrajectoryMotion, load_robot
from hri_predict.robots.stopping import StoppingTable
from hri_predict.robots.trajectory import Trajectory, load_trajectory
from hri_sim.controllers.arm import SimulatedArm, nominal_speeds
from hri_sim.controllers.controller import (
    ControllerCore,
    ControllerSettings,
    Permit,
)
from hri_sim.controllers.lies import Lies, Requests, Said
from hri_sim.controllers.tools import Mounted, ToolChanger
from hri_sim.controllers.wiring import Wiring
from hri_sim.faults.link_faults import LINK_FAULTS, FaultyTransport
from hri_sim.faults.link_faults import U as W
from hri_sim.faults.settings import faults_from

# -- motion of a simulated drive, and its braking: never later than its stopping table says --------
#
# The node relies on the robot's stopping table, so the simulated arm must not stop later.

_SPEED_STEPS = 50
_PHASES = 400


@dataclass(frozen=True, eq=False)
class Drive:
    """The robot that a drive moves, and its trajectory."""

    model: RobotModel
    trajectory: Trajectory

    @cached_property
    def peak_m_s(self) -> float:
        """Peak speed of the fastest point at full speed, m/s."""
        return self.trajectory.peak_tip_speed(self.model)

    @cached_property
    def speeds(self) -> Floats:
        """See ``arm.nominal_speeds``."""
        return nominal_speeds(self.model, self.trajectory)


class Brakes:
    """Deceleration of a drive's fastest point, with each tool.

    Args:
        drive: the robot and its trajectory.
        deceleration_m_s2: as configured; ``None``: from the stopping tables.
        up_to_m_s: maximum speed.
    """

    def __init__(self, drive: Drive, deceleration_m_s2: float | None, up_to_m_s: float) -> None:
        self._drive, self._set, self._up_to_m_s = drive, deceleration_m_s2, up_to_m_s
        self._known: dict[int | None, float] = {}

    def with_tool(self, tool: int | None) -> float:
        """Return m/s^2 with the tool of this number; ``None``: with the worst tool."""
        if self._set is not None:
            return self._set
        if tool not in self._known:
            model = self._drive.model.counting(tool)
            if model.mobile is None:
                self._known[tool] = deceleration_of(model, self._up_to_m_s)
            else:
                self._known[tool] = deceleration_with_base(model, self._drive.trajectory)
        return self._known[tool]


def deceleration_of(model: RobotModel, up_to_m_s: float) -> float:
    """Return a uniform deceleration (m/s^2) within the stopping time and distance at any speed."""
    speeds = up_to_m_s * np.arange(1, _SPEED_STEPS + 1) / _SPEED_STEPS
    return _least(speeds, speeds, model.table) or 1.0


def deceleration_with_base(model: RobotModel, trajectory: Trajectory) -> float:
    """Return such a deceleration for an arm and its base, which brake together on one path.

    Both then stay within their own tables everywhere on the path, at any speed.
    """
    assert model.mobile is not None
    q, qd = trajectory.at(np.linspace(0.0, trajectory.duration_s, _PHASES))
    together, of_base = model.tip_speed(q, qd), model.mobile.speed(qd)
    shares = np.arange(1, _SPEED_STEPS + 1)[:, None] / _SPEED_STEPS
    parts = ((together - of_base, model.table), (of_base, model.mobile.table))
    return max(_least(shares * together, shares * part, table) for part, table in parts) or 1.0


def _least(together: Floats, part: Floats, table: StoppingTable) -> float:
    """Return the deceleration of ``together`` that stops the part within its table; 0: none."""
    times, distances = table.times_s(part), table.distances_m(part)
    counts = (times > 0) & (distances > 0)
    if not counts.any():
        return 0.0
    together, part = together[counts], part[counts]
    # it stands after together / d, on a way of part / 2 times that
    by_time = together / times[counts]
    by_way = together * part / (2 * distances[counts])
    return float(np.maximum(by_time, by_way).max())


# --------------------------------------------------------------------------------------------------

U = TypeVar("U")


@dataclass(frozen=True, kw_only=True)
class Post:
    """A controller's position in the cell: link, robot and settings.

    Attributes:
        link: the link; the controller is at its other end.
        settings: the link's ``simulate:`` block, resolved.
        robot, robot_index: the controller's robot, and the robot's index in the configuration.
        base_dir: base of relative paths.
        full_speed_m_s: a limit below this slows the robot down.
        drive: the robot and trajectory of a drive, if already read.
    """

    link: LinkSettings
    settings: ControllerSettings
    robot: RobotSettings
    robot_index: int
    base_dir: Path | None
    full_speed_m_s: float
    drive: Drive | None = None

    @property
    def name(self) -> str:
        """The link's name."""
        return self.link.name


def posts(
    links: Sequence[LinkSettings], robots: Sequence[RobotSettings], base_dir: Path | None
) -> list[Post]:
    """Return a post for the other end of every link with a ``simulate:`` block.

    Raises:
        ConfigError: a wrong key, an unknown robot, or a robot without exactly one drive.
        RobotError: a robot or trajectory file is wrong.
    """
    found: list[tuple[LinkSettings, ControllerSettings, int]] = []
    names = [robot.name for robot in robots]
    for link in links:
        if link.simulate is None:
            continue
        where = f"links.{link.name}.simulate"
        settings = validated(ControllerSettings, link.simulate, where).resolved(link)
        faults_from(settings.faults, LINK_FAULTS, f"{where}.faults")
        name = settings.robot or (names[0] if len(names) == 1 else None)
        if name is None:
            raise ConfigError(f"{where}.robot: missing; use one of: {', '.join(names)}")
        if name not in names:
            raise ConfigError(
                f"{where}.robot: no robot '{name}'{nearest(name, names)}; "
                f"available: {', '.join(names)}"
            )
        if link.robots is not None and name not in link.robots:
            raise ConfigError(
                f"{where}.robot: the link carries no advice for '{name}'; see its 'robots'"
            )
        _check_tools(settings, robots[names.index(name)], where)
        found.append((link, settings.model_copy(update={"robot": name}), names.index(name)))
    drives = {index: _only_drive(index, found, robots, base_dir) for _, _, index in found}
    speeds = {i: min(robots[i].max_speed_m_s, drive.peak_m_s) for i, drive in drives.items()}
    return [
        Post(
            link=link,
            settings=settings,
            robot=robots[index],
            robot_index=index,
            base_dir=base_dir,
            full_speed_m_s=speeds[index],
            drive=drives[index],
        )
        for link, settings, index in found
    ]


def codec_for(link: LinkSettings) -> Codec[Any]:
    """Return a codec for the far end of ``link``.

    Raises:
        ConfigError: there is no mock controller for this kind of link.
    """
    if isinstance(link, SerialLinkSettings):
        return SerialCodec(link.baudrate, with_items=False)  # it obeys Advice alone
    if isinstance(link, CanLinkSettings):
        return CanCodec(link)
    raise ConfigError(f"links.{link.name}.simulate: no mock controller for kind '{link.kind}'")


class Station(Generic[U]):
    """A running controller. ``cycle`` is its program: read, decide, move, answer.

    Attributes:
        core: its logic, which also makes its report.
    """

    def __init__(self, post: Post, codec: Codec[U], wiring: Wiring) -> None:
        """Set up the controller of ``post``.

        Raises:
            RobotError: a robot or trajectory file is wrong.
        """
        self.post = post
        self.period_ns = int(post.settings.period_s * 1e9)
        self.core = ControllerCore(
            name=post.name,
            settings=post.settings,
            robot=post.robot_index,
            codec=codec,
            full_speed_m_s=post.full_speed_m_s,
            base_moves=post.robot.base is not None,
        )
        self._core = self.core  # what scripts of scenarios know it as
        self._changer = ToolChanger(post.settings.tools)
        self._brakes: Brakes | None = None
        self._wiring = wiring
        self._lies = Lies(post.settings.lies)
        self._requests = Requests(post.settings.requests)
        self._arm: SimulatedArm | None = None
        if post.settings.role == "drive":
            drive = post.drive or _drive(post.link, post.settings, post.robot, post.base_dir)
            self._brakes = Brakes(drive, post.settings.deceleration, post.full_speed_m_s)
            before = wiring.truth()  # a restarted drive finds the arm where it stopped
            self._arm = SimulatedArm(
                model=drive.model,
                trajectory=drive.trajectory,
                deceleration_m_s2=self._brakes.with_tool(None) / self._lies.brakes_slower,
                acceleration_m_s2=post.settings.acceleration,
                path_s=before.path_s if before is not None else post.settings.start_s,
                speeds=drive.speeds,
            )

    def cycle(self, units: Sequence[U], now_ns: int) -> list[U]:
        """Process units received by ``now_ns``, decide, move the arm; return the units to send."""
        self.core.receive(units, now_ns)
        permit = self.core.permit(now_ns)
        self._wiring.set_permit(self.post.name, permit.speed_m_s, now_ns, cause=permit.cause)
        if self._arm is None:
            self.core.obey(permit, now_ns)
            truth = self._wiring.truth()
            if truth is None:
                return self.core.outgoing(now_ns, None, None)
            told = self._lies.told(*truth.at(now_ns), now_ns)
            if not truth.alive(now_ns):
                unknown = Said(RobotMode.UNKNOWN)
                return self.core.outgoing(now_ns, *told, unknown, mounted=truth.mounted)
            return self._answer(now_ns, *told, truth.mounted)
        allowed, cause = self._wiring.lowest_permit(now_ns)
        if allowed < permit.speed_m_s:
            permit = Permit(allowed, cause, permit.mode)
        self.core.obey(permit, now_ns)
        fastest = self.post.robot.max_speed_m_s
        speed = self._lies.permitted(permit.speed_m_s, fastest, now_ns)
        mounted = self._changer.at(now_ns)
        if self._brakes is not None:
            braking = self._brakes.with_tool(mounted.number) / self._lies.brakes_slower
            self._arm.deceleration_m_s2 = braking
        back = permit.mode is OperatingMode.RECOVERY
        self._arm.step(now_ns, min(speed, fastest), backwards=back)
        q, qd = self._arm.joints()
        self._wiring.set_truth(q, qd, path_s=self._arm.path_s, now_ns=now_ns, mounted=mounted)
        return self._answer(now_ns, *self._lies.told(q, qd, now_ns), mounted)

    def _answer(self, now_ns: int, q: Floats, qd: Floats, mounted: Mounted) -> list[U]:
        """Return the content to send once the robot is known: its state, its tool, and requests."""
        return self.core.outgoing(now_ns, q, qd, self._requests.said(now_ns), mounted=mounted)

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands; always true for a monitor, which has no arm."""
        return self._arm is None or self._arm.at_rest


def _check_tools(settings: ControllerSettings, robot: RobotSettings, where: str) -> None:
    """Refuse a tool that the robot cannot carry."""
    numbers = [tool.number for tool in robot.tools or () if tool.number is not None]
    for i, change in enumerate(settings.tools):
        if change.tool not in numbers:
            known = ", ".join(map(str, sorted(numbers))) or "none"
            raise ConfigError(
                f"{where}.tools.{i}.tool: robot '{robot.name}' has no tool number {change.tool}; "
                f"available: {known}"
            )


def _trajectory_of(
    link: LinkSettings, settings: ControllerSettings, robot: RobotSettings
) -> tuple[str, str]:
    """Return the trajectory of a drive, and the key that names it."""
    key = f"links.{link.name}.simulate.trajectory"
    if settings.trajectory is not None:
        return settings.trajectory, key
    if isinstance(robot.motion, TrajectoryMotion):
        return robot.motion.file, f"robots: motion.file of robot {robot.name}"
    raise ConfigError(
        f"{key}: missing; name the path that robot '{robot.name}' follows, such as pick_and_place"
    )


def _only_drive(
    index: int,
    found: Sequence[tuple[LinkSettings, ControllerSettings, int]],
    robots: Sequence[RobotSettings],
    base_dir: Path | None,
) -> Drive:
    """Return the drive of the robot, which must have exactly one."""
    robot = robots[index]
    drives = [(link, s) for link, s, i in found if i == index and s.role == "drive"]
    if len(drives) != 1:
        raise ConfigError(
            f"links: robot '{robot.name}' has {len(drives)} simulated drives; give it exactly one "
            "link with 'simulate: {role: drive}', the others role: monitor"
        )
    return _drive(*drives[0], robot, base_dir)


def _drive(
    link: LinkSettings, settings: ControllerSettings, robot: RobotSettings, base_dir: Path | None
) -> Drive:
    model = load_robot(robot, base_dir)
    trajectory, key = _trajectory_of(link, settings, robot)
    return Drive(model, load_trajectory(trajectory, model, base_dir, key))


def at_far_end(
    wire: Transport[W], settings: ControllerSettings, link: str, clock: Clock
) -> Transport[W]:
    """Return the controller's end of the wire, with the faults in its settings.

    Raises:
        ConfigError: a fault of unknown kind or with a wrong key.
    """
    if not settings.faults:
        return wire
    where = f"links.{link}.simulate"
    return FaultyTransport(
        inner=wire, faults=settings.faults, clock=clock, seed=settings.fault_seed, where=where
    )
