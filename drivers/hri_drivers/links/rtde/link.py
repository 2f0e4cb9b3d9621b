"""A link to a Universal Robots arm: receives its joints, and sends its speed slider.

``docs/guides/ur-rtde.md`` describes the robot's side. The speed slider is not a safety function.
"""

import logging
import struct
from collections.abc import Callable, Sequence
from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.configured import SAY_NS, ConfiguredLink, RefusingLinkSettings
from hri_drivers.links.load import Traffic
from hri_drivers.links.rtde.packets import Kind, Packet, Recipe, framed, text_of
from hri_drivers.links.rtde.robot import JOINTS, OUTPUTS, StateReader
from hri_drivers.links.rtde.slider import SpeedSlider, Written
from hri_drivers.links.rtde.transport import RtdeTransport
from hri_drivers.wires.transport import Transport, TransportBusy
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import MIN_SPEED_M_S
from hri_predict.contracts.link import LinkCounters
from hri_predict.protocol.messages import Advice, Message, RobotState, at_encoding
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.robots.settings import RobotSettings

log = logging.getLogger(__name__)

PORT = 30_004
WRITE_NS = 8_000_000
"""If no Advice arrives, the registers are written again after this time, one cycle at 125 Hz."""
BITRATE = 10_000_000
OVERHEAD_BYTES = 120
"""Maximum bytes of Ethernet, IPv6 and TCP around a packet."""
UNPROTECTED = (
    "RTDE carries neither a CRC nor a counter from this node: not protected end to end, and the "
    "speed slider is not a safety function; the robot's program must stop when the watchdog "
    "register stops changing (docs/guides/ur-rtde.md)"
)
_WRITTEN = struct.Struct(">Idii")
_TYPES = ("UINT32", "DOUBLE", "INT32", "INT32")


class RtdeLinkSettings(RefusingLinkSettings):
    """An entry of ``links:`` with ``kind: rtde``."""

    kind: str = "rtde"
    host: str = Field(min_length=1, max_length=253, description="address of the controller")
    port: int = Field(PORT, ge=1, le=65_535, description="its RTDE port")
    robot_state_rate_hz: float = Field(
        125.0, ge=10, le=500, description="rate at which the controller sends its state"
    )
    full_speed_m_s: float | None = Field(
        None,
        ge=MIN_SPEED_M_S,
        le=20,
        description="speed of the fastest point with the slider at 100 %; default: the robot's"
        " max_speed_m_s",
    )
    rise_per_s: float = Field(
        0.5, ge=0.02, le=2, description="maximum rise of the slider, fraction per second"
    )
    hold_s: float = Field(
        0.5, ge=0, le=10, description="minimum time for which the slider stays at 0"
    )
    watchdog_register: int = Field(
        24, ge=0, le=47, description="input_int_register that counts fresh Advice"
    )
    level_register: int = Field(
        25, ge=0, le=47, description="input_int_register that holds the level"
    )

    safety: ClassVar[Safety] = harmless(
        "port", "full_speed_m_s", "rise_per_s", "hold_s", "watchdog_register", "level_register"
    )

    @model_validator(mode="after")
    def _registers_differ(self) -> Self:
        if self.simulate is not None:
            raise ValueError(
                "an rtde link has no simulated controller; start `python -m hri_sim.rtde`, give "
                "its address as host, and leave 'simulate' out"
            )
        if self.watchdog_register == self.level_register:
            raise ValueError("watchdog_register and level_register must differ")
        return self

    @property
    def inputs(self) -> Recipe:
        """Registers that are written into the controller."""
        registers = (self.watchdog_register, self.level_register)
        names = (f"input_int_register_{n}" for n in registers)
        return Recipe(("speed_slider_mask", "speed_slider_fraction", *names), _TYPES)

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        return [UNPROTECTED]


