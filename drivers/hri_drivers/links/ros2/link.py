"""A link to ROS 2: advice, zones and forecasts as topics; see ``docs/guides/ros2.md``.

The topic ``frames`` carries the node's protected frames, as on a serial line before COBS. All other
topics carry the same content in plain messages without end-to-end protection.
"""

import contextlib
from collections.abc import Sequence
from itertools import combinations
from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.configured import ConfiguredLink, ConfiguredLinkSettings
from hri_drivers.links.load import Traffic
from hri_drivers.links.ros2.codec import (
    JOINT_BYTES,
    SAMPLE_BYTES,
    FramesReceiver,
    Publication,
    Ros2Codec,
    worst_bits,
)
from hri_drivers.links.ros2.joint_states import JointStateReader, JointStatesSettings
from hri_drivers.wires.ros2_settings import NodeName, Ros2Settings, TopicName
from hri_drivers.wires.transport import Transport
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.protocol.messages import Message, RobotState
from hri_predict.protocol.ros.link_topics import Topics, doubled, unknown
from hri_predict.protocol.ros.plain import PlainMessages
from hri_predict.protocol.wire import StateShape, wire_bits
from hri_predict.robots.settings import RobotSettings, StateMotion

MBIT = 1_000_000
UNPROTECTED = (
    "its plain topics are not protected end to end and permit nothing by themselves: any node of "
    "the domain can publish them; only 'frames' is protected (docs/guides/ros2.md)"
)
PLAIN_STATES = (
    "joint_states is not protected either: any node of the domain can forge the robot's position, "
    "and JointState has no operating mode (docs/guides/ros2.md)"
)
OPEN = "discovery 'subnet': every machine in the network can publish, and read people's positions"


class Ros2LinkSettings(Ros2Settings, ConfiguredLinkSettings):
    """An entry of ``links:`` with ``kind: ros2``."""

    kind: str = "ros2"
    full_speed_m_s: float = Field(
        ge=0.01,
        le=20,
        description="speed of the robot's fastest point at speed_fraction 1",
    )
    node_name: NodeName = Field("hri_predict_link", description="its name in the ROS graph")
    namespace: TopicName = Field("/hri", description="namespace of its topics")
    remap: dict[str, TopicName] = Field(
        {}, description="other topic names, such as robot_0/speed_ovr: /speed_ovr"
    )
    frame_id: str = Field(
        "room", pattern=r"^[A-Za-z0-9_/.-]{1,64}$", description="frame of the room in ROS"
    )
    take: bool = Field(
        False, description="whether to receive RobotState and Acknowledge as protected frames"
    )
    joint_states: JointStatesSettings | None = Field(
        None, description="robot state from sensor_msgs/JointState; default: none"
    )
    joint_states_delay_s: float | None = Field(
        None,
        ge=0.001,
        le=1,
        description="a JointState older than this on arrival is refused; default and maximum: "
        "the robot's motion.delay_s",
    )
    bitrate: int = Field(
        100 * MBIT,
        ge=MBIT,
        le=10**6 * MBIT,
        description="network bandwidth that this link may use, bit/s",
    )

    safety: ClassVar[Safety] = harmless("take", "bitrate", "joint_states_delay_s") | {
        "full_speed_m_s": LessSafe(
            below="fractions refer to {value:g} m/s: a robot that is faster at fraction 1 "
            "exceeds its limit"
        ),
    }

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if self.simulate is not None:
            raise ValueError("a ros2 link has no simulated controller; leave 'simulate' out")
        if self.joint_states is not None and self.take:
            raise ValueError(
                "'joint_states' and 'take' would both provide the robot's state; leave one out"
            )
        if wrong := unknown(self.remap):
            raise ValueError(
                f"remap: no topic '{wrong[0]}'; available: frames, zones, forecast, "
                "forecast_markers, /diagnostics, robot_0/speed_fraction, robot_0/speed_ovr, "
                "robot_0/advice and so on"
            )
        if twice := doubled(self.topics, self.remap):
            raise ValueError(f"remap: {twice[0]} is the name of two topics; give one another name")
        return self

    @property
    def topics(self) -> Topics:
        """Names of its topics."""
        return Topics(self.namespace, self.remap)

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        heard = [] if self.joint_states is None else [PLAIN_STATES]
        return [UNPROTECTED, *heard, *([OPEN] if self.discovery == "subnet" else [])]


