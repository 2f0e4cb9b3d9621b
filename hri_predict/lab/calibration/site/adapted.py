"""A calibration whose factors are moved towards a site's parts; see ``mixing`` for the rule.

The scale stays the base's. Guaranteed radii stay those of the base, which hold for people like
those in its data; larger ones that the parts show replace them. (Parts of one night are not
independent, so they support no guarantee of their own.) Limits of radii rise to the largest error
of the parts. The range of motion considered like the calibration is widened to the site's fastest
motions.
"""

from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.calibration.conformal import guaranteed_radii, over_radius, raised
from hri_predict.lab.calibration.site.mixing import Ratios, moved, weights_of
from hri_predict.lab.calibration.site.parts import Part
from hri_predict.zones.calibration import OFS, Calibration, Of, SiteParts, UsedRecording, plain
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.motion_ranges import SHORT_S, bounded, short_ratio


def adapted(
    *,
    base: Calibration,
    base_digest: str,
    parts: Sequence[Part],
    skeleton: Skeleton,
    made: date | None,
) -> Calibration:
    """Move a calibration towards a site.

    Args:
        base: the calibration that the parts were scored with.
        base_digest: digest of the base's file, kept in the result.
        parts: parts of the site's recordings.
        skeleton: skeleton of the parts' joints.
        made: the current day, kept in the result.
    """
    group = groups(base, skeleton)
    pooled = _Pooled(parts, group)
    estimated = pooled.factors(base)
    limits = None
    if base.limits is not None:
        limits = {
            of: raised(table, pooled.error, pooled.speeds, group)
            for of, table in base.limits.items()
        }
    most = np.full_like(base.guaranteed["joint"][-1], np.inf)
    return replace(
        base,
        estimated=estimated,
        limits=limits,
        guaranteed=_guaranteed(base, pooled, group),
        ranges=_ranges(
            base=base,
            parts=parts,
            pooled=pooled,
            group=group,
            factors=estimated["joint"][-1],
            limit=most if limits is None else limits["joint"][-1],
        ),
        made=made,
        site=SiteParts(
            base=base_digest,
            recordings=tuple(
                UsedRecording(name=p.name, windows=p.windows, digest=p.digest) for p in parts
            ),
        ),
    )


def moved_factors(base: Calibration, parts: Sequence[Part], skeleton: Skeleton) -> dict[Of, Floats]:
    """Per question (L, 3, H): the base's factors, moved towards some parts."""
    return _Pooled(parts, groups(base, skeleton)).factors(base)


def groups(base: Calibration, skeleton: Skeleton) -> Ints:
    """(J,) index of each joint among the calibrated ones; -1 for others."""
    names = list(base.joints)
    return np.array([names.index(n) if n in names else -1 for n in map(plain, skeleton.joints)])


class _Pooled:
    """All windows of some parts: W windows, H steps, J joints."""

    def __init__(self, parts: Sequence[Part], group: Ints) -> None:
        self.error = np.concatenate([p.error_m for p in parts])
        self.error[:, :, group < 0] = np.nan
        self.ratio = self.error / np.concatenate([p.scale_m for p in parts])
        self.speeds = np.concatenate([p.speeds for p in parts])
        self.unit = np.concatenate([np.full(len(p.speeds), i) for i, p in enumerate(parts)])
        self.windows = np.array([p.windows for p in parts])  # (U, 3)

    def factors(self, base: Calibration) -> dict[Of, Floats]:
        found: dict[Of, Floats] = {of: base.estimated[of].copy() for of in OFS}
        for c in range(len(SPEED_CLASSES)):
            own = self.speeds == c
            if not own.any():
                continue
            ratio, unit = self.ratio[own], self.unit[own]
            weights = weights_of(self.windows[:, c])
            unit_of_joint = np.repeat(unit, ratio.shape[2])
            for step in range(min(ratio.shape[1], base.steps)):
                here = ratio[:, step]
                whole = np.where(np.isfinite(here), here, -np.inf).max(1)
                sites: dict[Of, Ratios] = {
                    "joint": Ratios.of(here.ravel(), unit_of_joint, weights),
                    "body": Ratios.of(whole, unit, weights),
                }
                for of, site in sites.items():
                    found[of][:, c, step] = moved(base.estimated[of][:, c, step], site)
        # what holds the whole body holds each joint
        found["body"] = np.maximum(found["body"], found["joint"])
        return found


def _guaranteed(base: Calibration, pooled: _Pooled, group: Ints) -> dict[Of, Floats]:
    of_site = guaranteed_radii(
        error=pooled.error,
        fast=pooled.speeds,
        unit=pooled.unit,
        group=group,
        joints=len(base.joints),
        rate_hz=base.rate_hz,
    )
    return {
        of: np.maximum(base.guaranteed[of], np.where(np.isfinite(table), table, 0.0))
        for of, table in of_site.items()
    }


def _ranges(
    *,
    base: Calibration,
    parts: Sequence[Part],
    pooled: _Pooled,
    group: Ints,
    factors: Floats,
    limit: Floats,
) -> dict[str, Any]:
    """The base's ranges, widened as far as the parts need.

    Args:
        factors, limit: (3, H) and (3, G, H) for each joint at the highest level.
        base, parts, pooled, group: see above.
    """
    fastest = np.stack([p.fastest_m_s for p in parts])
    fastest = np.where(np.isfinite(fastest), fastest, 0.0).max(0)  # (J,)
    speed = dict(base.ranges["speed_m_s"])
    for index, name in enumerate(base.joints):
        here = float(np.ceil(100 * fastest[group == index].max(initial=0.0)) / 100)
        if name in speed:
            speed[name] = max(speed[name], here)
    short = max(1, round(SHORT_S * base.rate_hz))
    ratio = over_radius(
        ratio=pooled.ratio[:, :short],
        error=pooled.error[:, :short],
        fast=pooled.speeds,
        factors=factors[:, :short],
        limit=limit[..., :short],
        group=group,
    )
    judged = np.isfinite(ratio)
    flat = np.where(judged, ratio, 0.0).reshape(-1, len(group))
    wrong = short_ratio(flat, judged.reshape(flat.shape))
    worst = float(np.nanmax(wrong)) if np.isfinite(wrong).any() else 0.0
    return bounded(speed, max(float(base.ranges["ratio_short"]), worst))
