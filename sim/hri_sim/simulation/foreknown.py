"""The bound that no predictor can pass: zones that hold the true future and nothing else.

What a mode does with them is lost neither to the forecast's errors nor to its radii: a body truly
is there, or the robot cannot stop and start as fast as people come and go. The distance from
``predictive`` to this bound is what a better forecast could still bring.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hri_predict.risk.types import Capsules
from hri_predict.risk.zones import BodyZones
from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import Skeleton
from hri_predict.snapshot import PeopleSnapshot
from hri_predict.source import Source
from hri_sim.referee import TruePeople

GRID_NS = 10_000_000
"""The true bodies are looked up on this grid; in 10 ms a walking body moves by 15 mm."""


class TrueFuture:
    """Where everybody will be, on a grid of times.

    Args:
        source: a copy of the one that the node sees, not yet open.
        start_ns, end_ns: the time that is wanted; before and after it people stay where they are.
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
        """id -> canonical joints (J, 3) and which are known (J,)."""
        index = round((now_ns - self._start_ns) / GRID_NS)
        return self._people[min(max(index, 0), len(self._people) - 1)]


def foreknown(
    snapshots: Sequence[PeopleSnapshot],
    zones: Sequence[BodyZones],
    future: TrueFuture,
    skeleton: Skeleton,
) -> list[BodyZones]:
    """The zones of each tick, as narrow as the bodies themselves.

    Args:
        snapshots: (K) ticks.
        zones: (K) as the node has them; what is captured, lost or never observed stays so.
        future: what will be.
        skeleton: of the zones.
    """
    return [
        bodies if snapshot.lost else _narrow(snapshot, bodies, future, skeleton)
        for snapshot, bodies in zip(snapshots, zones, strict=True)
    ]


def _narrow(
    snapshot: PeopleSnapshot, bodies: BodyZones, future: TrueFuture, skeleton: Skeleton
) -> BodyZones:
    zones = bodies.zones
    segments = {s.name: s for s in skeleton.segments}
    chosen = [segments[name] for name in zones.segments]
    a, b = [s.joint_a for s in chosen], [s.joint_b for s in chosen]
    thick = np.array([s.radius for s in chosen])
    own = zones.capsules
    capsules = Capsules(own.a.copy(), own.b.copy(), own.radius.copy())
    instants = [future.at(snapshot.now_ns + round(t * 1e9)) for t in zones.times_s]
    for i, person in enumerate(zones.ids):
        for k in range(1, len(instants)):
            if person not in instants[k - 1] or person not in instants[k]:
                continue
            (begin, known), (end, known_then) = instants[k - 1][person], instants[k][person]
            middle, moved = 0.5 * (begin + end), 0.5 * np.linalg.norm(end - begin, axis=-1)
            sure = (known & known_then)[a] & (known & known_then)[b]
            capsules.a[i, k, sure] = middle[a][sure]
            capsules.b[i, k, sure] = middle[b][sure]
            capsules.radius[i, k, sure] = (thick + np.maximum(moved[a], moved[b]))[sure]
    return replace(bodies, zones=replace(zones, capsules=capsules))
