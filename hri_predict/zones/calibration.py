"""Calibrated radii: bounds on a predictor's errors that hold at a stated rate.

A calibration belongs to one predictor with its settings and weights. It gives radii for each level,
each of two questions (each *joint* alone; the whole *body* at once), each speed class and each
horizon step, in two ways:

- **estimated**: a factor on the learned scale (``learned_scale``), which estimates the error of
  this forecast for each joint, corrected by its shape (``scale_shape``), up to a limit. Windows of
  one recording overlap and are similar, so this is an estimate without a guarantee
  (``lab.calibration.conformal``).
- **guaranteed**: a radius in metres for each joint, from split conformal prediction over
  recordings, because only recordings are independent. The score of a recording is the largest error
  of all its windows. With n recordings the level l is supported if ceil((n + 1) l) <= n; the radius
  is the score with that rank (Vovk et al. 2005; J. Lei et al., "Distribution-free predictive
  inference for regression", JASA 113 (2018), 1094). 0.9 needs 9 recordings, 0.95 needs 19, 0.99
  needs 99.

Files are JSON, factors in whole thousandths and radii in whole millimetres, rounded up. Left and
right joints share their radii.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import package_path, read_text
from hri_predict.base.settings import Settings, validated
from hri_predict.base.skeleton import JOINTS, Skeleton
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.zones.input_noise import NoiseGrowth
from hri_predict.zones.learned_scale import ScaleNetwork
from hri_predict.zones.motion_class import SPEED_CLASSES, trunk_joints
from hri_predict.zones.motion_ranges import MAX_RATIO_SHORT, MAX_SPEED_M_S, MotionRanges
from hri_predict.zones.plausible import demand_radii, demand_scale, demand_shares
from hri_predict.zones.predictor_identity import calibrate_command, identity
from hri_predict.zones.scale_shape import ScaleShape
from hri_predict.zones.settings import LEVELS, CoverageSettings
from hri_predict.zones.toward import BINS

Of = Literal["joint", "body"]
OFS: tuple[Of, ...] = ("joint", "body")
FOLDER = package_path("predictors", "weights")
"""Folder of the calibrations of shipped predictors and baselines, next to the weights."""

VERSION = 3
"""Version of the file format; 3 added the learned scale."""

Millimetres = Annotated[int, Field(ge=1, le=100_000)]
Share = Annotated[int, Field(ge=1, le=1000)]
Row = list[Millimetres | None]  # by step; None: unknown, so unbounded
_KNOWN = {name.removeprefix("l_").removeprefix("r_") for name in JOINTS}


class RangesFile(Settings):
    """Ranges of the motions in the calibration recordings; see ``MotionRanges``."""

    speed_m_s: dict[str, Annotated[float, Field(ge=0, le=MAX_SPEED_M_S)]]
    ratio_short: float = Field(gt=0, le=MAX_RATIO_SHORT)


class UsedRecording(Settings):
    """A recording used for the calibration, and its number of windows in each speed class."""

    name: str
    windows: Annotated[
        tuple[Annotated[int, Field(ge=0)], ...],
        Field(min_length=len(SPEED_CLASSES), max_length=len(SPEED_CLASSES)),
    ]
    digest: str | None = Field(None, description="the file's SHA-256")


class SiteParts(Settings):
    """Adjustment of a calibration's factors to a site; see ``lab.calibration.site.mixing``."""

    base: str = Field(description="first digits of the SHA-256 of the calibration it came from")
    recordings: tuple[UsedRecording, ...] = Field(description="parts of the site's recordings")