class RtdeCodec:
    """Encodes registers, and decodes RobotStates, as data packages; see ``links.codec.Codec``.

    Args:
        refused_packets: returns the number of packets that the transport refused.

    Attributes:
        robot: index of the robot.
        counters: see ``contracts.link.Receiver``.
        text: newest text message from the controller; "" if none came.
    """

    def __init__(self, refused_packets: Callable[[], int] = lambda: 0) -> None:
        self.robot = 0
        self.counters = ReceiveCounters()
        self.text = ""
        self._reader = StateReader()
        self._refused_packets = refused_packets

    def carries(self, message: Message) -> bool:
        """True for an Advice only."""
        return isinstance(message, Advice)

    def watch(self, own: OwnFrames) -> None:
        """Do nothing: the controller accepts one writer of a register, and no frame returns."""

    def encode(self, message: Message) -> list[Packet]:
        """Return nothing: the link itself writes the registers that follow the Advice."""
        return []

    def decode(self, unit: Packet) -> list[Message]:
        """Return the RobotState of a data package."""
        if unit.kind == Kind.TEXT:
            self.counters.ignored += 1
            self.text = text_of(unit.data)
            return []
        state = self._reader.read(self.robot, unit.data) if unit.kind == Kind.DATA else None
        if state is None:
            self.counters.malformed += 1
            return []
        self.counters.received += 1
        return [state]

    def feed(self, unit: Packet) -> list[Message]:
        """See ``contracts.link.Receiver``."""
        return self.decode(unit)

    def reset(self) -> None:
        """Restart with the time stamps of a new connection; counters of states continue."""
        self._reader.restart()

    def count(self, counters: LinkCounters) -> None:
        """Copy the counts of refused packages."""
        counters.malformed = self.counters.malformed + self._refused_packets()
        counters.ignored = self.counters.ignored

    def worst_s(self, message: Message) -> float:
        """Seconds on the network of the packet that follows an Advice."""
        return 8 * (OVERHEAD_BYTES + _WRITTEN.size) / BITRATE

    def unit_s(self, unit: Packet) -> float:
        """Seconds on the network of this packet."""
        return 8 * (OVERHEAD_BYTES + len(unit.data)) / BITRATE

    def raw(self, unit: Packet) -> bytes:
        """The packet as bytes; a data package without the number of its recipe."""
        return framed(unit.kind, unit.data)

    def size(self, unit: Packet) -> int:
        """Number of bytes of its data."""
        return len(unit.data)


def package(written: Written) -> Packet:
    """Return the data package that writes the registers; the mask takes control of the slider."""
    values = (1, written.fraction, written.watchdog, int(written.level))
    return Packet(Kind.DATA, _WRITTEN.pack(*values))


