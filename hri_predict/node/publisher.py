"""Writes status, advice, zones and poses as messages into every link's newest-wins slots."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import starmap

from hri_predict.contracts.link import Link
from hri_predict.contracts.predictor import Forecast, Predictor
from hri_predict.node.listeners import Tick
from hri_predict.node.publish_phase import PublishPhase
from hri_predict.node.repeats import Repeats
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    OperatingMode,
    Pose,
    Schema,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.zones.types import Zones

SCHEMA_PERIOD_NS = 1_000_000_000


class Publisher:
    """Posts each tick's messages to every link.

    In shadow mode the links send *unknown*, regardless of the advice.

    Attributes:
        repeats: repeats Status and Advice until the next tick.
        phase: holds messages until a fixed time after the tick's deadline, or ``None``.
    """

    def __init__(
        self,
        links: Sequence[Link],
        advised: Sequence[frozenset[int]],
        predictor: Predictor,
        shadow: bool,
        *,
        repeats: Repeats | None = None,
        phase: PublishPhase | None = None,
    ) -> None:
        self.repeats = repeats or Repeats(links)
        self.phase = phase
        self._ranks: dict[int, int] = {}  # of each robot's newest advice
        self._advised = advised  # per link: indices of the robots advised on it
        self._shadow = shadow
        self._forecast_rate_hz = predictor.rate_hz
        self._segments = {name: i for i, name in enumerate(predictor.skeleton.segment_names)}
        self._schema_due_ns: int | None = None

    def publish(
        self, tick: Tick, leaves_out: Callable[[type[Message]], bool] = lambda _: False
    ) -> list[Message]:
        """Post to every link, except kinds that are left out; return all messages, each once."""
        messages: list[Message] = [self._as_told(a) for a in tick.advices]
        messages.append(tick.status)
        if self._schema_due_ns is None or tick.now_ns >= self._schema_due_ns:
            self._schema_due_ns = tick.now_ns + SCHEMA_PERIOD_NS
            messages.append(Schema(SCHEMA_VERSION, SCHEMA_HASH))
        if tick.snapshot is not None and not self._shadow:
            if tick.assessment is not None and not leaves_out(Zone):
                messages += self._zones(tick.assessment.zones, tick.snapshot)
            if tick.forecast is not None and not leaves_out(Pose):
                messages += self._poses(tick.forecast, tick.snapshot)
        of_links = [
            [m for m in messages if not isinstance(m, Advice) or m.robot in robots]
            for robots in self._advised
        ]
        if self.phase is not None:
            people = tick.snapshot is not None and bool(tick.snapshot.ids)
            self.phase.hold(learn=people, urgent=self._is_urgent(tick))
        self.repeats.post(tick.now_ns, of_links)
        return messages

    def _is_urgent(self, tick: Tick) -> bool:
        """Whether an advice is more severe than the one before: it must not wait."""
        before = self._ranks
        self._ranks = {advice.robot: advice.level.rank for advice in tick.advices}
        return any(rank > before.get(robot, -1) for robot, rank in self._ranks.items())

    def _as_told(self, advice: Advice) -> Advice:
        if not self._shadow:
            return advice
        return replace(
            advice,
            level=Level.UNKNOWN,
            reason=Reason.SHADOW_MODE,
            speed_limit_m_s=0.0,
            latch_id=0,
            mode=OperatingMode.AUTOMATIC,
        )

    def _zones(self, zones: Zones, snapshot: PeopleSnapshot) -> list[Zone]:
        """Return the zone of each person at the horizons that links can carry."""
        if snapshot.newest_capture_ns is None:
            return []
        tracked = snapshot.capture_ns.tolist()  # people in the order of the zones, then lost ones
        segments = [self._segments[name] for name in zones.segments]  # without absent parts
        messages = []
        for step in _decimated(len(zones.times_s)):
            a, b, radius = (  # plain lists: reading single elements of an array is slow
                part[:, step].tolist()
                for part in (zones.capsules.a, zones.capsules.b, zones.capsules.radius)
            )
            for p, person in enumerate(zones.ids):
                starts, ends = map(tuple, a[p]), map(tuple, b[p])
                rows = zip(segments, starts, ends, radius[p], strict=True)
                capsules = tuple(starmap(ZoneCapsule, rows))
                capture_ns = tracked[p] if p < len(tracked) else snapshot.newest_capture_ns
                age_s = (snapshot.now_ns - capture_ns) * 1e-9
                # on the wire horizons count from the capture; step 0 is the body at that moment
                horizon_s = float(zones.times_s[step]) + age_s if step else 0.0
                messages.append(
                    Zone(
                        person=person,
                        step=step,
                        horizon_s=horizon_s,
                        capsules=capsules,
                        age_s=None,
                        capture_ns=capture_ns,
                    )
                )
        return messages

    def _poses(self, forecast: Forecast, snapshot: PeopleSnapshot) -> list[Pose]:
        messages = []
        for step in _decimated(forecast.positions.shape[1]):
            positions = forecast.positions[:, step].tolist()
            horizon_s = (step + 1) / self._forecast_rate_hz
            for p, person in enumerate(snapshot.ids):
                joints = tuple((j, x, y, z) for j, (x, y, z) in enumerate(positions[p]))
                capture_ns = int(snapshot.capture_ns[p])
                messages.append(
                    Pose(
                        person=person,
                        step=step + 1,
                        horizon_s=horizon_s,
                        joints=joints,
                        age_s=None,
                        capture_ns=capture_ns,
                    )
                )
        return messages


def _decimated(steps: int) -> list[int]:
    """Return the first, middle and last step, which a controller needs and links can carry."""
    return sorted({0, steps // 2, steps - 1}) if steps else []
