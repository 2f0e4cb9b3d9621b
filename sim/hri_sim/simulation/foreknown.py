"""The bound that no predictor can exceed: zones that hold exactly the true future.

With these zones neither forecast errors nor radii cause lost work. The robot loses work only
because a body is truly there, or because it cannot stop and start as fast as people come and go.
The distance from ``predictive`` to this bound is what a better forecast could still gain.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules
from hri_predict.contracts.source import Source
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.body_zones import BodyZones
from hri_sim.referee import TruePeople

GRID_NS = 10_000_000
"""Grid of times for the true bodies; a walking body moves by 15 mm in 10 ms."""


class TrueFuture:
    """The true future positions of all people, on a grid of times.

    Args:
        source: a copy of the node's source, not yet open.
        start_ns, end_ns: the time to cover; before and after it people stand still.
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
    """Return the zones of each tick, as narrow as the bodies themselves.

    Args:
        snapshots: (K) ticks.
        zones: (K) the node's zones; those of lost people stay unchanged.
        future: the true future.
    """
    return [
        bodies if snapshot.lost else _narrow(snapshot, bodies, future)
        for snapshot, bodies in zip(snapshots, zones, strict=True)
    ]


def _narrow(snapshot: PeopleSnapshot, bodies: BodyZones, future: TrueFuture) -> BodyZones:
    """Move captured capsules: each end follows the joint that was nearest to it."""
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
    return replace(bodies, zones=replace(zones, capsules=Capsules(a, b, radius)))
