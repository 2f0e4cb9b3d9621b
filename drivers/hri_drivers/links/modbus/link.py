"""A Modbus TCP server as a link: a PLC reads the advice, and writes states and acknowledges.

``drivers/MODBUS.md`` has the registers, ``docs/guides/modbus.md`` the PLC's side. Nothing of it is
protected end to end.
"""

import ipaddress
import logging
from collections.abc import Sequence
from typing import ClassVar, Self

from pydantic import Field, model_validator

from hri_drivers.links.configured import ConfiguredLink, ConfiguredLinkSettings
from hri_drivers.links.load import Traffic
from hri_drivers.links.modbus.codec import BITRATE, OVERHEAD_BYTES, ModbusCodec
from hri_drivers.links.modbus.image import Block, Image
from hri_drivers.links.modbus.server import ModbusTransport
from hri_drivers.wires.transport import Transport
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import Advice, Message, RobotState, Status
from hri_predict.protocol.registers import NEAREST, NODE, ROBOT, STATE, words_of
from hri_predict.robots.settings import RobotSettings

log = logging.getLogger(__name__)

POLLS_HZ = 100.0
"""Rate at which PLCs are expected to read, for the load: every 10 ms."""
UNPROTECTED = (
    "Modbus has neither CRC nor counter of this node's, and knows no sender: not protected end to "
    "end; the PLC must stop when HEARTBEAT or ADVICE_COUNTER stands still (drivers/MODBUS.md)"
)


class ModbusLinkSettings(ConfiguredLinkSettings):
    """An entry of ``links:`` with ``kind: modbus``."""

    kind: str = "modbus"
    host: str = Field("127.0.0.1", description="address of this machine to listen on")
    port: int = Field(5020, ge=0, le=65_535, description="TCP port; 502 needs a privilege")
    allow_unauthenticated: bool = Field(
        False, description="listen beyond loopback, although anyone there can read and write"
    )
    robot_state_rate_hz: float = Field(
        50.0, ge=0, le=1000, description="rate at which PLCs write RobotState"
    )
    max_age_s: float = Field(
        0.4, ge=0.02, le=5, description="maximum age of an Advice's capture; older ones are unknown"
    )
    plc_timeout_s: float = Field(
        1.0, ge=0.05, le=60, description="PLC_HEARTBEAT that stands still for longer is reported"
    )
    bases: list[Pose | None] | None = Field(
        None,
        max_length=16,
        description="pose of each advised robot's base in the room, for distance and angle;"
        " default: room_from_robot",
    )

    safety: ClassVar[Safety] = harmless("port", "plc_timeout_s") | {
        "max_age_s": LessSafe(
            above="an Advice permits motion until its capture is {more:.2g} s older"
        ),
        "allow_unauthenticated": LessSafe(
            other="anyone on the network can claim robot states, and press the button"
        ),
    }

    @model_validator(mode="after")
    def _exposure(self) -> Self:
        if self.simulate is not None:
            raise ValueError("a modbus link has no simulated controller; leave 'simulate' out")
        try:
            local = ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            raise ValueError(
                "host must be an IP address of this machine, such as 127.0.0.1"
            ) from None
        if not local and not self.allow_unauthenticated:
            raise ValueError(
                f"host {self.host} is reached from the network, and Modbus knows no sender: set "
                "'allow_unauthenticated: true' if the network is the cell's alone"
            )
        return self

    @property
    def notes(self) -> list[str]:
        """See ``LinkSettings``."""
        return [UNPROTECTED]


class ModbusLink(ConfiguredLink[ModbusLinkSettings, Block]):
    """``contracts.link.Link`` whose other end polls; arguments as for ``ConfiguredLink``."""

    settings_model: ClassVar[type[ModbusLinkSettings]] = ModbusLinkSettings
    unprotected: ClassVar[str] = UNPROTECTED

    def _prepare(self, settings: ModbusLinkSettings, robots: Sequence[int]) -> None:
        assert isinstance(self._codec, ModbusCodec)
        self._registers = self._codec
        bases = list(settings.bases or [])[: len(robots)]
        self._registers.stand(robots, bases + [None] * (len(robots) - len(bases)))
        self._plc_alive: bool | None = None

    @staticmethod
    def make_transport(settings: ModbusLinkSettings) -> ModbusTransport:
        """The server, not yet open."""
        image = Image(settings.silence_timeout_s, settings.max_age_s)
        return ModbusTransport((settings.host, settings.port), image)

    @staticmethod
    def _make_codec(settings: ModbusLinkSettings, wire: Transport[Block]) -> ModbusCodec:
        return ModbusCodec(settings.plc_timeout_s, lambda: getattr(wire, "refused", 0))

    @staticmethod
    def receiver(settings: ModbusLinkSettings) -> ModbusCodec:
        """Return a decoder of what a PLC writes, for listeners."""
        return ModbusCodec(settings.plc_timeout_s)

    @staticmethod
    def of_robots(
        settings: ModbusLinkSettings, robots: Sequence[RobotSettings]
    ) -> ModbusLinkSettings:
        """Return the settings with the robots' bases; see ``contracts.link_abilities.OfRobots``.

        Raises:
            LinkError: the bases given are not one for each robot.
        """
        if settings.bases is None:
            bases = [robot.room_from_robot for robot in robots]
            return settings.model_copy(update={"bases": bases})
        if len(settings.bases) != len(robots):
            raise LinkError(
                f"link '{settings.name}': {len(settings.bases)} bases for {len(robots)} robots; "
                "give one for each, or leave bases out"
            )
        return settings

    @staticmethod
    def _shares(settings: ModbusLinkSettings, traffic: Traffic) -> dict[str, float]:
        """Shares of a network of 10 Mbit/s that one PLC polls every 10 ms."""
        if any(shape.moving_base for shape in traffic.shapes):
            raise LinkError(
                f"link '{settings.name}': the Modbus map has no registers for a base that "
                "moves; put this robot on a link of another kind"
            )
        robots = len(traffic.robots)
        sizes = {
            Status: (POLLS_HZ, NODE),
            Advice: (POLLS_HZ * robots, ROBOT + NEAREST),
            RobotState: (settings.robot_state_rate_hz * robots, STATE),
        }
        return {
            message.__name__: hz * 8 * (OVERHEAD_BYTES + 2 * words_of(registers)) / BITRATE
            for message, (hz, registers) in sizes.items()
        }

    @staticmethod
    def _bitrate(settings: ModbusLinkSettings) -> int:
        return BITRATE

    # -- the codec needs the time of each message --------------------------------------------------

    def _encoded(self, message: Message, now_ns: int) -> list[Block]:
        self._registers.now_ns = now_ns
        if isinstance(message, Status):
            self._watch_plc()
        return super()._encoded(message, now_ns)

    def _send_bulk(self, now_ns: int, paced: bool) -> bool:
        self._registers.now_ns = now_ns
        return super()._send_bulk(now_ns, paced)

    def _receive(self, units: list[Block], now_ns: int) -> None:
        self._registers.now_ns = now_ns
        super()._receive(units, now_ns)
        self.counters.overrun += getattr(self._transport, "overrun", 0)  # writes lost before that

    def _watch_plc(self) -> None:
        """Say once when the PLC's heartbeat ends, and when it is back."""
        alive = self._registers.alive
        if alive == self._plc_alive:
            return
        before, self._plc_alive = self._plc_alive, alive
        if alive:
            log.info("link '%s': the PLC's heartbeat is there", self.name)
        elif before:
            said = "the PLC's heartbeat stands still: it is stopped, or does not reach this node"
            log.warning("link '%s': %s", self.name, said)
            self._note(LinkError(said))
