"""Cost of a joint map: growth of a standing body's zones if joints are missing."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.predictor import Forecast, Predictor
from hri_predict.people.body.inferred import Rule, rule_of
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.working_distance.standing import standing_snapshot
from hri_predict.zones.body_zones import ZoneBuilder
from hri_predict.zones.learned_scale import LEADS_S
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import Trust

_NOW_NS = 10**10
_LATER_S = 0.4


class StandingBody:
    """Zones of a standing person whose forecasts are accurate, in one configuration.

    Args:
        config: gives the mode, the limits, the coverage and the absent parts.
        predictor: predictor of the configuration.
    """

    def __init__(self, config: Config, predictor: Predictor) -> None:
        risk, steps = config.node.risk, predictor.horizon_steps
        calibration = assemble.build_calibration(config)
        skeleton = predictor.skeleton
        self._predictor = predictor if risk.uses_forecasts else None
        self._history_steps, self._rate_hz = predictor.history_steps, predictor.rate_hz
        calm = Trust(
            residual_m=np.zeros(1),
            error_m=np.zeros((1, len(LEADS_S), len(JOINTS))),
            widen=np.ones((1, steps)),
            out_of_distribution=np.zeros(1, np.bool_),
        )
        self._trust = None if calibration is None else calm
        self._builder = ZoneBuilder(
            skeleton=skeleton,
            absent_parts=config.node.people.absent_parts,
            limits=risk.limits,
            rate_hz=predictor.rate_hz,
            horizon_steps=steps,
            radii=None
            if calibration is None
            else Radii(calibration, risk.coverage, skeleton, steps),
            with_paths=False,
        )
        self.times_s = self._builder.times_s
        self.segments = tuple(CANONICAL.segments[i] for i in self._builder.segment_index)

    def snapshot(self, delivered: Bools, infers: bool = True) -> PeopleSnapshot:
        """Return the body as seen by a source that delivers only the given joints (J,)."""
        return standing_snapshot(
            delivered, self._history_steps, self._rate_hz, now_ns=_NOW_NS, infers=infers
        )

    def cubic_metres(self, snapshot: PeopleSnapshot) -> Floats:
        """(K+1, S) volume of each zone: of each segment's capsule now and at each step."""
        forecast: Forecast | None = None
        if self._predictor is not None:
            forecast = self._predictor.predict(snapshot.history, snapshot.observed)
        capsules = self._builder.build(snapshot, forecast, trust=self._trust).zones.capsules
        length = np.linalg.norm(capsules.b[0] - capsules.a[0], axis=-1)
        radius = capsules.radius[0]
        volume: Floats = np.pi * radius**2 * (length + 4 / 3 * radius)
        return volume

    def step_at(self, seconds: float) -> int:
        """Index of the zone that ends then, or the last one."""
        return min(int(np.searchsorted(self.times_s, seconds - 1e-9)), len(self.times_s) - 1)


def joint_map_cost(config: Config, predictor: Predictor, joint_map: JointMap) -> dict[str, Any]:
    """Cost in zones of the joints that a map lacks.

    Returns:
        ``name`` of the map; ``later_s``, the time of "later"; ``parts``: for each kind of missing
        joint its ``joints``, ``anchors`` (empty: inferred from the posture, or not inferred),
        ``within_m`` (``None``: bounded by the skeleton's reach), and ``times_now`` and
        ``times_later``, the factors by which the volume of their zones grows. Joints of absent
        parts cost nothing and are left out.
    """
    body, delivered = StandingBody(config, predictor), joint_map.mapped
    snapshot = body.snapshot(delivered)
    whole, mapped = (
        body.cubic_metres(body.snapshot(np.ones_like(delivered))),
        body.cubic_metres(snapshot),
    )
    later = body.step_at(_LATER_S)
    parts = []
    for missing, rule in _missing(delivered):
        at = [i for i, s in enumerate(body.segments) if {s.joint_a, s.joint_b} & set(missing)]
        if not at:
            continue
        now, then = (mapped[k, at].sum() / whole[k, at].sum() for k in (0, later))
        within_m = None
        if snapshot.inferred is not None and snapshot.inferred.joints[0, missing].all():
            within_m = round(float(snapshot.inferred.within_m[0, missing].max()), 3)
        parts.append(
            {
                "joints": [JOINTS[i] for i in missing],
                "anchors": [] if rule is None else sorted({_kind(a) for a in rule.anchors}),
                "within_m": within_m,
                "times_now": round(float(now), 2),
                "times_later": round(float(then), 2),
            }
        )
    return {"name": joint_map.name, "later_s": float(body.times_s[later]), "parts": parts}


def _missing(delivered: Bools) -> Iterator[tuple[list[int], Rule | None]]:
    """Return the joints never delivered, by kind, with their rule; ``None``: by the posture."""
    kinds: dict[str, tuple[list[int], Rule | None]] = {}
    for index in np.flatnonzero(~delivered):
        rule = rule_of(JOINTS[index], delivered)
        kind = "posture" if rule is None else _kind(JOINTS[index])
        kinds.setdefault(kind, ([], rule))[0].append(int(index))
    yield from kinds.values()


def joint_map_lines(cost: dict[str, Any]) -> list[str]:
    """One line for each part of ``joint_map_cost``."""
    lines = []
    for part in cost["parts"]:
        if part["within_m"] is None:
            how = (
                "neither seen nor inferred, bounded by reach (people.absent_parts leaves out parts "
                "that no robot can reach)"
            )
        else:
            source = ", ".join(part["anchors"]) or "the posture of the joints seen"
            how = f"inferred from {source}, within {part['within_m']:.2f} m"
        lines.append(
            f"joint map {cost['name']}: {', '.join(part['joints'])} {how}; their zones have "
            f"{part['times_now']:.1f} times the volume of delivered joints now, "
            f"{part['times_later']:.1f} times at {cost['later_s'] * 1e3:.0f} ms"
        )
    return lines


def _kind(joint: str) -> str:
    return joint.removeprefix("l_").removeprefix("r_")
