"""Calibrated radii: how far people were from where a predictor put them, and how often.

A calibration belongs to one predictor with its settings and weights. It holds a radius in metres
for each level, each of two questions (each *joint* alone; the whole *body* at once), each motion
class, joint and horizon step:

- **estimated**: from all windows of all calibration recordings. Windows of one recording overlap
  and resemble each other, so this is an estimate without a guarantee: the upper bound from
  resampling the recordings (``calibration.conformal``).
- **guaranteed**: split conformal prediction over recordings: only these are independent. The score
  of a recording is the largest error of all its windows. With n recordings the level l is
  supported if ceil((n + 1) l) <= n; the radius is the score of that rank (Vovk et al. 2005;
  J. Lei et al., "Distribution-free predictive inference for regression", JASA 113 (2018), 1094).
  0.9 needs 9 recordings, 0.95 needs 19, 0.99 needs 99.

Files are JSON, radii in whole millimetres, rounded up. Left and right joints share their radii.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hri_predict.arrays import Floats
from hri_predict.errors import ConfigError
from hri_predict.files import package_path, read_text
from hri_predict.predictors.base import PredictorSettings
from hri_predict.risk.settings import LEVELS, CoverageSettings
from hri_predict.risk.zones.motion_class import CLASSES, GRADES, SPEED_CLASSES, motion_class
from hri_predict.risk.zones.motion_ranges import MotionRanges
from hri_predict.settings import Settings, validated
from hri_predict.skeleton import JOINTS, Skeleton

OFS: tuple[Literal["joint", "body"], ...] = ("joint", "body")
FOLDER = package_path("weights")
"""Calibrations of shipped predictors lie beside the weights; so do those of the baselines."""

VERSION = 2
"""Of the files; 2 has three speed classes."""

Millimetres = Annotated[int, Field(ge=1, le=100_000)]
Row = list[Millimetres | None]  # by step; None: unknown, so unbounded
Metres = Annotated[float, Field(ge=0)]
_KNOWN = {name.removeprefix("l_").removeprefix("r_") for name in JOINTS}
_HASHED = 16  # hexadecimal digits


class RangesFile(Settings):
    """Ranges of the bodies and motions in the calibration recordings; see ``MotionRanges``."""

    speed_m_s: dict[str, Annotated[float, Field(ge=0)]]
    bone_m: dict[str, Annotated[list[Metres], Field(min_length=2, max_length=2)]]
    ratio_short: float = Field(gt=0)


class UsedRecording(Settings):
    """A recording that the calibration used, and its number of windows in each motion class."""

    name: str
    windows: Annotated[
        tuple[Annotated[int, Field(ge=0)], ...],
        Field(min_length=len(CLASSES), max_length=len(CLASSES)),
    ]
    digest: str | None = Field(None, description="the file's SHA-256")


class CalibrationFile(Settings):
    """A calibration as stored."""

    version: int = VERSION
    predictor: str
    settings: dict[str, Any]
    weights: str | None = Field(description="first digits of the weights' SHA-256")
    rate_hz: float = Field(gt=0, le=200)
    steps: int = Field(ge=1, le=2000)
    joints: list[str] = Field(min_length=1, max_length=64)
    levels: list[float]
    classes: list[str]
    thresholds_m: list[list[float]]
    estimated_mm: dict[str, list[list[list[Row]]]] = Field(description="of, level, class, joint")
    guaranteed_mm: dict[str, list[list[list[Row]]]] = Field(
        description="of, level, speed class, joint"
    )
    recordings: tuple[UsedRecording, ...]
    ranges: RangesFile


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """A calibration in memory. L levels, C motion classes, G joints (sides pooled), H steps.

    Attributes:
        predictor, settings, weights: what it belongs to.
        rate_hz: steps per second.
        joints: names of the G joints, without their side.
        thresholds_m: (3, 2) see ``motion_class``.
        estimated: per question (L, C, G, H) metres; infinite if unknown.
        guaranteed: per question (L, 3, G, H) by speed class; infinite if not supported.
        recordings: used for it.
        ranges: of the bodies and motions in the recordings.
    """

    predictor: str
    settings: Mapping[str, Any]
    weights: str | None
    rate_hz: float
    joints: tuple[str, ...]
    thresholds_m: Floats
    estimated: Mapping[str, Floats]
    guaranteed: Mapping[str, Floats]
    recordings: tuple[UsedRecording, ...]
    ranges: Mapping[str, Any]

    @property
    def steps(self) -> int:
        """H."""
        return int(self.estimated["joint"].shape[-1])

    def independent(self, speed_class: int) -> int:
        """How many recordings have windows of a speed class."""
        per = len(CLASSES) // len(SPEED_CLASSES)
        own = slice(speed_class * per, (speed_class + 1) * per)
        return sum(sum(used.windows[own]) > 0 for used in self.recordings)

    def motion_ranges(self, skeleton: Skeleton) -> MotionRanges:
        """The ranges by joint of ``skeleton``; unbounded for joints without a calibration."""
        sides = [plain(name) for name in skeleton.joints]
        speed, bone = self.ranges["speed_m_s"], self.ranges["bone_m"]
        return MotionRanges(
            speed_m_s=np.array([speed.get(name, np.inf) for name in sides]),
            bone_m=np.array([bone.get(name, (0.0, np.inf)) for name in sides]),
            ratio_short=float(self.ranges["ratio_short"]),
        )


class Radii:
    """The radii of one choice of coverage, by joint of one skeleton.

    Attributes:
        steps: number of calibrated steps.

    Args:
        calibration: see ``Calibration``.
        settings: which level, question and basis.
        skeleton: of the zones.
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
        self._thresholds = calibration.thresholds_m
        self.steps = calibration.steps
        level = LEVELS.index(settings.level)
        if settings.basis == "guaranteed":
            table = calibration.guaranteed[settings.of][level]
            _check_supported(calibration, settings)
            table = np.repeat(table, len(CLASSES) // len(SPEED_CLASSES), axis=0)
        else:
            table = calibration.estimated[settings.of][level]  # (C, G, H)
        of_joint = [
            calibration.joints.index(plain(name)) if plain(name) in calibration.joints else -1
            for name in skeleton.joints
        ]
        padded = np.concatenate([table, np.full_like(table[:, :1], np.inf)], axis=1)
        by_joint = padded[:, of_joint]  # (C, J, H); the row that was added is for index -1
        steps = np.full((*by_joint.shape[:2], horizon_steps), np.inf)
        known = min(horizon_steps, by_joint.shape[2])
        steps[..., :known] = by_joint[..., :known]
        self._table = np.ascontiguousarray(steps.swapaxes(1, 2))  # (C, H, J)
        by_speed = self._table.reshape(len(SPEED_CLASSES), -1, *self._table.shape[1:])
        self._whatever_speed = by_speed.max(0)  # (C / 3, H, J)

    def of(self, speed_m_s: Floats, residual_m: Floats) -> Floats:
        """(P, H, J) metres for P people with these trunk speeds (P,) and residuals (P,).

        People whose speed is unknown (NaN) get the largest radii of all speeds, graded as *slow*.
        """
        classes = self.classes(speed_m_s, residual_m)
        found = self._table[classes]
        unknown = np.isnan(speed_m_s)
        if unknown.any():
            found[unknown] = self._whatever_speed[classes[unknown] % len(self._whatever_speed)]
        return found

    def classes(self, speed_m_s: Floats, residual_m: Floats) -> NDArray[np.intp]:
        """(P,) motion classes."""
        return motion_class(speed_m_s, residual_m, self._thresholds)


def plain(joint: str) -> str:
    """A joint's name without its side."""
    return joint.removeprefix("l_").removeprefix("r_")


def needed(level: float) -> int:
    """How many independent recordings a guarantee of ``level`` takes: 9, 19, 99."""
    return math.ceil(level / (1.0 - level) - 1e-9)


def _check_supported(calibration: Calibration, settings: CoverageSettings) -> None:
    for index, name in enumerate(SPEED_CLASSES):
        have, want = calibration.independent(index), needed(settings.level)
        if have < want:
            raise ConfigError(
                f"risk.coverage: {settings.level:g} is not guaranteed for {calibration.predictor}: "
                f"{have} recordings show people {name}, {want} are needed; calibrate with "
                f"{want - have} more, lower the level, or set basis: estimated"
            )


# -- files --------------------------------------------------------------------------------------


def shipped_calibration(predictor: str) -> Path:
    """Where the calibration of a shipped predictor lies."""
    return FOLDER / f"{predictor}.calibration.json"


def load_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises:
        ConfigError: the file cannot be read or is none; one line with the remedy.
    """
    what = f"calibration {path}"
    try:
        data = json.loads(read_text(path, "calibration"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(
            f"{what}: is not JSON ({error}); make a new one: hri-predict calibrate"
        ) from error
    if isinstance(data, dict) and data.get("version") != VERSION:
        raise ConfigError(f"{what}: is of another version; make a new one: hri-predict calibrate")
    file = validated(CalibrationFile, data, what)
    try:
        return _unpacked(file)
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{what}: {error}; make a new one: hri-predict calibrate") from error


def save_text(calibration: Calibration) -> str:
    """The file's text."""
    file = CalibrationFile(
        predictor=calibration.predictor,
        settings=dict(calibration.settings),
        weights=calibration.weights,
        rate_hz=calibration.rate_hz,
        steps=calibration.steps,
        joints=list(calibration.joints),
        levels=list(LEVELS),
        classes=list(CLASSES),
        thresholds_m=calibration.thresholds_m.tolist(),
        estimated_mm={of: _millimetres(table) for of, table in calibration.estimated.items()},
        guaranteed_mm={of: _millimetres(table) for of, table in calibration.guaranteed.items()},
        recordings=calibration.recordings,
        ranges=RangesFile(**calibration.ranges),
    )
    return json.dumps(file.model_dump(mode="json"), separators=(",", ":"), allow_nan=False) + "\n"


def _millimetres(table: Floats) -> Any:
    """Nested lists, rounded up; None where unbounded."""
    rounded = np.maximum(np.ceil(table * 1000.0 - 1e-6), 1.0)
    return _rows(rounded, rounded <= 100_000)


def _rows(values: Floats, usable: Any) -> Any:
    if values.ndim == 1:
        return [int(v) if ok else None for v, ok in zip(values, usable, strict=True)]
    return [_rows(v, ok) for v, ok in zip(values, usable, strict=True)]


def _unpacked(file: CalibrationFile) -> Calibration:
    if tuple(file.levels) != LEVELS or tuple(file.classes) != CLASSES:
        raise ValueError("its levels or motion classes are of another version")
    if len(set(file.joints)) < len(file.joints) or not _KNOWN.issuperset(file.joints):
        raise ValueError("joints must be those of the canonical skeleton, each once")
    shapes = {"estimated": len(CLASSES), "guaranteed": len(SPEED_CLASSES)}
    tables: dict[str, dict[str, Floats]] = {}
    for name, classes in shapes.items():
        stored = getattr(file, f"{name}_mm")
        want = (len(LEVELS), classes, len(file.joints), file.steps)
        tables[name] = {of: _table(stored[of], want) for of in OFS}
    thresholds = np.array(file.thresholds_m, dtype=np.float64)
    of_speeds = thresholds.shape == (len(SPEED_CLASSES), len(GRADES) - 1)
    if not of_speeds or not (np.diff(thresholds) >= 0).all() or thresholds.max() > 10:
        raise ValueError("thresholds_m must be a rising pair of metres for each speed class")
    return Calibration(
        predictor=file.predictor,
        settings=file.settings,
        weights=file.weights,
        rate_hz=file.rate_hz,
        joints=tuple(file.joints),
        thresholds_m=thresholds,
        estimated=tables["estimated"],
        guaranteed=tables["guaranteed"],
        recordings=file.recordings,
        ranges=file.ranges.model_dump(),
    )


def _table(rows: Any, shape: tuple[int, ...]) -> Floats:
    table = np.array(rows, dtype=np.float64) / 1000.0  # None becomes NaN
    if table.shape != shape:
        raise ValueError(f"a table has the shape {table.shape}, not {shape}")
    table = np.where(np.isnan(table), np.inf, table)
    if not (table[..., 1:] >= table[..., :-1]).all():
        raise ValueError("a radius shrinks with the horizon")
    lower, higher = table[:-1], table[1:]
    if (higher < lower).any():
        raise ValueError("a radius of a higher level is smaller than of a lower one")
    return table


# -- which calibration belongs to which predictor ------------------------------------------------


def identity(settings: PredictorSettings) -> tuple[dict[str, Any], str | None]:
    """The settings that a predictor's errors depend on, and the hash of its weights."""
    values = settings.model_dump(mode="json", exclude={"name", "horizon_s", "weights"})
    weights = getattr(settings, "weights", None)
    path = Path(weights) if weights else FOLDER / f"{settings.name}.safetensors"
    if not path.is_file():
        return values, None
    return values, hashlib.sha256(path.read_bytes()).hexdigest()[:_HASHED]


def calibration_for(
    settings: PredictorSettings, coverage: CoverageSettings, base_dir: Path
) -> Calibration | None:
    """The calibration that a configuration asks for; ``None`` if the predictor ships without one.

    Raises:
        ConfigError: it belongs to another predictor, other settings or other weights.
    """
    if coverage.calibration is not None:
        path = base_dir / coverage.calibration
    else:
        path = shipped_calibration(settings.name)
        if not path.is_file():
            return None
    calibration = load_calibration(path)
    problem = _mismatch(calibration, settings)
    if problem and coverage.calibration is None:
        return None  # the shipped one is for other settings: uncalibrated, and check says so
    if problem:
        raise ConfigError(
            f"risk.coverage.calibration {path}: {problem}; calibrate what you run: "
            f"hri-predict calibrate --predictor {settings.name}"
        )
    return calibration


def _mismatch(calibration: Calibration, settings: PredictorSettings) -> str:
    if calibration.predictor != settings.name:
        return f"is of predictor {calibration.predictor}, not {settings.name}"
    if calibration.rate_hz != settings.rate_hz:
        return f"is for {calibration.rate_hz:g} steps per second, not {settings.rate_hz:g}"
    values, weights = identity(settings)
    for key in sorted(values.keys() | calibration.settings.keys()):
        if values.get(key) != calibration.settings.get(key):
            return f"was made with {key} {calibration.settings.get(key)}, not {values.get(key)}"
    if calibration.weights != weights:
        return "was made with other weights"
    return ""


def levels_text(calibration: Calibration, missing: Sequence[str] = SPEED_CLASSES) -> list[str]:
    """One line per level: guaranteed, or estimated and how many recordings are missing."""
    lines = []
    for level in LEVELS:
        lacks = {
            name: needed(level) - calibration.independent(index)
            for index, name in enumerate(missing)
        }
        short = ", ".join(f"{n} more with people {name}" for name, n in lacks.items() if n > 0)
        said = f"estimated; a guarantee takes {short}" if short else "guaranteed"
        lines.append(f"{100 * level:g} %: {said}")
    return lines
