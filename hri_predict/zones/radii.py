"""Radii: required size of each joint's zone, from a calibration and data on the person."""

from collections.abc import Sequence
from math import exp, log

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.errors import ConfigError
from hri_predict.base.machine.compiled import kernel, part
from hri_predict.base.skeleton import Skeleton
from hri_predict.zones.calibration import Calibration, needed, plain
from hri_predict.zones.input_noise import input_noise_m
from hri_predict.zones.learned_scale import Evidence, LearnedScale
from hri_predict.zones.motion_class import BRISK_M_S, SPEED_CLASSES, STILL_M_S, speed_class
from hri_predict.zones.scale_shape import shaped_by
from hri_predict.zones.settings import LEVELS, CoverageSettings
from hri_predict.zones.toward import BINS


class Radii:
    """Radii for one coverage setting, by joint of one skeleton.

    Attributes:
        steps: number of calibrated steps.

    Args:
        calibration: see ``Calibration``.
        settings: level, question and basis.
        skeleton: skeleton of the zones; joints that were not calibrated have infinite radii.
        horizon_steps: H of the forecast; radii of steps that were not calibrated are infinite.

    Raises:
        ConfigError: too few recordings to guarantee the level, or the level is not calibrated.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: CoverageSettings,
        skeleton: Skeleton,
        horizon_steps: int,
    ) -> None:
        self.steps = calibration.steps
        level, known = LEVELS.index(settings.level), min(horizon_steps, calibration.steps)
        self._scale: LearnedScale | None = None
        limits: Floats | None = None
        names = list(calibration.joints)
        of_joint = [names.index(n) if n in names else -1 for n in map(plain, skeleton.joints)]
        if settings.basis == "guaranteed":
            _check_supported(calibration, settings)
            table = _by_joint(calibration.guaranteed[settings.of][level], of_joint)
        else:
            self._scale = LearnedScale(
                calibration.scale, skeleton, calibration.rate_hz, horizon_steps
            )
            factors = calibration.estimated[settings.of][level][..., None]  # (3, H, 1)
            table = np.where(np.array(of_joint) < 0, np.inf, factors)  # (3, H, J)
            if calibration.limits is not None:
                limits = calibration.limits[settings.of][level]
        self._table = np.full((len(table), horizon_steps, table.shape[2]), np.inf)
        self._table[:, :known] = table[:, :known]
        self._limits = np.full_like(self._table, np.inf)
        if limits is not None:
            self._limits[:, :known] = _by_joint(limits, of_joint)[:, :known]
        self._shares: Floats | None = None
        if (
            settings.basis == "estimated"
            and settings.of == "joint"
            and calibration.toward is not None
        ):
            self._shares = np.ones((len(self._table), horizon_steps, BINS))
            self._shares[:, :known] = calibration.toward[level][:, :known]
        shape = calibration.shape
        self._noise, self._of, self._level = calibration.noise, settings.of, level
        self._skeleton = skeleton
        self._shape = _NO_SHAPE if shape is None else shape.logarithms(horizon_steps)

    def of(self, speed_m_s: Floats, evidence: Evidence) -> Floats:
        """Return (P, H, J) metres for P people.

        Args:
            speed_m_s: (P,) trunk speeds; for an unknown speed (NaN), the largest radii of all
                classes are used.
            evidence: data on these people.
        """
        if self._scale is None:
            return _largest(self._table, speed_m_s)
        tables = self._table, self._limits, *self._shape
        found = _radii(self._scale(evidence), speed_m_s, tables)
        if self._noise is None:
            return found
        measured = evidence.observed if evidence.measured is None else evidence.measured
        noise_m = input_noise_m(evidence.history, measured, self._skeleton)
        return self._noise.grown(found, noise_m, self._of, self._level)

    def shares(self, speed_m_s: Floats) -> Floats | None:
        """Return (P, H, BINS) shares of the radii by direction, see ``toward``; ``None``: not
        calibrated.

        Args:
            speed_m_s: as in ``of``.
        """
        return None if self._shares is None else _largest(self._shares, speed_m_s)


_NO_SHAPE = np.zeros((0, 0, 0)), np.zeros((0, 0, 0))
_Tables = tuple[Floats, Floats, Floats, Floats]
"""(3, H, J) factors and limits, (3, H, B) ``ScaleShape.logarithms``; empty without a shape."""


def _largest(table: Floats, speed_m_s: Floats) -> Floats:
    """Return (P, H, J) from a table (3, H, J) by speed class."""
    found = table[speed_class(speed_m_s)]
    found[np.isnan(speed_m_s)] = table.max(0)
    return found


def _radii_by_arrays(scale_m: Floats, speed_m_s: Floats, tables: _Tables) -> Floats:
    unknown = np.isnan(speed_m_s)
    found = _by_class(scale_m, speed_class(speed_m_s), tables)
    if unknown.any():
        each = [np.full(np.count_nonzero(unknown), c) for c in range(len(SPEED_CLASSES))]
        some = scale_m[unknown]
        found[unknown] = np.max([_by_class(some, fast, tables) for fast in each], axis=0)
    return found


def _by_class(scale_m: Floats, fast: Ints, tables: _Tables) -> Floats:
    """Return (P, H, J) metres for people of known speed classes."""
    factors, limits, knots, logs = tables
    shaped = scale_m if not knots.size else shaped_by(scale_m, knots[fast], logs[fast])
    found = np.minimum(factors[fast] * shaped, limits[fast])
    # a zone must not shrink with the horizon
    return np.maximum.accumulate(found, axis=1)


def _radii_by_loops(scale_m: Floats, speed_m_s: Floats, tables: _Tables) -> Floats:
    factors, limits, knots, logs = tables
    people, steps, joints = scale_m.shape
    found = np.zeros((people, steps, joints))
    for p in range(people):
        speed = speed_m_s[p]
        first, last = 0, len(factors)
        if speed == speed:  # else it is not known
            first = (0 if speed < STILL_M_S else 1) + (1 if speed >= BRISK_M_S else 0)
            last = first + 1
        for c in range(first, last):
            for h in range(steps):
                for j in range(joints):
                    scale = scale_m[p, h, j]
                    if knots.size:
                        scale *= _factor(scale, knots[c, h], logs[c, h])
                    radius = factors[c, h, j] * scale
                    radius = limits[c, h, j] if limits[c, h, j] < radius else radius
                    if not radius <= found[p, h, j]:
                        found[p, h, j] = radius
        for h in range(1, steps):
            for j in range(joints):
                if found[p, h - 1, j] > found[p, h, j]:
                    found[p, h, j] = found[p, h - 1, j]
    return found


@part
def _factor(scale: float, knots: Floats, logs: Floats) -> float:
    """As ``scale_shape.shaped_by``."""
    size, below = log(scale), 0
    for b in range(1, len(knots) - 1):
        below += size >= knots[b]
    on = (size - knots[below]) / (knots[below + 1] - knots[below])
    on = 0.0 if on < 0.0 else 1.0 if on > 1.0 else on
    return exp(logs[below] + on * (logs[below + 1] - logs[below]))


_radii = kernel(_radii_by_loops, _radii_by_arrays)


def _by_joint(table: Floats, of_joint: Sequence[int]) -> Floats:
    """Return (3, H, J) from a table (3, G, H); joint -1 is infinite."""
    padded = np.concatenate([table, np.full_like(table[:, :1], np.inf)], axis=1)
    return padded[:, list(of_joint)].swapaxes(1, 2)


def _check_supported(calibration: Calibration, settings: CoverageSettings) -> None:
    for index, name in enumerate(SPEED_CLASSES):
        have, want = calibration.independent(index), needed(settings.level)
        if have < want:
            raise ConfigError(
                f"risk.coverage: {settings.level:g} is not guaranteed for {calibration.predictor}: "
                f"{have} recordings show people {name}, {want} are needed; calibrate with "
                f"{want - have} more, lower the level, or set basis: estimated"
            )