class Ros2Link(ConfiguredLink[Ros2LinkSettings, Publication]):
    """``hri_predict.contracts.link.Link`` over ROS 2; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[Ros2LinkSettings]] = Ros2LinkSettings
    _codec: Ros2Codec

    def _prepare(self, settings: Ros2LinkSettings, robots: Sequence[int]) -> None:
        device = getattr(self._transport, "device", self._transport)  # beneath injected faults
        if hasattr(device, "say"):
            device.say = self._say
        if self._codec.states is not None:
            self._codec.states.robot = robots[0]

    @staticmethod
    def make_transport(settings: Ros2LinkSettings) -> Transport[Publication]:
        """The configured node, not yet created.

        ROS 2 is imported only here: settings are checked and documented without it.

        Raises:
            ConfigError: ROS 2 is not installed, or cannot be loaded.
        """
        try:
            from hri_drivers.links.ros2.transport import Ros2Transport
        except ImportError as error:
            raise ConfigError(
                f"link 'ros2' needs a package that is not installed: {error.name or error}; source "
                f"your ROS 2 installation, or pip install 'hri-predict[ros2]'"
            ) from error
        return Ros2Transport(
            settings,
            settings.topics,
            silence_s=settings.silence_timeout_s,
            take=settings.take,
            joint_states=None if settings.joint_states is None else settings.joint_states.topic,
        )

    @staticmethod
    def _make_codec(settings: Ros2LinkSettings, wire: Transport[Publication]) -> Ros2Codec:
        plain = PlainMessages(settings.full_speed_m_s, settings.frame_id)
        if settings.joint_states is None:
            return Ros2Codec(plain, settings.bitrate)
        if settings.joint_states_delay_s is None:
            raise LinkError(f"link '{settings.name}': joint_states_delay_s is missing; set it")
        frames = FramesReceiver()
        states = JointStateReader(
            settings.joint_states, settings.joint_states_delay_s, frames.counters
        )
        return Ros2Codec(plain, settings.bitrate, states, frames)

    @staticmethod
    def receiver(settings: Ros2LinkSettings) -> FramesReceiver:
        """Return a decoder for this link's units, for listeners."""
        return FramesReceiver()

    @staticmethod
    def of_robots(settings: Ros2LinkSettings, robots: Sequence[RobotSettings]) -> Ros2LinkSettings:
        """Return the settings with the delay of the robot's states; see ``contracts.OfRobots``.

        Raises:
            LinkError: ``joint_states`` of several robots; or their delay is unknown or above the
                robot's.
        """
        if settings.joint_states is None:
            return settings
        if len(robots) != 1:
            raise LinkError(
                f"link '{settings.name}': joint_states are of one robot, and this link advises "
                f"{len(robots)}; name one under 'robots', and give each robot its own link and "
                f"'namespace'"
            )
        motion, own = robots[0].motion, settings.joint_states_delay_s
        if not isinstance(motion, StateMotion):
            raise LinkError(
                f"link '{settings.name}': joint_states need 'motion: {{kind: state}}' of robot "
                f"'{robots[0].name}'"
            )
        if motion.delay_s < max(own or 0.0, 0.001):
            raise LinkError(
                f"link '{settings.name}': joint_states need the robot's motion.delay_s, the "
                f"maximum age of a state at its arrival; set it to at least {own or 0.02:g}"
            )
        return settings.model_copy(update={"joint_states_delay_s": own or motion.delay_s})

    @staticmethod
    def _shares(settings: Ros2LinkSettings, traffic: Traffic) -> dict[str, float]:
        wanted, states_hz = settings.joint_states, settings.robot_state_rate_hz
        if wanted is not None:
            Ros2Link._check_joints(settings, wanted, traffic.shapes)

        def seconds(message: type[Message], shape: StateShape) -> float:
            if message is not RobotState:
                return worst_bits(message) / settings.bitrate
            if wanted is not None:
                return 8 * (SAMPLE_BYTES + JOINT_BYTES * shape.joints) / settings.bitrate
            # a protected frame alone
            return wire_bits(message, "serial", shape=shape).nominal / settings.bitrate

        is_heard = settings.take or wanted is not None
        return traffic.shares(seconds, states_hz if is_heard else 0.0)

    @staticmethod
    def _bitrate(settings: Ros2LinkSettings) -> int:
        return settings.bitrate

    @staticmethod
    def _check_joints(
        settings: Ros2LinkSettings, wanted: JointStatesSettings, shapes: Sequence[StateShape]
    ) -> None:
        for shape in shapes:
            if shape.moving_base:
                raise LinkError(
                    f"link '{settings.name}': joint_states cannot give the pose of a moving base; "
                    "put this robot's state on a link of another kind"
                )
            if shape.joints != len(wanted.names):
                raise LinkError(
                    f"link '{settings.name}': joint_states.names has {len(wanted.names)} names, and"
                    f" the robot {shape.joints} joints; name each, in the order of its model"
                )

    @staticmethod
    def check_together(links: Sequence[Ros2LinkSettings]) -> None:
        """Refuse links of one node that publish the same topics, or differ in ``discovery``.

        Raises:
            ConfigError: the message names both and the necessary change.
        """
        for a, b in combinations(links, 2):
            if (a.domain_id, a.namespace) == (b.domain_id, b.namespace):
                raise ConfigError(
                    f"links '{a.name}' and '{b.name}' both have namespace {a.namespace}; put their "
                    "robots on one link, or give one of them another"
                )
            if a.discovery != b.discovery:
                raise ConfigError(
                    f"links '{a.name}' and '{b.name}' differ in 'discovery', which applies to the "
                    f"whole process; give both the same"
                )

    def _end(self) -> None:
        """Publish a final 0 to every robot, then close."""
        words = tuple(self._codec.plain.last_words()) if self.connected else ()
        if words:
            with contextlib.suppress(LinkError):
                self._send(Publication(b"", plain=words), self._clock.now_ns())
        super()._end()