class CalibrationFile(Settings):
    """A calibration as stored."""

    version: int = VERSION
    predictor: str
    settings: dict[str, Any]
    weights: str | None = Field(description="first digits of the weights' SHA-256")
    code: str | None = Field(None, description="the same of the code of third parties that it runs")
    rate_hz: float = Field(gt=0, le=200)
    steps: int = Field(ge=1, le=2000)
    joints: list[str] = Field(min_length=1, max_length=64)
    levels: list[float]
    classes: list[str]
    scale: dict[str, Any]
    shape: dict[str, Any] | None = Field(None, description="factors on the scale by its size")
    estimated_thousandths: dict[str, list[list[Row]]] = Field(
        description="factors of the scale: of, level, speed class"
    )
    limits_mm: dict[str, list[list[list[Row]]]] | None = Field(
        None, description="factors of the estimated radii: of, level, speed class, joint"
    )
    toward_thousandths: list[list[list[list[Share]]]] | None = Field(
        None, description="shares of the estimated radii: level, speed class, step, direction"
    )
    noise: dict[str, Any] | None = Field(None, description="growth of radii: of, level, step")
    guaranteed_mm: dict[str, list[list[list[Row]]]] = Field(
        description="of, level, speed class, joint"
    )
    recordings: tuple[UsedRecording, ...] = Field(min_length=1)
    ranges: RangesFile
    made: date | None = Field(None, description="date of the calibration")
    site: SiteParts | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """A calibration in memory. L levels, G joints (sides pooled), H steps.

    Attributes:
        predictor, settings, weights: the predictor that was calibrated.
        code: hash of the code of third parties that the predictor ran; ``None``: there was none, or
            the calibration is older than this feature.
        rate_hz: steps per second.
        joints: names of the G joints, without their side.
        scale: the fitted network.
        shape: shape of the scale; ``None``: the calibration is older than this feature.
        estimated: per question (L, 3, H) factors on the scale, by speed class; infinite if unknown.
        limits: per question (L, 3, G, H) metres, upper limits of the estimated radii; ``None``: the
            calibration is older than this feature.
        guaranteed: per question (L, 3, G, H) metres, by speed class; infinite if not supported.
        recordings: recordings used for the calibration.
        ranges: ranges of the motions in the recordings.
        toward: (L, 3, H, BINS) shares of the estimated radii of single joints to use in directions
            of a class (``toward``); ``None``: the whole radius in all directions.
        noise: growth of the estimated radii with a tracker's noise; ``None``: no growth.
        made: date of the calibration; ``None`` if unknown.
        site: parts of a site's recordings that adjusted the factors.
    """

    predictor: str
    settings: Mapping[str, Any]
    weights: str | None
    rate_hz: float
    joints: tuple[str, ...]
    scale: ScaleNetwork
    estimated: Mapping[Of, Floats]
    guaranteed: Mapping[Of, Floats]
    recordings: tuple[UsedRecording, ...]
    ranges: Mapping[str, Any]
    shape: ScaleShape | None = None
    limits: Mapping[Of, Floats] | None = None
    toward: Floats | None = None
    noise: NoiseGrowth | None = None
    made: date | None = None
    site: SiteParts | None = None
    code: str | None = None

    @property
    def used(self) -> tuple[UsedRecording, ...]:
        """All recordings used for the calibration, including those of the site."""
        return self.recordings + (self.site.recordings if self.site is not None else ())

    @property
    def steps(self) -> int:
        """H."""
        return int(self.estimated["joint"].shape[-1])

    def independent(self, speed_class: int) -> int:
        """Return the number of recordings with windows of a speed class."""
        return sum(used.windows[speed_class] > 0 for used in self.recordings)

    def motion_ranges(self, skeleton: Skeleton) -> MotionRanges:
        """Return the ranges by joint of ``skeleton``; unbounded for joints without a calibration.

        The trunk carries every joint, so a joint's range is at least the trunk's: a joint seen in
        few recordings may have been slow in all of them.
        """
        known = self.ranges["speed_m_s"]
        speed = np.array([known.get(plain(name), np.inf) for name in skeleton.joints])
        trunk = speed[trunk_joints(skeleton)]
        carried = float(trunk[np.isfinite(trunk)].max(initial=0.0))
        return MotionRanges(
            speed_m_s=np.maximum(speed, carried),
            ratio_short=float(self.ranges["ratio_short"]),
        )


def plain(joint: str) -> str:
    """Return a joint's name without its side."""
    return joint.removeprefix("l_").removeprefix("r_")


