"""Share of joints held with a live tracker's noise: ``docs/measured/tracker-noise.md``.

    python -m tests.hri_predict.zones.noise_table ../shared/data [--predictor sinn] [--list test]

Recordings are seen by noisy trackers, forecast, and compared with what the tracker delivers later:
with the calibration as it ships, and without the growth of its radii with noise. Seeds, strengths
and kinds of noise are others than those that the growth was fitted to.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import hri_predict as hri
from hri_predict.base.skeleton import CANONICAL
from hri_predict.lab.calibration.coverage import Calibrated, as_run
from hri_predict.lab.calibration.depth_tracker import DepthTracker
from hri_predict.lab.calibration.noise import See, as_recorded, scores_seen
from hri_predict.lab.calibration.presence import Presence
from hri_predict.lab.calibration.scores import Scores, evidence_of
from hri_predict.lab.calibration.toward import truth_at
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.zones.calibration import Calibration, load_calibration
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import CoverageSettings
from hri_predict.zones.toward import direction_class, ways

AT_S = (0.12, 0.2, 0.4, 0.6, 0.8, 1.0)
LISTS = {"test": (1, 2), "left_out": (1, 1), "test_motion": (2, 3)}
"""Every such recording is judged, and of these every such one with the self-check, which takes the
zones of each window."""
LEVELS = (0.9, 0.99)
SEED = 10


def white(presence: Presence, seed: int) -> Presence:
    """2 cm of white noise on each coordinate."""
    seen = as_recorded(presence, seed)
    noise = 0.02 * np.random.default_rng(seed).standard_normal(seen.positions.shape)
    shown = np.where(seen.observed[..., None], seen.positions + noise, 0.0)
    return replace(seen, positions=shown)


TRACKERS: dict[str, See] = {
    "as recorded": as_recorded,
    "depth, strength 0.5": DepthTracker(strength=0.5).seen,
    "depth, strength 1": DepthTracker().seen,
    "depth, strength 2": DepthTracker(strength=2.0).seen,
    "strength 1.5, heavier tails, lasts 0.3 to 2 s": DepthTracker(
        strength=1.5, tail=2.5, lasts_s=(0.3, 2.0)
    ).seen,
    "normal, lasts 0.05 to 0.2 s, depth in steps of 3 cm": DepthTracker(
        strength=0.8, tail=np.inf, lasts_s=(0.05, 0.2), quantum_m=0.03
    ).seen,
    "white, 2 cm": white,
}


def judged(scored: Sequence[Scores], calibration: Calibration, level: float) -> Any:
    """(4, H) joints in the ball, along level directions, along the motion; known; and radii."""
    radii = Radii(calibration, CoverageSettings(level=level), CANONICAL, calibration.steps)
    total: Any = np.zeros((5, calibration.steps))
    rng = np.random.default_rng(0)
    for each in scored:
        radius, shares = radii.of(each.speed_m_s, evidence_of(each)), radii.shares(each.speed_m_s)
        assert shares is not None
        known = np.isfinite(each.error_m) & np.isfinite(radius)
        miss = truth_at(each, each.forecast.shape[1], calibration.rate_hz) - each.forecast
        way = ways(each.forecast - each.history[:, -1:])
        flat = rng.normal(size=miss.shape) * [1.0, 1.0, 0.3]
        flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
        moving = (np.abs(way).sum(-1) > 0) & (np.abs(way[..., 2]) < 0.6)
        known &= np.isfinite(miss).all(-1)
        hits = [each.error_m <= radius]
        for direction in (flat, np.where(moving[..., None], way, flat)):
            share = np.take_along_axis(shares, direction_class(direction, way), axis=2)
            hits.append(np.einsum("whji,whji->whj", miss, direction) <= share * radius)
        rows = [*(hit & known for hit in hits), known, np.where(known, radius, 0.0)]
        total += np.array([row.sum((0, 2)) for row in rows])
    return total


def row(title: str, values: Any, digits: int = 1) -> None:
    """Print one line of the table."""
    print(f"| {title} |", " | ".join(f"{v:.{digits}f}" for v in values), "|", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("--predictor", default="sinn")
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--list", action="append", choices=LISTS)
    options = parser.parse_args()
    predictor = hri.load_predictor(options.predictor, horizon_s=1.2)
    calibration = hri.load_calibration_of(options.predictor, horizon_s=1.2)
    if options.calibration is not None:
        calibration = load_calibration(options.calibration)
    assert calibration is not None
    steps = [round(at * predictor.rate_hz) - 1 for at in AT_S]
    versions = {"before": replace(calibration, noise=None), "after": calibration}
    for name in options.list or LISTS:
        each, checked = LISTS[name]
        paths = [p for p in (in_pack(options.data, n) for n in split(name)) if p.exists()][::each]
        for i, (title, see) in enumerate(TRACKERS.items()):
            scored = scores_seen(predictor, paths, see, seed=SEED + i)
            windows = sum(len(s.origin_ns) for s in scored)
            print(f"{name}, {title}: {len(paths)} recordings, {windows} windows")
            names = list(dict.fromkeys(s.name for s in scored))[::checked]
            some = [s for s in scored if s.name in names]
            for level in LEVELS:
                found = {}
                for version, used in versions.items():
                    total = found[version] = judged(scored, used, level)
                    for way, hits in zip(("ball", "level", "ahead"), total, strict=False):
                        row(f"{level} {version}, {way}", 100 * (hits / total[3])[steps])
                row(f"{level} radius, times", (found["after"][4] / found["before"][4])[steps], 3)
                for version, used in versions.items():
                    settings = CoverageSettings(level=level)
                    coverage = as_run(some, Calibrated(predictor, used), settings)
                    row(f"{level} {version}, self-check", 100 * coverage.share("joint")[steps])


if __name__ == "__main__":
    main()
