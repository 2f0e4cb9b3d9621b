"""Radii: how large each joint's zone must be, by a calibration and what is known of the person."""

from collections.abc import Sequence

import numpy as np

from hri_predict.arrays import Floats, Ints
from hri_predict.errors import ConfigError
from hri_predict.risk.settings import LEVELS, CoverageSettings
from hri_predict.risk.zones.calibration import Calibration, needed, plain
from hri_predict.risk.zones.learned_scale import Evidence, LearnedScale
from hri_predict.risk.zones.motion_class import SPEED_CLASSES, speed_class
from hri_predict.risk.zones.scale_shape import ScaleShape
from hri_predict.skeleton import Skeleton


class Radii:
    """The radii of one choice of coverage, by joint of one skeleton.

    Attributes:
        steps: number of calibrated steps.

    Args:
        calibration: see ``Calibration``.
        settings: which level, question and basis.
        skeleton: of the zones; joints that were not calibrated have infinite radii.
        horizon_steps: H of the forecast; radii of steps that were not calibrated are infinite.

    Raises:
        ConfigError: too few recordings guarantee the level, or it is not calibrated.
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
        self._shape: ScaleShape | None = None
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
            self._shape = calibration.shape
            if calibration.limits is not None:
                limits = calibration.limits[settings.of][level]
        self._table = np.full((len(table), horizon_steps, table.shape[2]), np.inf)
        self._table[:, :known] = table[:, :known]
        self._limits = np.full_like(self._table, np.inf)
        if limits is not None:
            self._limits[:, :known] = _by_joint(limits, of_joint)[:, :known]

    def of(self, speed_m_s: Floats, evidence: Evidence) -> Floats:
        """(P, H, J) metres for P people.

        Args:
            speed_m_s: (P,) trunk speeds; who has none (NaN) gets the largest radii of all speeds.
            evidence: of the same people.
        """
        unknown = np.isnan(speed_m_s)
        scale_m = None if self._scale is None else self._scale(evidence)
        found = self._by_class(speed_class(speed_m_s), scale_m)
        if unknown.any():
            some = None if scale_m is None else scale_m[unknown]
            each = [np.full(np.count_nonzero(unknown), c) for c in range(len(SPEED_CLASSES))]
            found[unknown] = np.max([self._by_class(fast, some) for fast in each], axis=0)
        return found

    def _by_class(self, fast: Ints, scale_m: Floats | None) -> Floats:
        """(P, H, J) metres for people of known speed classes; no scale: the table is in metres."""
        if scale_m is None:
            return self._table[fast]
        shaped = scale_m if self._shape is None else self._shape.of(scale_m, fast)
        found = np.minimum(self._table[fast] * shaped, self._limits[fast])
        # a zone must not shrink with the horizon
        return np.maximum.accumulate(found, axis=1)


def _by_joint(table: Floats, of_joint: Sequence[int]) -> Floats:
    """(3, H, J) of a table (3, G, H); joint -1 is infinite."""
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
