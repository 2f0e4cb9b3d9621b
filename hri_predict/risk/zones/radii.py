"""Radii: how large each joint's zone must be, by a calibration and what is known of the person."""

from collections.abc import Sequence

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import ConfigError
from hri_predict.risk.settings import LEVELS, CoverageSettings
from hri_predict.risk.zones.calibration import Calibration, needed, plain
from hri_predict.risk.zones.learned_scale import Evidence, LearnedScale
from hri_predict.risk.zones.motion_class import SPEED_CLASSES, speed_class
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
        self._whatever_speed = self._table.max(0)
        self._limits = np.full_like(self._table, np.inf)
        if limits is not None:
            self._limits[:, :known] = _by_joint(limits, of_joint)[:, :known]
        self._limit_whatever_speed = self._limits.max(0)

    def of(self, speed_m_s: Floats, evidence: Evidence) -> Floats:
        """(P, H, J) metres for P people.

        Args:
            speed_m_s: (P,) trunk speeds; who has none (NaN) gets the largest radii of all speeds.
            evidence: of the same people.
        """
        unknown = np.isnan(speed_m_s)[:, None, None]
        found = np.where(unknown, self._whatever_speed, self._table[speed_class(speed_m_s)])
        if self._scale is None:
            return found
        limit = np.where(unknown, self._limit_whatever_speed, self._limits[speed_class(speed_m_s)])
        # a zone must not shrink with the horizon
        return np.maximum.accumulate(np.minimum(found * self._scale(evidence), limit), axis=1)


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
