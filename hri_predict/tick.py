"""What one tick found, and the contract of those who listen beside the way."""

from dataclasses import dataclass

from hri_predict.link import Received
from hri_predict.predictors.base import Forecast
from hri_predict.protocol.messages import Advice, Message, Status
from hri_predict.risk.types import Assessment
from hri_predict.scene import Scene
from hri_predict.snapshot import PeopleSnapshot


@dataclass(frozen=True, slots=True)
class Tick:
    """Everything that one tick found: what listeners (recorder, alerts, viewer) get.

    ``snapshot`` and ``assessment`` are ``None`` where their stage failed.
    """

    now_ns: int
    status: Status
    advices: tuple[Advice, ...]
    snapshot: PeopleSnapshot | None
    forecast: Forecast | None
    assessment: Assessment | None
    messages: tuple[Message, ...]


class Listener:
    """Listens beside the way; every method is optional and must not block."""

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        """A scene was received."""

    def on_received(self, link: str, received: Received) -> None:
        """A controller's message was received."""

    def on_tick(self, tick: Tick) -> None:
        """A tick is over."""
