"""The result of one tick, and the contract of the listeners that receive it."""

from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.contracts.link import Received
from hri_predict.contracts.predictor import Forecast
from hri_predict.contracts.scene import Scene
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Advice, Message, Status
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import Assessment, Grounds, NamedZoneState


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """The results of one tick, for publisher and listeners (recorder, alerts, viewer).

    ``snapshot`` and ``assessment`` are ``None`` if their stage failed.
    """

    now_ns: int
    status: Status
    advices: tuple[Advice, ...]
    snapshot: PeopleSnapshot | None = None
    forecast: Forecast | None = None
    assessment: Assessment | None = None
    messages: tuple[Message, ...] = ()

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Reasons from the scene, then all others."""
        scene = () if self.snapshot is None else self.snapshot.reasons
        return (*scene, *(() if self.assessment is None else self.assessment.reasons))

    @property
    def named_zones(self) -> Sequence[NamedZoneState]:
        """State of each named zone."""
        return () if self.assessment is None else self.assessment.named_zones

    def grounds(self, robot: int) -> Grounds | None:
        """Return the basis of a robot's advice."""
        known = () if self.assessment is None else self.assessment.grounds
        return known[robot] if robot < len(known) else None


class Listener:
    """Observes the node without affecting it; every method is optional and must not block."""

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        """Receive a scene that arrived at the node."""

    def on_received(self, link: str, received: Received) -> None:
        """Receive a controller's message that arrived at the node."""

    def on_tick(self, tick: Tick) -> None:
        """Receive the results of a tick."""
