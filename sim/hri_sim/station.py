"""One mock controller, whole: what it hears, the arm it moves, the wires to its fellow.

The same object runs in a process of its own in real time, and inside the virtual clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

from hri_drivers.can_link import CanCodec, CanLinkSettings
from hri_drivers.link_codec import Codec
from hri_drivers.serial_link import SerialCodec, SerialLinkSettings
from hri_predict.errors import ConfigError, nearest
from hri_predict.link import LinkSettings
from hri_predict.protocol.messages import RobotMode
from hri_predict.risk.robot import RobotModel, RobotSettings, TrajectoryMotion, load_robot
from hri_predict.risk.trajectory import Trajectory, load_trajectory
from hri_predict.scene import Floats
from hri_predict.settings import validated
from hri_sim.arm import SimulatedArm, nominal_speeds
from hri_sim.controller import ControllerCore, ControllerReport, ControllerSettings, Permit
from hri_sim.wiring import Wiring

U = TypeVar("U")

_SPEED_STEPS = 50


@dataclass(frozen=True, eq=False)
class Drive:
    """What a drive moves: a robot along a trajectory."""

    model: RobotModel
    trajectory: Trajectory

    @cached_property
    def peak_m_s(self) -> float:
        """Speed of the fastest point, left alone."""
        return self.trajectory.peak_tip_speed(self.model)

    @cached_property
    def speeds(self) -> Floats:
        """See ``arm.nominal_speeds``."""
        return nominal_speeds(self.model, self.trajectory)


@dataclass(frozen=True)
class Post:
    """Where a controller stands: its link, its robot, and its own settings.

    Attributes:
        link: the link at whose other end it is.
        settings: the link's ``simulate:`` block, resolved.
        robot, robot_index: the robot it is for, and its place in the configuration.
        base_dir: what relative paths are relative to.
        full_speed_m_s: below this a limit slows the robot down.
        drive: what a drive moves, where it has been read already.
    """

    link: LinkSettings
    settings: ControllerSettings
    robot: RobotSettings
    robot_index: int
    base_dir: Path | None
    full_speed_m_s: float
    drive: "Drive | None" = None

    @property
    def name(self) -> str:
        """The link's."""
        return self.link.name