def needed(level: float) -> int:
    """Return the number of independent recordings needed to guarantee ``level``: 9, 19 or 99."""
    return math.ceil(level / (1.0 - level) - 1e-9)


# -- files --------------------------------------------------------------------------------------


_REMEDY = "make a new one: hri-predict calibrate"


def shipped_calibration(predictor: str) -> Path:
    """Return the path of the calibration of a shipped predictor."""
    return FOLDER / f"{predictor}.calibration.json"


def load_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises:
        ConfigError: the file cannot be read or is not a calibration; one line with the remedy.
    """
    what = f"calibration {path}"
    try:
        data = json.loads(read_text(path, "calibration"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{what}: not JSON ({error}); {_REMEDY}") from error
    if isinstance(data, dict) and data.get("version") != VERSION:
        raise ConfigError(f"{what}: has another version; {_REMEDY}")
    try:
        return _unpacked(validated(CalibrationFile, data, what))
    except ConfigError as error:
        raise ConfigError(f"{error}; {_REMEDY}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{what}: {error}; {_REMEDY}") from error


def save_text(calibration: Calibration) -> str:
    """Return the file's text."""
    file = CalibrationFile(
        predictor=calibration.predictor,
        settings=dict(calibration.settings),
        weights=calibration.weights,
        code=calibration.code,
        rate_hz=calibration.rate_hz,
        steps=calibration.steps,
        joints=list(calibration.joints),
        levels=list(LEVELS),
        classes=list(SPEED_CLASSES),
        scale=calibration.scale.to_json(),
        shape=None if calibration.shape is None else calibration.shape.to_json(),
        estimated_thousandths={
            of: _thousandths(table) for of, table in calibration.estimated.items()
        },
        limits_mm=None
        if calibration.limits is None
        else {of: _thousandths(table) for of, table in calibration.limits.items()},
        toward_thousandths=None
        if calibration.toward is None
        else np.ceil(calibration.toward * 1000.0 - 1e-6).astype(np.int64).tolist(),
        noise=None if calibration.noise is None else calibration.noise.to_json(),
        guaranteed_mm={of: _thousandths(table) for of, table in calibration.guaranteed.items()},
        recordings=calibration.recordings,
        ranges=RangesFile(**calibration.ranges),
        made=calibration.made,
        site=calibration.site,
    )
    return json.dumps(file.model_dump(mode="json"), separators=(",", ":"), allow_nan=False) + "\n"


def _thousandths(table: Floats) -> Any:
    """Return nested lists, rounded up; None where unbounded."""
    rounded = np.maximum(np.ceil(table * 1000.0 - 1e-6), 1.0)
    return _rows(rounded, rounded <= 100_000)


def _rows(values: Floats, usable: Any) -> Any:
    if values.ndim == 1:
        return [int(v) if ok else None for v, ok in zip(values, usable, strict=True)]
    return [_rows(v, ok) for v, ok in zip(values, usable, strict=True)]


