"""Common part of links to plants: the advice in the registers of one map, for any protocol.

The link writes blocks of the map (``codec.py``). Its transport is a server that keeps them in an
image (``image.py``), computed when it is read.
"""

import errno
import ipaddress
import logging
import socket
from collections.abc import Sequence
from typing import ClassVar, Self, TypeVar

from pydantic import Field, model_validator

from hri_drivers.links.configured import ConfiguredLink, RefusingLinkSettings
from hri_drivers.links.load import Traffic
from hri_drivers.links.plant.codec import BITRATE, OVERHEAD_BYTES, RegisterCodec
from hri_drivers.links.plant.image import Block
from hri_drivers.wires.transport import Transport
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import Advice, Message, RobotState, Status
from hri_predict.protocol.registers import NEAREST, NODE, ROBOT, STATE, words_of
from hri_predict.robots.settings import RobotSettings

log = logging.getLogger(__name__)


class PlantLinkSettings(RefusingLinkSettings):
    """Settings common to servers that plants read."""

    host: str = Field("127.0.0.1", description="address of this machine to listen on")
    port: int = Field(ge=0, le=65_535, description="TCP port")
    allow_unauthenticated: bool = Field(
        False,
        description="listen beyond loopback, although anyone on the network can read and write",
    )
    bases: list[Pose | None] | None = Field(
        None,
        max_length=16,
        description="pose of each advised robot's base in the room, for distance and angle;"
        " default: room_from_robot",
    )

    safety: ClassVar[Safety] = harmless("port") | {
        "allow_unauthenticated": LessSafe(
            other="anyone on the network can forge robot states and press the button"
        ),
    }
    protocol: ClassVar[str]
    """Name of the protocol, for messages."""

    @property
    def knows_clients(self) -> bool:
        """Whether clients must authenticate themselves."""
        return False

    @model_validator(mode="after")
    def _exposure(self) -> Self:
        if self.simulate is not None:
            raise ValueError(
                f"a {self.kind} link has no simulated controller; leave 'simulate' out"
            )
        try:
            local = ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            raise ValueError(
                "host must be an IP address of this machine, such as 127.0.0.1"
            ) from None
        if not local and not self.allow_unauthenticated and not self.knows_clients:
            raise ValueError(
                f"host {self.host} is reachable from the network, and {self.protocol} cannot "
                "identify senders: set 'allow_unauthenticated: true' if only the cell uses "
                "the network"
            )
        return self


P = TypeVar("P", bound=PlantLinkSettings)


class PlantLink(ConfiguredLink[P, Block]):
    """``contracts.link.Link`` whose other end reads; arguments as for ``ConfiguredLink``.

    Attributes:
        reads_hz: rate at which plants are expected to read, for the load.
        word_bytes: bytes on the network for each word of the map.
    """

    reads_hz: ClassVar[float] = 100.0
    word_bytes: ClassVar[int] = 2

    def _prepare(self, settings: P, robots: Sequence[int]) -> None:
        assert isinstance(self._codec, RegisterCodec)
        self._registers = self._codec
        bases = list(settings.bases or [])[: len(robots)]
        self._registers.stand(robots, bases + [None] * (len(robots) - len(bases)))
        self._plc_alive: bool | None = None

    @staticmethod
    def _make_codec(settings: P, wire: Transport[Block]) -> RegisterCodec:
        return RegisterCodec(refused=lambda: getattr(wire, "refused", 0))

    @staticmethod
    def receiver(settings: P) -> RegisterCodec:
        """Return a decoder of what a PLC writes, for listeners."""
        return RegisterCodec()

    @staticmethod
    def of_robots(settings: P, robots: Sequence[RobotSettings]) -> P:
        """Return the settings with the robots' bases; see ``contracts.link_abilities.OfRobots``.

        Raises:
            LinkError: the number of bases differs from the number of robots.
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

    @classmethod
    def _shares(cls, settings: P, traffic: Traffic) -> dict[str, float]:
        """Fractions of a 10 Mbit/s network used if one plant reads everything."""
        if any(shape.moving_base for shape in traffic.shapes):
            raise LinkError(
                f"link '{settings.name}': the register map has no registers for a base that "
                "moves; put this robot on a link of another kind"
            )
        robots = len(traffic.robots)
        sizes = {
            Status: (cls.reads_hz, NODE),
            Advice: (cls.reads_hz * robots, ROBOT + NEAREST),
            RobotState: (settings.robot_state_rate_hz * robots, STATE),
        }
        return {
            message.__name__: hz
            * 8
            * (OVERHEAD_BYTES + cls.word_bytes * words_of(registers))
            / BITRATE
            for message, (hz, registers) in sizes.items()
        }

    @staticmethod
    def _bitrate(settings: P) -> int:
        return BITRATE

    # -- the codec needs the time of each message --------------------------------------------------

    def _encoded(self, message: Message, now_ns: int) -> list[Block]:
        self._registers.now_ns = now_ns
        if isinstance(message, Status):
            self._watch_plc()
            self._codec.count(self.counters)  # what the server refused comes with no unit
            self.counters.advice_timeouts = getattr(self._transport, "advice_timeouts", 0)
        return super()._encoded(message, now_ns)

    def _send_bulk(self, now_ns: int, paced: bool) -> bool:
        self._registers.now_ns = now_ns
        return super()._send_bulk(now_ns, paced)

    def _receive(self, units: list[Block], now_ns: int) -> None:
        self._registers.now_ns = now_ns
        super()._receive(units, now_ns)
        self.counters.overrun += getattr(self._transport, "overrun", 0)  # writes lost before that

    def _watch_plc(self) -> None:
        """Log once when the PLC's heartbeat stops, and when it returns."""
        alive = self._registers.alive
        if alive == self._plc_alive:
            return
        before, self._plc_alive = self._plc_alive, alive
        if alive:
            log.info("link '%s': the PLC's heartbeat is present", self.name)
        elif before:
            said = (
                "the PLC's heartbeat does not change: the PLC has stopped, or cannot reach this "
                "node"
            )
            log.warning("link '%s': %s", self.name, said)
            self._note(LinkError(said))


def try_address(what: str, address: tuple[str, int]) -> None:
    """Find out why a server could not listen at an address; libraries do not report it.

    Raises:
        LinkError: the address cannot be used; the message names it and the remedy.
    """
    host, port = address
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server(address, family=family).close()
    except OSError as error:
        remedies = {
            errno.EADDRINUSE: "in use by another program; stop it, or choose another 'port'",
            errno.EADDRNOTAVAIL: "not an address of this machine; correct 'host'",
            errno.EACCES: "not permitted; choose a 'port' above 1023",
        }
        why = remedies.get(error.errno or 0, f"{error.strerror}; correct 'host' and 'port'")
        raise LinkError(f"{what} at {host}:{port}: {why}") from error