def posts(
    links: Sequence[LinkSettings], robots: Sequence[RobotSettings], base_dir: Path | None
) -> list[Post]:
    """Man the other end of every link that has a ``simulate:`` block.

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
        name = settings.robot or (names[0] if len(names) == 1 else None)
        if name is None:
            raise ConfigError(f"{where}.robot: say which of {', '.join(names)}")
        if name not in names:
            raise ConfigError(
                f"{where}.robot: no robot '{name}'{nearest(name, names)}; "
                f"there are: {', '.join(names)}"
            )
        if link.robots is not None and name not in link.robots:
            raise ConfigError(f"{where}.robot: the link does not advise '{name}'; see its 'robots'")
        found.append((link, settings.model_copy(update={"robot": name}), names.index(name)))
    drives = {index: _only_drive(index, found, robots, base_dir) for _, _, index in found}
    speeds = {i: min(robots[i].max_speed_m_s, drive.peak_m_s) for i, drive in drives.items()}
    return [
        Post(link, settings, robots[index], index, base_dir, speeds[index], drives[index])
        for link, settings, index in found
    ]


def channels(all_posts: Sequence[Post], robot_index: int) -> list[str]:
    """Names of the controllers of one robot: the channels of its wiring, in order."""
    return [post.name for post in all_posts if post.robot_index == robot_index]


def codec_for(link: LinkSettings) -> Codec[Any]:
    """A codec for the far end of ``link``.

    Raises:
        ConfigError: no mock controller speaks this kind of link.
    """
    if isinstance(link, SerialLinkSettings):
        return SerialCodec(link.baudrate)
    if isinstance(link, CanLinkSettings):
        return CanCodec(link)
    raise ConfigError(f"links.{link.name}.simulate: no mock controller for kind '{link.kind}'")


class Station(Generic[U]):
    """A controller at work. ``cycle`` is its program: read, decide, move, answer."""

    def __init__(self, post: Post, codec: Codec[U], wiring: Wiring) -> None:
        """Take the post.

        Raises:
            RobotError: a robot or trajectory file is wrong.
        """
        self.post = post
        self.period_ns = int(post.settings.period_s * 1e9)
        self._core = ControllerCore(
            post.name, post.settings, post.robot_index, codec, post.full_speed_m_s
        )
        self._wiring = wiring
        self._arm: SimulatedArm | None = None
        if post.settings.role == "drive":
            drive = post.drive or _drive(post.settings, post.robot, post.base_dir)
            before = wiring.truth()  # a drive that starts again finds the arm where it stopped
            self._arm = SimulatedArm(
                drive.model,
                drive.trajectory,
                post.settings.deceleration or deceleration_of(drive.model, post.full_speed_m_s),
                post.settings.acceleration,
                path_s=before.path_s if before is not None else post.settings.start_s,
                speeds=drive.speeds,
            )

    def cycle(self, units: Sequence[U], now_ns: int) -> list[U]:
        """Take what has come by ``now_ns``, decide, move the arm; return what to send."""
        self._core.receive(units, now_ns)
        permit = self._core.permit(now_ns)
        self._wiring.set_permit(self.post.name, permit.speed_m_s, now_ns)
        if self._arm is None:
            self._core.obey(permit, now_ns)
            truth = self._wiring.truth()
            if truth is None:
                return self._core.outgoing(now_ns, None, None, RobotMode.UNKNOWN)
            mode = RobotMode.AUTOMATIC if truth.alive(now_ns) else RobotMode.UNKNOWN
            return self._core.outgoing(now_ns, *truth.at(now_ns), mode)
        allowed = self._wiring.permitted_speed(now_ns)
        if allowed < permit.speed_m_s:
            permit = Permit(allowed, "other channel")
        self._core.obey(permit, now_ns)
        self._arm.step(now_ns, min(permit.speed_m_s, self.post.robot.max_speed_m_s))
        q, qd = self._arm.joints()
        self._wiring.set_truth(q, qd, self._arm.path_s, now_ns)
        return self._core.outgoing(now_ns, q, qd, RobotMode.AUTOMATIC)

    def write_failed(self) -> None:
        """Count a unit that the link did not take."""
        self._core.write_failed()

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands; a monitor has none."""
        return self._arm is None or self._arm.at_rest

    def report(self) -> ControllerReport:
        """What it met so far."""
        return self._core.report()


def deceleration_of(model: RobotModel, up_to_m_s: float) -> float:
    """Uniform deceleration (m/s^2) that keeps the robot's stopping time and distance at any speed.

    The node counts on that table; an arm that stopped later than it says would be a lie.
    """
    needed = 0.0
    for i in range(1, _SPEED_STEPS + 1):
        speed = up_to_m_s * i / _SPEED_STEPS
        time_s, distance_m = model.stopping(speed)
        if time_s > 0 and distance_m > 0:
            needed = max(needed, speed / time_s, speed**2 / (2 * distance_m))
    return needed or 1.0


def _trajectory_of(settings: ControllerSettings, robot: RobotSettings) -> str:
    if settings.trajectory is not None:
        return settings.trajectory
    if isinstance(robot.motion, TrajectoryMotion):
        return robot.motion.file
    raise ConfigError(
        f"robot '{robot.name}': its drive has no trajectory; add 'trajectory' to the link's "
        "'simulate', such as pick_and_place"
    )


def _only_drive(
    index: int,
    found: Sequence[tuple[LinkSettings, ControllerSettings, int]],
    robots: Sequence[RobotSettings],
    base_dir: Path | None,
) -> Drive:
    """What the robot's only drive moves."""
    robot = robots[index]
    drives = [(link, s) for link, s, i in found if i == index and s.role == "drive"]
    if len(drives) != 1:
        raise ConfigError(
            f"links: robot '{robot.name}' has {len(drives)} simulated drives; give it exactly one "
            "link with 'simulate: {role: drive}', the others role: monitor"
        )
    return _drive(drives[0][1], robot, base_dir)


def _drive(settings: ControllerSettings, robot: RobotSettings, base_dir: Path | None) -> Drive:
    model = load_robot(robot, base_dir)
    return Drive(model, load_trajectory(_trajectory_of(settings, robot), model, base_dir))
