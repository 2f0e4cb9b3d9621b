"""Predictors compared by a command: ``--predictor NAME`` or ``NAME=WEIGHTS``, side by side.

Every comparison prints the basis of their zones: without a calibration, zones follow from the
physical limits alone, so the predictor appears worse than its forecasts are.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.recording.recording import names_of
from hri_predict.run.config import Config
from hri_predict.run.zone_basis import ZoneBasis
from hri_predict.zones.calibration import (
    calibration_for,
    load_calibration,
    mismatch,
    shipped_calibration,
)
from hri_predict.zones.settings import CoverageSettings


@dataclass(frozen=True, kw_only=True)
class ComparedPredictor:
    """One predictor of a comparison.

    Attributes:
        name: its registered name.
        weights: its weights file; ``None``: the shipped weights, or none.
        label: its name in tables, with the name of the weights if the same predictor occurs twice.
    """

    name: str
    weights: Path | None
    label: str


def _same_file(pair: tuple[str, Path | None]) -> tuple[str, str | None]:
    name, weights = pair
    return name, None if weights is None else os.path.realpath(weights)


def asked_predictors(texts: Sequence[str]) -> list[ComparedPredictor]:
    """Parse each ``NAME`` or ``NAME=WEIGHTS``; a name may occur several times with different
    weights.

    Raises:
        ConfigError: a predictor is given twice, or a text is incomplete.
    """
    pairs: list[tuple[str, Path | None]] = []
    for text in texts:
        name, equals, file = text.partition("=")
        if not name or (equals and not file):
            raise ConfigError(f"--predictor {text}: write NAME or NAME=WEIGHTS.safetensors")
        pair = (name, Path(file) if equals else None)
        if _same_file(pair) in map(_same_file, pairs):
            raise ConfigError(
                f"--predictor {text}: given twice; name each predictor once, or give different "
                "weights: "
                f"{name}=WEIGHTS.safetensors"
            )
        pairs.append(pair)
    labels = iter(names_of([weights for _, weights in pairs if weights is not None]))
    asked = []
    for name, weights in pairs:
        label = name
        if weights is not None:
            own = next(labels).removesuffix(weights.suffix)
            if [other for other, _ in pairs].count(name) > 1:
                label = f"{name}={own}"
        asked.append(ComparedPredictor(name=name, weights=weights, label=label))
    return asked


def demand_weights(asked: ComparedPredictor) -> None:
    """Check that a predictor accepts weights, if any are given.

    Raises:
        ConfigError: the predictor does not exist, or does not use weights.
    """
    model = registry.predictor_settings(asked.name)
    if asked.weights is not None and "weights" not in model.model_fields:
        raise ConfigError(f"--predictor {asked.name}={asked.weights}: does not use weights")


def with_predictor(config: Config, text: str) -> Config:
    """Return the configuration with ``NAME`` or ``NAME=WEIGHTS`` as its predictor."""
    (asked,) = asked_predictors([text])
    settings: dict[str, Any] = {"horizon_s": config.predictor.horizon_s}
    if asked.name == config.predictor.name:  # its other weights: everything else stays
        settings = config.predictor.model_dump(exclude={"name"})
    if asked.weights is not None:
        demand_weights(asked)
        settings["weights"] = str(asked.weights.absolute())  # else of the configuration's folder
    return config.with_predictor(asked.name, **settings)


def fitting(calibrations: Sequence[Path], settings: PredictorSettings) -> Path | None:
    """Return the first of these files made for this predictor with its settings and weights.

    Raises:
        ConfigError: a file cannot be read or is not a calibration.
    """
    for path in calibrations:
        if not mismatch(load_calibration(path), settings):
            return path
    return None


def demand_use(calibrations: Sequence[Path], asked: Mapping[str, PredictorSettings]) -> None:
    """Check that each ``--calibration`` belongs to one of the predictors (by label).

    Raises:
        ConfigError: a calibration belongs to none of them, and would be silently ignored.
    """
    for path in calibrations:
        made = load_calibration(path)
        why = {label: mismatch(made, settings) for label, settings in asked.items()}
        if all(why.values()):
            same = [label for label, each in asked.items() if each.name == made.predictor]
            said = f"is of predictor {made.predictor}" if not same else why[same[0]]
            told = ", ".join(asked) if not same else same[0]
            raise ConfigError(
                f"--calibration {path}: {said}, and fits none of --predictor {told}; name its "
                f"predictor, or calibrate what you run: hri-predict calibrate"
            )


def basis_of(
    asked: ComparedPredictor,
    settings: PredictorSettings,
    coverage: CoverageSettings,
    base_dir: Path,
) -> ZoneBasis:
    """Return the basis of a predictor's zones with these settings.

    Raises:
        ConfigError: see ``calibration_for``.
    """
    found = calibration_for(settings, coverage, base_dir)
    shipped = coverage.calibration is None
    path = shipped_calibration(settings.name) if shipped else base_dir / str(coverage.calibration)
    return ZoneBasis(
        label=asked.label,
        name=asked.name,
        weights=asked.weights,
        calibration=None if found is None else path,
        shipped=shipped,
        horizon_s=settings.horizon_s,
    )
