"""Distance and angle of the nearest person from a robot's base, as safety radars report them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import Zone, ZoneCapsule

KEPT_NS = 250_000_000
"""Maximum time since a person's last zone, sent once a cycle; afterwards the place is unknown."""


class Seen(NamedTuple):
    """A person relative to a robot: distance (m) in the base's x-y plane, angle (rad) from its
    x."""

    person: int
    distance_m: float
    angle_rad: float
    age_s: float


def seen_from(base_from_room: Floats, capsules: Sequence[ZoneCapsule]) -> tuple[float, float]:
    """Distance (m) and angle (rad) of the nearest point of some capsules.

    Args:
        base_from_room: (4, 4).
        capsules: in the room's frame; at least one.
    """
    ends = np.array([(c.a, c.b) for c in capsules], dtype=np.float64)
    flat = (ends @ base_from_room[:3, :3].T + base_from_room[:3, 3])[..., :2]
    a, along = flat[:, 0], flat[:, 1] - flat[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(-(a * along).sum(axis=1) / length, 0.0, 1.0)
    points = a + share[:, None] * along
    distances = np.hypot(points[:, 0], points[:, 1]) - [c.radius for c in capsules]
    k = int(distances.argmin())  # the first that is not a number, if there is one
    return float(np.maximum(distances[k], 0.0)), math.atan2(points[k, 1], points[k, 0])


@dataclass(frozen=True, slots=True)
class _Kept:
    seen: Seen
    came_ns: int


class Nearest:
    """The person nearest to one robot's base, from the zones of all persons.

    Args:
        base: pose of the base in the room; ``None``: not known.
    """

    def __init__(self, base: Pose | None) -> None:
        self._base_from_room: Floats | None = None
        if base is not None:
            self._base_from_room = np.linalg.inv(base.matrix()).astype(np.float64)
        self._kept: dict[int, _Kept] = {}

    def take(self, zone: Zone, now_ns: int) -> None:
        """Process one person's zone at the capture; if it has NaN, the place is unknown."""
        if self._base_from_room is None or not zone.capsules:
            return
        with np.errstate(all="ignore"):
            distance_m, angle_rad = seen_from(self._base_from_room, zone.capsules)
        if not math.isfinite(distance_m + angle_rad):
            self._kept.pop(zone.person, None)
            return
        age_s = math.inf if zone.age_s is None else zone.age_s
        seen = Seen(zone.person, distance_m, angle_rad, age_s)
        self._kept[zone.person] = _Kept(seen, now_ns)

    def at(self, people: int, now_ns: int) -> Seen | None:
        """Return the nearest of ``people`` persons; ``None`` if the place of one is not known."""
        fresh = {p: k for p, k in self._kept.items() if now_ns - k.came_ns < KEPT_NS}
        self._kept = fresh
        if not fresh or len(fresh) < people:
            return None
        nearest = min(fresh.values(), key=lambda kept: kept.seen.distance_m)
        waited_s = (now_ns - nearest.came_ns) * 1e-9
        return nearest.seen._replace(age_s=nearest.seen.age_s + waited_s)