class RtdeLink(ConfiguredLink[RtdeLinkSettings, Packet]):
    """``contracts.link.Link`` to one Universal Robots arm; arguments as for ``ConfiguredLink``.

    The registers are written with each Advice and every 8 ms. Without a fresh Advice for
    ``silence_timeout_s`` the slider is 0, the level *unknown*, and the watchdog stops.

    Raises:
        LinkError: more than one robot, or a robot without six joints on a fixed base, or with an
            unknown full speed.
    """

    settings_model: ClassVar[type[RtdeLinkSettings]] = RtdeLinkSettings
    unprotected: ClassVar[str] = UNPROTECTED

    @staticmethod
    def _demand(settings: RtdeLinkSettings) -> None:
        if settings.full_speed_m_s is None:
            raise LinkError(f"link '{settings.name}': full_speed_m_s is missing; set it")

    def _prepare(self, settings: RtdeLinkSettings, robots: Sequence[int]) -> None:
        assert settings.full_speed_m_s is not None  # see ``_demand``
        self._robot = robots[0]
        assert isinstance(self._codec, RtdeCodec)
        self._codec.robot = self._robot
        self._slider = SpeedSlider(
            full_speed_m_s=settings.full_speed_m_s,
            rise_per_s=settings.rise_per_s,
            hold_s=settings.hold_s,
            silence_s=settings.silence_timeout_s,
            max_age_s=settings.age_limit_s,
        )
        self._due_ns = 0
        self._said, self._said_ns = "", -SAY_NS

    @staticmethod
    def make_transport(settings: RtdeLinkSettings) -> RtdeTransport:
        """The configured controller, not yet connected."""
        address = (settings.host, settings.port)
        return RtdeTransport(address, OUTPUTS, settings.inputs, settings.robot_state_rate_hz)

    @staticmethod
    def _make_codec(settings: RtdeLinkSettings, wire: Transport[Packet]) -> RtdeCodec:
        return RtdeCodec(lambda: getattr(wire, "malformed", 0))

    @staticmethod
    def receiver(settings: RtdeLinkSettings) -> RtdeCodec:
        """Return a decoder of the controller's data packages, for listeners."""
        return RtdeCodec()

    @staticmethod
    def of_robots(settings: RtdeLinkSettings, robots: Sequence[RobotSettings]) -> RtdeLinkSettings:
        """Return the settings with the robot's full speed; see ``contracts.link.OfRobots``.

        Raises:
            LinkError: several robots; or the configured speed at 100 % is below the robot's
                maximum.
        """
        if len(robots) != 1:
            raise LinkError(
                f"link '{settings.name}': an RTDE controller has one arm, and this link advises "
                f"{len(robots)} robots; name one under 'robots', and use a separate link for each "
                f"arm"
            )
        fastest = robots[0].max_speed_m_s
        full = settings.full_speed_m_s
        if full is None:
            return settings.model_copy(update={"full_speed_m_s": fastest})
        if full < fastest:
            raise LinkError(
                f"link '{settings.name}': full_speed_m_s {full:g} is below the robot's "
                f"max_speed_m_s {fastest:g}, so a limit would permit too much; raise it, or leave "
                "it out"
            )
        return settings

    @staticmethod
    def _shares(settings: RtdeLinkSettings, traffic: Traffic) -> dict[str, float]:
        """Shares of a network of 10 Mbit/s."""
        if any(shape.joints != JOINTS or shape.moving_base for shape in traffic.shapes):
            raise LinkError(
                f"link '{settings.name}': RTDE carries six joints on a fixed base; put this robot "
                "on a link of another kind"
            )
        written_s = 8 * (OVERHEAD_BYTES + _WRITTEN.size) / BITRATE
        state_s = 8 * (OVERHEAD_BYTES + OUTPUTS.layout.size) / BITRATE
        advice_hz = traffic.rate_hz * len(traffic.robots)
        return {
            Advice.__name__: (advice_hz + 1e9 / WRITE_NS) * written_s,
            RobotState.__name__: settings.robot_state_rate_hz * state_s,
        }

    @staticmethod
    def _bitrate(settings: RtdeLinkSettings) -> int:
        return BITRATE

    def _receive(self, units: list[Packet], now_ns: int) -> None:
        """See ``ConfiguredLink``; log a new text of the controller, at most one in 10 s."""
        super()._receive(units, now_ns)
        assert isinstance(self._codec, RtdeCodec)
        text = self._codec.text
        if text != self._said and now_ns - self._said_ns >= SAY_NS:
            self._said, self._said_ns = text, now_ns
            log.warning("link '%s': message from the controller: %s", self.name, text)

    # -- the slider follows every Advice, and is written although none comes -----------------------

    def _encoded(self, message: Message, now_ns: int) -> list[Packet]:
        if isinstance(message, Advice) and message.robot == self._robot:
            fresh = at_encoding(message, now_ns)
            assert isinstance(fresh, Advice)
            self._slider.take(fresh, now_ns)
        return [self._package(now_ns)]

    def _package(self, now_ns: int) -> Packet:
        self._due_ns = now_ns + WRITE_NS
        written = self._slider.at(now_ns)
        self.counters.advice_timeouts = self._slider.timeouts
        return package(written)

    def _drain(self, now: Callable[[], int], with_bulk: bool = True, paced: bool = False) -> None:
        """See ``SupervisedLink``; write the registers again when it is time."""
        super()._drain(now, with_bulk, paced)
        now_ns = now()
        if now_ns < self._due_ns:
            return
        try:
            self._send(self._package(now_ns), now_ns)
        except TransportBusy as error:
            self._busy(None, error, now_ns)

    def _patience_s(self) -> float | None:
        """See ``SupervisedLink``; at most until the next write."""
        patience_s = super()._patience_s()
        due_s = max(0.0, (self._due_ns - self._clock.now_ns()) * 1e-9)
        return due_s if patience_s is None else min(patience_s, due_s)

    def _open(self, now_ns: int) -> None:
        super()._open(now_ns)
        self._slider.restart()
        self._due_ns = now_ns

    def _lost(self, error: Exception, now_ns: int) -> None:
        """See ``SupervisedLink``; a controller with invalid answers may still accept writes."""
        self._say_stop(now_ns)
        super()._lost(error, now_ns)

    def _end(self) -> None:
        self._say_stop(self._clock.now_ns())
        super()._end()

    def _say_stop(self, now_ns: int) -> None:
        """Write 0 and *unknown* last: the controller keeps the values that it received last."""
        if self.connected:
            self._slider.restart()
            try:
                self._send(self._package(now_ns), now_ns)
            except LinkError as error:
                self._note(error)
