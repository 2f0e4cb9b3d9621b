"""The share of each delay, zone and margin in the working distance of one cell.

Each term is removed from the cell, and the working distance is measured again. The cost of a term
depends on the other terms: a second of delay costs more where zones grow fast. So the terms are
removed one after the other in this order and in reverse order, and the cost of each is the mean of
both. The means and the rest add up to the working distance.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules
from hri_predict.base.skeleton import Skeleton
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.robots.model import StateMotion
from hri_predict.robots.tracker import RobotNow
from hri_predict.run.config import Config
from hri_predict.run.working_distance.measure import Measure, Situation
from hri_predict.run.working_distance.seen import Seen
from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.toward import Toward

LEAST_STRETCH = 1e-6
"""Factor of the stopping time that removes the robot's stopping."""
NEXT_M = 0.2
"""Initial search range: most terms cost less than this."""
_SOON_M_S2 = 1e3  # the limit rises at once


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One term.

    Attributes:
        key: its name for programs.
        text: description.
    """

    key: str
    text: str


TERMS = (
    Term(key="silence_timeout", text="the controller's silence timeout"),
    Term(key="reaction", text="the controller's reaction"),
    Term(key="link_delay", text="the link's delay"),
    Term(key="cycle", text="the node's cycle and encoding"),
    Term(key="age", text="the age of the input"),
    Term(key="stopping", text="the robot's stopping"),
    Term(key="unseen", text="zones of unobserved joints"),
    Term(key="seen", text="zones of observed joints"),
    Term(key="margins", text="margins: C, Z_d, Z_r, slow_margin_m, band_m, region_margins_m"),
    Term(key="place", text="the position error reported by the tracker"),
    Term(key="release", text="the wait before a release"),
    Term(key="robot_state", text="the age of the robot's state"),
)
"""All terms, in the order in which they are removed."""


def rest_text(mode: str) -> str:
    """Return what is left of the working distance in a risk mode without any term."""
    if mode == "fixed":
        return "the circle (risk.fixed_radius_m) and the body itself"
    return "the robot's reach and the body itself"


Watch = Callable[[bool, bool], tuple[Situation, Seen]]
"""(whether all joints are seen, whether captures are fresh) -> the cell and the person in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Waterfall:
    """The working distance and its parts.

    Attributes:
        total_m: the working distance; ``None``: above ``measure.FARTHEST_M``, and its parts
            unknown.
        costs_m: cost of each term, by ``Term.key``.
        rest_m: the rest without any term, see ``rest_text``.
    """

    total_m: float | None
    costs_m: dict[str, float]
    rest_m: float


def waterfall(
    watch: Watch, middle: Floats, *, step: float = 0.01, leaves: Sequence[str] = ()
) -> Waterfall:
    """Measure the waterfall of one person in one cell.

    Args:
        watch: observes the person as the cell's node would.
        middle: (2,) see ``Measure``.
        step: resolution of the distances, metres.
        leaves: keys of terms that are not removed.
    """
    cells = _Cells(watch, middle)
    total_m = cells.measure(()).distance_m(step=step)
    if total_m is None:
        return Waterfall(total_m=None, costs_m={}, rest_m=0.0)
    keys = [t.key for t in TERMS if t.key not in leaves and cells.counts(t.key)]
    found_m = cells.measure(keys).distance_m(low=total_m / 2, high=total_m, step=step)
    rest_m = total_m if found_m is None else min(found_m, total_m)
    costs_m = {term.key: 0.0 for term in TERMS}
    for order in (keys, keys[::-1]):
        before_m = total_m
        for i, key in enumerate(order, start=1):
            after_m: float | None = rest_m
            if i < len(order) and before_m > rest_m:  # otherwise no term is left that costs much
                near_m = max(rest_m, before_m - NEXT_M)
                measure = cells.measure(order[:i])
                after_m = measure.distance_m(low=near_m, high=before_m, step=step)
            # the search has a resolution; without a term the distance is not greater
            after_m = before_m if after_m is None else min(max(after_m, rest_m), before_m)
            costs_m[key] += (before_m - after_m) / 2
            before_m = after_m
    return Waterfall(total_m=total_m, costs_m=costs_m, rest_m=rest_m)