def _unpacked(file: CalibrationFile) -> Calibration:
    if tuple(file.levels) != LEVELS or tuple(file.classes) != SPEED_CLASSES:
        raise ValueError("its levels or speed classes belong to another version")
    if len(set(file.joints)) < len(file.joints) or not _KNOWN.issuperset(file.joints):
        raise ValueError("joints must be those of the canonical skeleton, each once")
    if not _KNOWN.issuperset(file.ranges.speed_m_s):
        raise ValueError("ranges.speed_m_s names a joint that the canonical skeleton lacks")
    classes = len(LEVELS), len(SPEED_CLASSES)
    shape = (*classes, len(file.joints), file.steps)
    for table in (file.estimated_thousandths, file.guaranteed_mm, file.limits_mm):
        if table is not None and set(table) != set(OFS):
            raise ValueError(f"a table is not for {' and '.join(OFS)}")
    factors = {of: _table(file.estimated_thousandths[of], (*classes, file.steps)) for of in OFS}
    guaranteed = {of: _table(file.guaranteed_mm[of], shape) for of in OFS}
    rows = file.limits_mm
    limits = None if rows is None else {of: _table(rows[of], shape) for of in OFS}
    toward = None
    if file.toward_thousandths is not None:
        try:
            toward = np.array(file.toward_thousandths, np.float64) / 1000.0
        except ValueError:
            raise ValueError("toward_thousandths has rows of different lengths") from None
        if toward.shape != (*classes, file.steps, BINS):
            raise ValueError(f"toward_thousandths has the shape {toward.shape}")
        demand_shares(toward)
    for name, tables in {"guaranteed_mm": guaranteed, "limits_mm": limits or {}}.items():
        demand_radii(name, tables.values(), file.rate_hz)
    scale = ScaleNetwork.of_json(file.scale)
    shaped = None if file.shape is None else ScaleShape.of_json(file.shape, file.steps)
    demand_scale(scale, shaped, np.minimum(factors["joint"], factors["body"]), file.rate_hz)
    return Calibration(
        predictor=file.predictor,
        settings=file.settings,
        weights=file.weights,
        rate_hz=file.rate_hz,
        joints=tuple(file.joints),
        scale=scale,
        shape=shaped,
        estimated=factors,
        limits=limits,
        toward=toward,
        noise=None if file.noise is None else NoiseGrowth.of_json(file.noise, OFS, file.steps),
        guaranteed=guaranteed,
        recordings=file.recordings,
        ranges=file.ranges.model_dump(),
        made=file.made,
        site=file.site,
        code=file.code,
    )


def _table(rows: Any, shape: tuple[int, ...]) -> Floats:
    table = np.array(rows, dtype=np.float64) / 1000.0  # None becomes NaN
    if table.shape != shape:
        raise ValueError(f"a table has the shape {table.shape}, not {shape}")
    table = np.where(np.isnan(table), np.inf, table)
    lower, higher = table[:-1], table[1:]
    if (higher < lower).any():
        raise ValueError("a radius of a higher level is smaller than of a lower one")
    return table


# -- which calibration belongs to which predictor ------------------------------------------------


def calibration_for(
    settings: PredictorSettings, coverage: CoverageSettings, base_dir: Path
) -> Calibration | None:
    """Return the calibration for a configuration; ``None`` if the predictor ships without one.

    Raises:
        ConfigError: the calibration belongs to another predictor, settings, weights or code.
    """
    if coverage.calibration is not None:
        path = base_dir / coverage.calibration
    else:
        path = shipped_calibration(settings.name)
        if not path.is_file():
            return None
    calibration = load_calibration(path)
    problem = mismatch(calibration, settings)
    if problem and coverage.calibration is None:
        return None  # the shipped one is for other settings: uncalibrated, and check says so
    if problem:
        again = calibrate_command(
            settings.name, getattr(settings, "weights", None), settings.horizon_s
        )
        raise ConfigError(
            f"risk.coverage.calibration {path}: {problem}; calibrate your predictor: {again}"
        )
    return calibration


_NOT_OF_ERRORS = {"threads"}
"""Settings that change the run time of a forecast, and its errors only by rounding."""


def mismatch(calibration: Calibration, settings: PredictorSettings) -> str:
    """Return why a calibration does not belong to a predictor; "" if it does."""
    if calibration.predictor != settings.name:
        return f"is of predictor {calibration.predictor}, not {settings.name}"
    if calibration.rate_hz != settings.rate_hz:
        return f"is for {calibration.rate_hz:g} steps per second, not {settings.rate_hz:g}"
    values, weights = identity(settings)
    for key in sorted((values.keys() | calibration.settings.keys()) - _NOT_OF_ERRORS):
        if values.get(key) != calibration.settings.get(key):
            return f"was made with {key} {calibration.settings.get(key)}, not {values.get(key)}"
    if calibration.weights != weights:
        return "was made with other weights"
    if calibration.code is not None and calibration.code != registry.code_of(settings):
        return f"was made with other code of predictor {settings.name}"
    return ""
