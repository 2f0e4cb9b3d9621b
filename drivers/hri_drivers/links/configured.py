"""Links built from their entries in the configuration: common part of serial, CAN and zenoh."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Generic, TypeVar

from pydantic import Field

from hri_drivers.links.codec import Codec
from hri_drivers.links.load import Traffic
from hri_drivers.links.slots import Budget
from hri_drivers.links.supervised import SupervisedLink
from hri_drivers.wires.transport import Transport
from hri_predict.base.clock import Clock
from hri_predict.base.errors import LinkError
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.contracts.link import LinkLoad, LinkSettings
from hri_predict.protocol.wire import StateShape

log = logging.getLogger(__name__)

U = TypeVar("U")
WITHOUT_DEVICE = "'wait_for_device: true' starts the node without it"
"""Ends the remedies for a device that may just be switched off."""
SAY_NS = 10_000_000_000
"""Minimum time between two lines about refused messages of one link."""


class ConfiguredLinkSettings(LinkSettings):
    """Settings common to these links."""

    robot_state_rate_hz: float = Field(
        50.0, ge=0, le=1000, description="rate at which the controller sends RobotState"
    )
    wait_for_device: bool = Field(
        False, description="start even if the device is missing, and keep trying to open it"
    )

    safety: ClassVar[Safety] = harmless("robot_state_rate_hz", "wait_for_device")


class RefusingLinkSettings(ConfiguredLinkSettings):
    """Settings of links that refuse old advice; see ``contracts.link_abilities.RefusesOld``."""

    max_age_s: float | None = Field(
        None,
        ge=0.02,
        le=5,
        description="maximum age of an Advice's capture; older ones permit no motion; default: the"
        " delay budget's, printed by check",
    )

    safety: ClassVar[Safety] = {
        "max_age_s": LessSafe(above="an Advice permits motion for {more:.2g} s longer"),
    }

    @property
    def age_limit_s(self) -> float:
        """``max_age_s``.

        Raises:
            LinkError: it is neither configured nor filled in by the node.
        """
        if self.max_age_s is None:
            raise LinkError(f"link '{self.name}': max_age_s is missing; set it")
        return self.max_age_s


S = TypeVar("S", bound=ConfiguredLinkSettings)


class ConfiguredLink(SupervisedLink[U], ABC, Generic[S, U]):
    """``contracts.link.Link`` from its settings; each kind of link provides wire, codec and load.

    Args:
        settings: the link's.
        clock: the node's.
        transport: a wire to use instead of the configured one (a pipe, a fault injector).
        rate_hz: the node's cycle rate; with the bit rate it sets the room for Zone and Pose.
        robots: indices of the robots that this link advises.
        shapes: shape of each of them; see ``LinkClass``.

    Raises:
        LinkError: the settings name no device and no transport is given.
    """

    def __init__(
        self,
        settings: S,
        clock: Clock,
        transport: Transport[U] | None = None,
        *,
        rate_hz: float = 25.0,
        robots: Sequence[int] = (0,),
        shapes: Sequence[StateShape] = (),
    ) -> None:
        self._demand(settings)
        wire = transport if transport is not None else self.make_transport(settings)
        super().__init__(
            settings=settings,
            clock=clock,
            transport=wire,
            codec=self._make_codec(settings, wire),
            budget=Budget(max(0.0, self.load(settings, rate_hz, robots, shapes).spare)),
            wait_for_device=settings.wait_for_device,
        )
        self._prepare(settings, robots)

    @staticmethod
    def _demand(settings: S) -> None:
        """Refuse settings that cannot work here.

        Raises:
            LinkError: the message gives the reason and the remedy.
        """

    def _prepare(self, settings: S, robots: Sequence[int]) -> None:
        """Complete a newly created link for the robots that it advises."""

    bitrates: ClassVar[tuple[int, ...]] = ()
    """Usual bit rates of this kind of wire, for error messages."""
    _refused_said_ns: int | None = None
    _refused_before = 0

    def _receive(self, units: list[U], now_ns: int) -> None:
        """See ``SupervisedLink``; log now and then why whole messages are refused."""
        super()._receive(units, now_ns)
        count, why = self.counters.malformed, getattr(self._codec, "refused", "")
        said_ns = self._refused_said_ns
        if not why or count <= self._refused_before:
            return
        if said_ns is None or now_ns - said_ns >= SAY_NS:
            self._refused_said_ns, self._refused_before = now_ns, count
            self._say(f"{count} messages refused: {why}")

    def _say(self, line: str) -> None:
        """Log a line, which becomes the link's last error."""
        log.warning("link '%s': %s", self.name, line)
        self._note(LinkError(line))

    @staticmethod
    @abstractmethod
    def make_transport(settings: S) -> Transport[U]:
        """Return the configured wire, not yet open.

        Raises:
            LinkError: the settings name no device.
        """

    @staticmethod
    @abstractmethod
    def _make_codec(settings: S, wire: Transport[U]) -> Codec[U]:
        """Return the codec between messages and units of ``wire``."""

    @classmethod
    def load(
        cls,
        settings: S,
        rate_hz: float,
        robots: Sequence[int] = (0,),
        shapes: Sequence[StateShape] = (),
    ) -> LinkLoad:
        """Return how full the link will be; see ``LinkClass``."""
        shares = cls._shares(settings, Traffic(rate_hz, robots, shapes))
        load = sum(shares.values())
        return LinkLoad(
            name=settings.name,
            load=load,
            spare=1.0 - load - settings.reserved_load,
            details=shares,
            rate_hz=rate_hz,
            bitrate=cls._bitrate(settings),
            bitrates=cls.bitrates,
        )

    @staticmethod
    @abstractmethod
    def _shares(settings: S, traffic: Traffic) -> dict[str, float]:
        """Return message -> fraction of the time for which it occupies the wire.

        Raises:
            LinkError: this kind of wire cannot carry the RobotState of one of the robots.
        """

    @staticmethod
    @abstractmethod
    def _bitrate(settings: S) -> int:
        """Return the configured bit rate, bit/s."""
