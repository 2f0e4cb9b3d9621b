"""The self-check on recorded people: silent on walking, awake on what was not calibrated."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from hri_predict.contracts.predictor import Forecast
from hri_predict.lab.datasets.disturbances import Disturbance
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.baselines import ConstantVelocity, ConstantVelocitySettings
from hri_predict.recording.opening import open_recording
from hri_predict.zones.motion_ranges import MotionRanges, motion_ranges
from hri_predict.zones.self_check.past_forecasts import forecast_errors
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants

DATA = Path(__file__).resolve().parents[5] / "shared" / "data" / "cmu_mocap"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data")

RATE_HZ = 24.0  # every fifth frame
STEPS = 15
LEVEL = 0.95
PREDICTOR = ConstantVelocity(
    ConstantVelocitySettings(
        name="constant_velocity", rate_hz=RATE_HZ, horizon_s=STEPS / RATE_HZ, history_s=0.5
    )
)
T = 13


@lru_cache
def body(name):
    """(F, J, 3) and (F, J) of a recording."""
    recording = open_recording(DATA / f"{name}.npz")
    people = [scene.people[0] for scene in recording.scenes[::5]]
    mapped = [recording.joint_map.map(p.positions, p.observed) for p in people]
    return np.array([m[0] for m in mapped]), np.array([m[1] for m in mapped])


def windows(positions, observed):
    """Histories (N, T, J, 3), what was observed, and forecasts, at frames T - 1 and later."""
    at = np.arange(T)[None] + np.arange(len(positions) - T + 1)[:, None]
    return positions[at], observed[at], PREDICTOR.predict(positions[at], observed[at]).positions


@lru_cache
def calibrated() -> tuple[np.ndarray, MotionRanges]:
    """Radii (H, J) that hold 95 % of bodies of six walks, and what those were like."""
    histories, seen, errors = [], [], []
    for number in range(24, 30):
        positions, observed = body(f"train/walking_extra_{number}")
        history, known, forecast = windows(positions, observed)
        count = len(history) - STEPS
        by_step = [
            forecast_errors(
                history[:count, -1],
                forecast[:count],
                np.full(count, k + 1.0),
                positions[T + k : T + k + count],
            )
            for k in range(STEPS)
        ]
        histories.append(history[:count])
        seen.append(known[:count])
        errors.append(np.stack(by_step, axis=1))
    error = np.concatenate(errors)
    shape = np.quantile(error, LEVEL, axis=0)
    known = np.concatenate(seen).any((0, 1))
    worst = (error[..., known] / shape[..., known]).max(-1)
    radius = shape * np.quantile(worst, LEVEL, axis=0)[:, None]
    ranges = motion_ranges(
        np.concatenate(histories), np.concatenate(seen), RATE_HZ, ratio_short=1.5
    )
    return radius, ranges


def replay(positions, observed):
    """Whether out of distribution, and the largest factor, of each tick, and the report."""
    radius, ranges = calibrated()
    check = SelfCheck(
        SelfCheckConstants(),
        level=LEVEL,
        of="body",
        rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        ranges=ranges,
    )
    out_of_distribution, widened = [], []
    history, known, forecast = windows(positions, observed)
    for tick in range(len(history)):
        capture = 10**9 + round(tick / RATE_HZ * 1e9)
        snapshot = PeopleSnapshot(
            now_ns=capture + 20_000_000,
            ids=(1,),
            history=history[tick : tick + 1],
            observed=known[tick : tick + 1],
            capture_ns=np.array([capture]),
            last_positions=history[tick : tick + 1, -1],
            joint_age_s=np.where(known[tick : tick + 1, -1], 0.0, np.inf),
            lost=(),
            reasons=(),
            newest_capture_ns=capture,
            captures=tick,
            counters={},
        )
        trust = check.check(snapshot)
        check.note(snapshot, Forecast(forecast[tick : tick + 1], None), radius[None])
        out_of_distribution.append(bool(trust.out_of_distribution[0]))
        widened.append(float(trust.widen.max()))
    return np.array(out_of_distribution), np.array(widened), check.report()


def disturbed(name, disturbance):
    positions, observed = body(name)
    stamps = np.round(np.arange(len(positions)) / RATE_HZ * 1e9).astype(np.int64)
    return disturbance.apply(positions, observed, stamps, (0, 1)), observed


@pytest.mark.parametrize("name", ["walking_1", "walking_extra_10", "walking_extra_15"])
def test_walking_is_never_out_of_distribution(name):
    out_of_distribution, widened, report = replay(*body(f"test/{name}"))
    assert not out_of_distribution.any()
    assert (widened >= 1).all()
    assert report["covered"] > LEVEL - 0.05


@pytest.mark.parametrize("scale", [0.7, 1.4])
def test_a_body_of_another_size_that_walks_is_not_out_of_distribution(scale):
    out_of_distribution, widened, _ = replay(
        *disturbed("test/walking_1", Disturbance("scale", scale))
    )
    assert out_of_distribution.mean() < 0.05
    assert (widened >= 1).all()


def test_a_shifted_camera_is_out_of_distribution_at_once():
    shift = Disturbance("shift", 0.2, at_s=1.5)
    out_of_distribution, _, _ = replay(*disturbed("test/walking_1", shift))
    first = 36 - (T - 1)  # 1.5 s x 24 Hz, and the first tick is at frame T - 1
    assert not out_of_distribution[:first].any()
    assert out_of_distribution[first : first + 24].all()  # held for a second


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_noise_widens_or_is_out_of_distribution(sigma):
    noise = Disturbance("noise", sigma)
    out_of_distribution, widened, report = replay(*disturbed("test/walking_1", noise))
    answered = out_of_distribution | (widened > 1)
    assert answered[3:].all()
    assert report["covered_as_calibrated"] < LEVEL - 0.1
    if sigma > 0.03:
        assert out_of_distribution.mean() > 0.8


def test_jumping_is_covered_better_and_running_is_out_of_distribution():
    out_of_distribution, _, report = replay(*body("test/jumping_1"))
    assert report["covered"] > report["covered_as_calibrated"] + 0.2
    assert out_of_distribution.mean() > 0.5
    out_of_distribution, _, _ = replay(*body("test/running_1"))
    assert out_of_distribution.mean() > 0.5
