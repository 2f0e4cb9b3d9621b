"""A kind of link under check, on the virtual clock."""

from dataclasses import dataclass, field

from hri_predict.base.clock import VirtualClock
from hri_predict.contracts.link import AnyLinkClass, Link, LinkSettings
from hri_predict.library.conformance.wire import Wire, units_of
from hri_predict.protocol.messages import Message

RATE_HZ = 25.0
STEP_NS = 40_000_000


@dataclass
class LinkPart:
    """A kind of link to check, and its settings."""

    cls: AnyLinkClass
    settings: LinkSettings
    clock: VirtualClock = field(default_factory=lambda: VirtualClock(1_000_000_000))

    def make(self) -> tuple[Link, Wire]:
        """Return a new link for two robots, not yet started, and its wire."""
        wire = Wire()
        return self.cls(self.settings, self.clock, wire, rate_hz=RATE_HZ, robots=(0, 1)), wire

    def run(self, link: Link, seconds: float) -> None:
        """Service a link for some time."""
        for _ in range(max(1, round(seconds * 1e9) // STEP_NS)):
            self.clock.advance_to(self.clock.now_ns() + STEP_NS)
            link.service(self.clock.now_ns())

    def decoded(self, units: list[object]) -> list[Message]:
        """Return the messages that a listener decodes from these units."""
        receiver = self.cls.receiver(self.settings)
        return [message for unit in units for message in receiver.feed(unit)]

    def units(self, message: Message) -> list[object]:
        """Return the units that a new link writes for a message."""
        return units_of(self.cls, self.settings, self.clock, message)
