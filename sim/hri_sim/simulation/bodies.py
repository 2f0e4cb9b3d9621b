"""The node's knowledge of people, tick by tick: computed once per motion, then moved to each place.

Forecasts and zones depend neither on robots nor on a motion's place on the floor: the stages are
equivariant under turns about z and moves over the floor. Each motion therefore runs once through
the real stages in its own frame, and an episode moves the results.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.clock import VirtualClock
from hri_predict.base.geometry import Capsules, transform
from hri_predict.contracts.source import Source
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.risk.engine import RiskEngine
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.run.working_distance.seen import moved_zones, watch
from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.human_speed import joined_speeds
from hri_predict.zones.toward import Toward
from hri_sim.referee import TruePeople
from hri_sim.simulation.approach import ApproachSource, exact
from hri_sim.simulation.cell import Cell, Variant

# -- the bound that no predictor can exceed: zones that hold exactly the true future ---------------
#
# With these zones neither forecast errors nor radii cause lost work. The robot loses work only
# because a body is truly there, or because it cannot stop and start as fast as people come and
# go. The distance from ``predictive`` to this bound is what a better forecast could still gain.

GRID_NS = 10_000_000
"""Grid of times for the true bodies; a walking body moves by 15 mm in 10 ms."""


class TrueFuture:
    """The true future positions of all people, on a grid of times.

    Args:
        source: a copy of the node's source, not yet open.
        start_ns, end_ns: the time to cover; people stand still before and after it.
    """

    def __init__(self, source: Source, start_ns: int, end_ns: int) -> None:
        truth = TruePeople(source)
        truth.open(start_ns)
        self._start_ns = start_ns
        self._people: list[dict[int, tuple[Floats, Bools]]] = []
        for at_ns in range(start_ns, end_ns, GRID_NS):
            here = truth.at(at_ns)
            self._people.append(here or (self._people[-1] if self._people else {}))
        truth.close()

    def at(self, now_ns: int) -> dict[int, tuple[Floats, Bools]]:
        """Return id -> canonical joints (J, 3) and which are known (J,)."""
        index = round((now_ns - self._start_ns) / GRID_NS)
        return self._people[min(max(index, 0), len(self._people) - 1)]


def foreknown(
    snapshots: Sequence[PeopleSnapshot], zones: Sequence[BodyZones], future: TrueFuture
) -> list[BodyZones]:
    """Return zones for each tick that are as narrow as the bodies themselves.

    Args:
        snapshots: (K) ticks.
        zones: (K) the node's zones; zones of lost people stay unchanged.
        future: the true future.
    """
    return [
        bodies if snapshot.lost else _narrow(snapshot, bodies, future)
        for snapshot, bodies in zip(snapshots, zones, strict=True)
    ]


def _narrow(snapshot: PeopleSnapshot, bodies: BodyZones, future: TrueFuture) -> BodyZones:
    """Move captured capsules: each end follows the nearest joint at capture."""
    zones = bodies.zones
    own = zones.capsules
    a, b, radius = own.a.copy(), own.b.copy(), own.radius.copy()
    instants = [future.at(snapshot.now_ns + round(t * 1e9)) for t in zones.times_s]
    for i, (person, capture_ns) in enumerate(zip(zones.ids, snapshot.capture_ns, strict=True)):
        captured, known = future.at(int(capture_ns))[person]
        known = np.logical_and.reduce([known, *(at[person][1] for at in instants)])
        joints = np.array([at[person][0][known] for at in instants])  # (K+1, J, 3)
        middle, half = 0.5 * (joints[1:] + joints[:-1]), 0.5 * np.diff(joints, axis=0)
        moved = middle - captured[known]
        sideways = np.linalg.norm(half, axis=-1)
        spread = np.zeros_like(radius[i, 1:])
        for ends in (a[i], b[i]):
            apart = np.linalg.norm(ends[0][:, None] - captured[known], axis=-1)  # (S, J)
            nearest = apart.argmin(1)
            ends[1:] = ends[0] + moved[:, nearest]
            spread = np.maximum(spread, sideways[:, nearest])
        radius[i, 1:] = own.radius[i, 0] + spread
    return replace(bodies, zones=replace(zones, capsules=Capsules(a, b, radius)), toward=None)


# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MotionTicks:
    """K ticks of one motion or of several motions together.

    Attributes:
        snapshots: (K).
        forecasts: (K) of (P, H, J, 3); ``None`` without a forecast.
        zones: variant's name -> (K).
        nobody: (K) zones at the same ticks if the node had seen no person; empty: not computed.
    """

    snapshots: list[PeopleSnapshot]
    forecasts: list[Floats | None]
    zones: dict[str, list[BodyZones]]
    nobody: list[BodyZones] = field(default_factory=list)


def compute(
    *,
    cell: Cell,
    motions: Sequence[str],
    lead_in_s: float,
    variants: Sequence[Variant],
    places: Sequence[Sequence[float]] | None = None,
) -> MotionTicks:
    """Run people, predictor and zones over motions, as the node would.

    Args:
        cell: gives predictor and configuration.
        motions: the people's motions.
        lead_in_s: seconds of empty room before.
        variants: ways to judge risk, on which zones may depend.
        places: (x, y, yaw) of each motion; default: each in its own frame.
    """
    config = cell.config
    placed = [list(place) for place in places or [(0.0, 0.0, 0.0)] * len(motions)]
    settings = cell.source.model_copy(
        update={"motions": list(motions), "places": placed, "lead_in_s": lead_in_s}
    )
    clock = VirtualClock(VIRTUAL_START_NS)
    source = ApproachSource(settings, config.base_dir)
    seen = watch(config, source, cell.predictor)
    engines = engines_of(cell, source, clock, variants)
    (empty,) = engines_of(cell, source, clock, variants[:1]).values()
    found = MotionTicks(seen.snapshots, [], {name: [] for name in engines})
    for snapshot, forecast, reasons in seen.ticks():
        for name, engine in engines.items():
            found.zones[name].append(engine.zones(snapshot, forecast, reasons))
        found.forecasts.append(None if forecast is None else forecast.positions)
        found.nobody.append(empty.zones(without_people(snapshot), None))
    for name in (v.name for v in variants if v.is_foreknown):
        last_s = found.zones[name][-1].zones.times_s[-1]
        end_ns = found.snapshots[-1].now_ns + round(last_s * 1e9)
        source = ApproachSource(exact(settings), config.base_dir)
        future = TrueFuture(source, VIRTUAL_START_NS, end_ns)
        found.zones[name] = foreknown(found.snapshots, found.zones[name], future)
    return found


def engines_of(
    cell: Cell, source: ApproachSource, clock: VirtualClock, variants: Sequence[Variant]
) -> dict[str, RiskEngine]:
    """Return a risk engine for each variant.

    Raises:
        ConfigError: the source's rate or the configuration does not allow it.
    """
    return {v.name: cell.engine_of(v, source, cell.trackers(clock)) for v in variants}


def without_people(snapshot: PeopleSnapshot) -> PeopleSnapshot:
    """Return the snapshot of an empty room, without reasons to doubt that it is empty.

    Where a scene was doubted, the newest trusted capture may be stale: that is doubt, too.
    """
    return replace(
        snapshot,
        ids=(),
        history=snapshot.history[:0],
        observed=snapshot.observed[:0],
        capture_ns=snapshot.capture_ns[:0],
        last_positions=snapshot.last_positions[:0],
        joint_age_s=snapshot.joint_age_s[:0],
        lost=(),
        reasons=(),
        newest_capture_ns=snapshot.now_ns if snapshot.reasons else snapshot.newest_capture_ns,
        recent=None,
        inferred=None,
        errors_m=None,
    )


def moved(bodies: MotionTicks, matrix: Floats, person: int) -> MotionTicks:
    """Return the bodies after a rigid motion (4, 4), with every id raised by ``person``."""
    return MotionTicks(
        [_moved_snapshot(s, matrix, person) for s in bodies.snapshots],
        [None if f is None else transform(matrix, f) for f in bodies.forecasts],
        {name: [moved_zones(z, matrix, person) for z in zs] for name, zs in bodies.zones.items()},
        bodies.nobody,
    )


def joined(parts: Sequence[MotionTicks], lasts_ns: int) -> MotionTicks:
    """Combine separately computed people in one room, up to their last common capture.

    Args:
        parts: one person each.
        lasts_ns: time from the start to that capture, see ``approach.lasts_ns``.
    """
    if len(parts) == 1:
        return parts[0]
    shortest = min((part.snapshots for part in parts), key=len)
    count = sum(each.now_ns <= VIRTUAL_START_NS + lasts_ns for each in shortest)
    return MotionTicks(
        [_joined_snapshots([part.snapshots[k] for part in parts]) for k in range(count)],
        [_joined_forecasts([part.forecasts[k] for part in parts]) for k in range(count)],
        {
            name: [_joined_zones([part.zones[name][k] for part in parts]) for k in range(count)]
            for name in parts[0].zones
        },
    )


def _moved_snapshot(snapshot: PeopleSnapshot, matrix: Floats, person: int) -> PeopleSnapshot:
    return replace(
        snapshot,
        ids=tuple(i + person for i in snapshot.ids),
        history=transform(matrix, snapshot.history),
        last_positions=transform(matrix, snapshot.last_positions),
        recent=None,  # it served its purpose when the zones were built
        lost=tuple(
            replace(p, id=p.id + person, positions=transform(matrix, p.positions))
            for p in snapshot.lost
        ),
    )


def _joined_snapshots(parts: Sequence[PeopleSnapshot]) -> PeopleSnapshot:
    newest = [part.newest_capture_ns for part in parts]
    return replace(
        parts[0],
        ids=tuple(i for part in parts for i in part.ids),
        history=np.concatenate([part.history for part in parts]),
        observed=np.concatenate([part.observed for part in parts]),
        capture_ns=np.concatenate([part.capture_ns for part in parts]),
        last_positions=np.concatenate([part.last_positions for part in parts]),
        joint_age_s=np.concatenate([part.joint_age_s for part in parts]),
        lost=tuple(p for part in parts for p in part.lost),
        reasons=tuple(dict.fromkeys(r for part in parts for r in part.reasons)),
        recent=None,  # it served its purpose when the zones were built
        inferred=None,  # so did this
        newest_capture_ns=None if None in newest else min(n for n in newest if n is not None),
        captures=min(part.captures for part in parts),
        errors_m=np.concatenate([part.all_errors_m[: len(part.ids)] for part in parts]),
    )


def _joined_forecasts(parts: Sequence[Floats | None]) -> Floats | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def _joined_zones(parts: Sequence[BodyZones]) -> BodyZones:
    lost = np.concatenate([part.lost for part in parts])
    order = np.argsort(lost, kind="stable")  # lost people come last
    ids = [i for part in parts for i in part.zones.ids]
    captures = [p.capture_ns for p in parts if p.capture_ns is not None]
    zones = replace(
        parts[0].zones,
        ids=tuple(ids[i] for i in order),
        capsules=_joined_capsules([part.zones.capsules for part in parts], order),
    )
    return replace(
        parts[0],
        zones=zones,
        paths=_joined_capsules([part.paths for part in parts], order),
        lost=lost[order],
        age_s=max(part.age_s for part in parts),
        capture_ns=min(captures, default=None),
        reasons=tuple(dict.fromkeys(r for part in parts for r in part.reasons)),
        claimed=None,  # it served its purpose when the zones were built
        toward=_joined_toward([part.toward for part in parts if not part.lost.all()]),
        speeds=joined_speeds([part.speeds for part in parts]).of(order),
        segments_m_s=np.concatenate([part.segments_m_s for part in parts])[order],
        as_assumed=np.concatenate([part.as_assumed for part in parts])[order],
        untrusted=tuple(dict.fromkeys(r for part in parts for r in part.untrusted)),
        errors_m=np.concatenate([_errors_m(part) for part in parts])[order],
    )


def _errors_m(part: BodyZones) -> Floats:
    return np.zeros(len(part.lost)) if part.errors_m is None else part.errors_m


def _joined_toward(parts: Sequence[Toward | None]) -> Toward | None:
    known = [part for part in parts if part is not None]
    if not known or len(known) < len(parts):
        return None
    return Toward._make(np.concatenate(rows) for rows in zip(*known, strict=True))


def _joined_capsules(parts: Sequence[Capsules], order: NDArray[np.intp]) -> Capsules:
    return Capsules(
        np.concatenate([c.a for c in parts])[order],
        np.concatenate([c.b for c in parts])[order],
        np.concatenate([c.radius for c in parts])[order],
    )