class _Cells:
    """The cell without some terms."""

    def __init__(self, watch: Watch, middle: Floats) -> None:
        self._watch, self._middle = watch, middle
        self._seen: dict[tuple[bool, bool], tuple[Situation, Seen, list[BodyZones]]] = {}
        self._robots: dict[tuple[bool, bool], list[list[RobotNow]]] = {}

    def counts(self, key: str) -> bool:
        """Return whether a term has any effect in this cell."""
        situation, seen, _ = self._looked(False, False)
        if key == "link_delay":
            return any(link.delay_s > 0 for link in situation.budget.links)
        if key in ("silence_timeout", "reaction"):
            return bool(situation.budget.links)
        if key == "unseen":
            return not all(s.measured[:, -1].all() for s in seen.snapshots)
        if key == "place":
            return any(s.all_errors_m.any() for s in seen.snapshots)
        return key != "seen" or situation.config.node.risk.judges_over_time

    def _looked(self, whole: bool, fresh: bool) -> tuple[Situation, Seen, list[BodyZones]]:
        if (whole, fresh) not in self._seen:
            situation, seen = self._watch(whole, fresh)
            self._seen[whole, fresh] = situation, seen, situation.zones(seen)
        return self._seen[whole, fresh]

    def measure(self, taken: Iterable[str]) -> Measure:
        """Return the measurement without the removed terms."""
        gone = set(taken)
        fresh = "age" in gone
        situation, seen, zones = self._looked("unseen" in gone, fresh)
        if "unseen" in gone:
            zones = only_seen(situation.predictor.skeleton, seen, zones)
        if "seen" in gone:
            zones = [_without_growth(bodies) for bodies in zones]
        if "margins" in gone:
            zones = [_thinner(bodies, bodies.margins_m) for bodies in zones]
        if "place" in gone:
            zones = [
                _thinner(bodies, None if bodies.errors_m is None else bodies.errors_m[:, None])
                for bodies in zones
            ]
        changed = replace(
            situation,
            config=_config(situation.config, gone),
            budget=_budget(situation.budget, gone),
            stretch=LEAST_STRETCH if "stopping" in gone else situation.stretch,
            state_s=0.0 if "robot_state" in gone else situation.state_s,
        )
        how = fresh, "robot_state" in gone
        if how not in self._robots:
            self._robots[how] = changed.robots(seen)
        return Measure(changed, seen, zones=zones, robots=self._robots[how], middle=self._middle)


def _config(config: Config, gone: set[str]) -> Config:
    risk, robots = config.node.risk, config.node.robots
    changes: dict[str, object] = {}
    if "margins" in gone:
        none = ("intrusion_m", "person_uncertainty_m", "robot_uncertainty_m", "slow_margin_m")
        changes |= dict.fromkeys((*none, "band_m"), 0.0)
        changes["contact"] = risk.contact.model_copy(update={"slow_margin_m": 0.0})
    if "release" in gone:
        changes |= {"release_captures": 1, "speed_rise_m_s2": _SOON_M_S2}
    if "robot_state" in gone:
        exact = {"delay_s": 0.0, "acceleration_m_s2": 0.0}
        robots = [
            r.model_copy(update={"motion": r.motion.model_copy(update=exact)})
            if isinstance(r.motion, StateMotion)
            else r
            for r in robots
        ]
    node = config.node.model_copy(
        update={"risk": risk.model_copy(update=changes), "robots": robots}
    )
    return replace(config, node=node)


def _budget(budget: DelayBudget, gone: set[str]) -> DelayBudget:
    of_links = {
        "silence_timeout": "silence_timeout_s",
        "reaction": "reaction_s",
        "link_delay": "delay_s",
    }
    none: dict[str, Any] = {name: 0.0 for key, name in of_links.items() if key in gone}
    links = tuple(replace(link, **none) for link in budget.links)
    cycle: dict[str, Any] = {"encoding_s": 0.0, "cycle_s": 0.0} if "cycle" in gone else {}
    return replace(budget, links=links, **cycle)


def only_seen(skeleton: Skeleton, seen: Seen, zones: Sequence[BodyZones]) -> list[BodyZones]:
    """Return the zones (K), where those of segments with both ends measured replace all others."""
    by_name = dict(zip(skeleton.segment_names, skeleton.segments, strict=True))
    segments = [by_name[name] for name in zones[0].zones.segments]
    a, b = [s.joint_a for s in segments], [s.joint_b for s in segments]
    return [
        _chosen(bodies, snapshot.measured[:, -1][:, a] & snapshot.measured[:, -1][:, b])
        for snapshot, bodies in zip(seen.snapshots, zones, strict=True)
    ]


def _chosen(bodies: BodyZones, measured: Bools) -> BodyZones:
    """Return zones in which measured segments replace the unmeasured ones (P, S)."""
    zones, toward = bodies.zones.capsules, bodies.toward
    a, b, radius = zones.a.copy(), zones.b.copy(), zones.radius.copy()
    if toward is not None:
        toward = toward._replace(ends=toward.ends.copy(), extra=toward.extra.copy())
    for person, seen in enumerate(measured):
        if seen.any():
            chosen = np.where(seen, np.arange(len(seen)), int(seen.argmax()))
            for each in (a, b, radius):
                each[person] = each[person][:, chosen]
            if toward is not None:
                toward.ends[person] = toward.ends[person][chosen]
                toward.extra[person] = toward.extra[person][chosen]
    return _with(bodies, Capsules(a, b, radius), toward)


def _without_growth(bodies: BodyZones) -> BodyZones:
    """Return zones that keep the thickness of the captured body at every time."""
    zones = bodies.zones.capsules
    radius = np.broadcast_to(zones.radius[:, :1], zones.radius.shape).copy()
    return _with(bodies, Capsules(zones.a, zones.b, radius), None)


def _thinner(bodies: BodyZones, by_m: Floats | None) -> BodyZones:
    """Return zones without the amount added to the radii: (S,) per segment, or (P, 1) per
    person.
    """
    if by_m is None:
        return bodies
    zones, toward = bodies.zones.capsules, bodies.toward
    by_m = np.broadcast_to(by_m, zones.radius[:, 0].shape)
    if toward is not None:
        toward = toward._replace(extra=toward.extra - by_m[: len(toward.extra)])
    return _with(bodies, Capsules(zones.a, zones.b, zones.radius - by_m[:, None]), toward)


def _with(bodies: BodyZones, capsules: Capsules, toward: Toward | None) -> BodyZones:
    return replace(bodies, zones=replace(bodies.zones, capsules=capsules), toward=toward)
