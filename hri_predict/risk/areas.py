"""Areas of the room: the named zones configured by the user, and the sensor's field of view."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.geometry import Capsules, in_polygon, segment_distance
from hri_predict.base.quantities.safe_side import LessSafe, Safety
from hri_predict.base.settings import MIN_SPEED_M_S, Name, Region
from hri_predict.risk.permitted import NEAR_M, REACH_SPEED_M_S, WALK_SPEED_M_S
from hri_predict.risk.types import NamedZoneState
from hri_predict.zones.body_zones import BodyZones

FLOOR_M = 0.05
"""Minimum height of people above the floor; a view down to this height includes the floor."""
TOUCH_M = 1e-9
"""Smaller distances are treated as contact; intersections are not exact to the last bit."""
TOP_M = 2.5
"""Maximum height above the floor that people reach (a tall man's grip is at 2.2 m); a view up to
here sees all."""


class NamedZoneSettings(Region):
    """A named zone (an entry of ``zones:``) and its requests to robots.

    ``occupied`` regards the bodies as captured, widened by ``person_uncertainty_m``, and, if the
    newest scenes lack a person, by how far people can have come since then. A predicted
    entry carries no guarantee: it uses the forecast body, enclosed over each step but not enlarged.
    With ``entry: zone`` it uses the zones, which contain every possible position of the body.
    Without a forecast (it failed, or the person is lost) both use the zones. Past the last
    calibrated step (shipped: 1.2 s) the forecast body stands still.
    """

    name: Name = Field(description="its own name, for messages and alerts")
    level: Literal["none", "warn", "slow", "stop"] = Field(
        "warn", description="request to robots while the zone is occupied"
    )
    robots: list[str] | None = Field(
        None, description="robots that the zone applies to; default: all"
    )
    speed_limit_m_s: float = Field(
        0.25,
        ge=MIN_SPEED_M_S,
        le=10,
        description="speed limit of level slow; 0.25 m/s is reduced speed (ISO 10218-1)",
    )
    entry: Literal["forecast", "zone"] = Field(
        "forecast",
        description="basis for predicting an entry: the forecast body, or the zone around it",
    )
    entry_warning_s: float = Field(
        0.0,
        ge=0,
        le=10,
        description="time before a predicted entry at which robots receive the request",
    )

    safety: ClassVar[Safety] = {
        "speed_limit_m_s": LessSafe(
            above="robots move at up to {value:g} m/s while a person is inside"
        ),
        "entry_warning_s": LessSafe(below="robots receive the request {more:g} s later"),
    }


class _Outline:
    """The polygon of a region, prepared for distance computations in the plane."""

    def __init__(self, region: Region) -> None:
        corners = np.asarray(region.polygon, dtype=np.float64)
        self.start = np.column_stack([corners, np.zeros(len(corners))])
        self.end = np.roll(self.start, -1, axis=0)
        self.low, self.high = corners.min(0), corners.max(0)

    def contains(self, points: Floats) -> Bools:
        """Whether each of the (..., 2) points is inside (even-odd rule)."""
        return in_polygon(points, self.start[:, :2])

    def edge_distance(self, capsules: Capsules) -> Floats:
        """Distance in the plane from each capsule's axis (...,) to the nearest edge."""
        flat = np.array([1.0, 1.0, 0.0])
        a, b = capsules.a[..., None, :] * flat, capsules.b[..., None, :] * flat
        distance: Floats = segment_distance(a, b, self.start, self.end).min(-1)
        return distance


class NamedZone:
    """A named zone and the check for people in it.

    Args:
        settings: see ``NamedZoneSettings``.
        person_uncertainty_m: uncertainty of a body's position, metres.
        stale_s: age of a capture from which on people may have moved on unseen.
    """

    def __init__(
        self, settings: NamedZoneSettings, person_uncertainty_m: float, *, stale_s: float
    ) -> None:
        self.settings = settings
        self._stale_s = stale_s
        self._outline = _Outline(settings)
        self._margin = person_uncertainty_m

    def occupied(self, capsules: Capsules) -> Bools:
        """Return whether each capsule (...,) may touch the prism; no contact is missed.

        The test uses the full height range of the capsule along its whole length, so it can only
        overestimate. A capsule that is not finite touches the prism.
        """
        result = ~self._far(capsules)
        near = np.nonzero(result)
        if not len(near[0]):
            return result
        few = Capsules(capsules.a[near], capsules.b[near], capsules.radius[near] + self._margin)
        inside = self._outline.contains(few.a[:, :2]) | self._outline.contains(few.b[:, :2])
        touches: Bools = inside | ~(self._outline.edge_distance(few) > few.radius + TOUCH_M)
        result[near] = touches
        return result

    def state(self, bodies: BodyZones) -> NamedZoneState:
        """Return whether a person is inside now, and when one may first enter."""
        zones = bodies.zones.capsules
        now = zones[:, 0]
        late_s = max(bodies.age_s - self._stale_s, 0.0)
        human_m_s = bodies.speeds.beyond_standard_m_s.max(1, initial=0.0)  # 0: as assumed
        grown_m = np.maximum(WALK_SPEED_M_S, human_m_s)[:, None] * late_s
        if self.occupied(Capsules(now.a, now.b, now.radius + grown_m)).any():
            return NamedZoneState(self.settings.name, True, 0.0)
        bodies_then = zones if self.settings.entry == "zone" else bodies.paths
        entered = np.flatnonzero(self.occupied(bodies_then)[:, 1:].any(axis=(0, 2)))
        if not entered.size:
            return NamedZoneState(self.settings.name, False, None)
        begins = bodies.zones.times_s[entered[0]]
        return NamedZoneState(self.settings.name, False, float(begins))

    def _far(self, capsules: Capsules) -> Bools:
        """Return whether each capsule's bounding box is outside the bounding box of the prism."""
        radius = (capsules.radius + self._margin)[..., None]
        low = np.minimum(capsules.a, capsules.b) - radius
        high = np.maximum(capsules.a, capsules.b) + radius
        prism_low = np.append(self._outline.low, self.settings.z_min)
        prism_high = np.append(self._outline.high, self.settings.z_max)
        far: Bools = np.any((high < prism_low) | (low > prism_high), axis=-1)
        return far


@dataclass(frozen=True, slots=True, eq=False)
class FieldOfView:
    """Space that the sensor sees; all other space is treated as occupied.

    An unseen person may stand just outside the view and enter at the speeds of ISO 13855. Because
    people stand on the floor, no person is more than ``TOP_M`` or less than ``FLOOR_M`` above it.
    """

    region: Region
    floor_m: float
    _outline: _Outline

    @classmethod
    def of(cls, region: Region, floor_m: float) -> "FieldOfView":
        """The field of view that ``region`` describes; the floor is at z = ``floor_m``."""
        return cls(region, floor_m, _Outline(region))

    def distance_outside(self, capsules: Capsules) -> Floats:
        """Return the distance (...,) of each capsule to unseen space; <= 0: it is inside."""
        outline = self._outline
        inside = outline.contains(capsules.a[..., :2]) & outline.contains(capsules.b[..., :2])
        edge = outline.edge_distance(capsules)
        crosses = edge <= TOUCH_M
        distance = np.where(inside & ~crosses, edge, 0.0)
        if self.region.z_max < self.floor_m + TOP_M:
            top = np.maximum(capsules.a[..., 2], capsules.b[..., 2])
            distance = np.minimum(distance, self.region.z_max - top)
        if self.region.z_min > self.floor_m + FLOOR_M:
            bottom = np.minimum(capsules.a[..., 2], capsules.b[..., 2])
            distance = np.minimum(distance, bottom - self.region.z_min)
        return distance - capsules.radius


def floor_distance(region: Region, point: Floats) -> float:
    """Return the horizontal distance, m, from a point (3,) to a region; 0 inside."""
    outline, at = _Outline(region), np.asarray(point, dtype=np.float64)[None]
    if outline.contains(at[:, :2])[0]:
        return 0.0
    return float(outline.edge_distance(Capsules(at, at, np.zeros(1)))[0])


def approach_m(time_s: Floats) -> Floats:
    """Return an unseen person's maximum approach: 2.0 m/s up to 0.5 m, then 1.6 m/s (ISO 13855)."""
    near, walk = REACH_SPEED_M_S * time_s, WALK_SPEED_M_S * time_s
    return np.minimum(near, np.maximum(NEAR_M, walk))


def check_zones(zones: Sequence[NamedZoneSettings], robots: Sequence[str]) -> None:
    """Refuse duplicate zone names and unknown robots.

    Raises:
        ConfigError: one line with the remedy.
    """
    names: set[str] = set()
    for zone in zones:
        if zone.name in names:
            raise ConfigError(f"zones: two zones are named '{zone.name}'; give each its own name")
        names.add(zone.name)
        for robot in zone.robots or ():
            if robot not in robots:
                raise ConfigError(
                    f"zones: zone {zone.name} names the unknown robot '{robot}'"
                    f"{nearest(robot, robots)} (known: {', '.join(robots)})"
                )
