"""Compiled loops and array operations give the same zones."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.body.standing import standing_body
from hri_predict.people.snapshot import Inferred, LostPerson, PeopleSnapshot, RecentCaptures
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.warm_up_people import made_up_ticks
from hri_predict.zones import (
    body_zones,
    human_speed,
    joint_speeds,
    joint_zones,
    learned_scale,
    radii,
)
from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.calibration import load_calibration, shipped_calibration
from hri_predict.zones.self_check import self_check
from hri_predict.zones.settings import CoverageSettings, HumanLimits

pytest.importorskip("numba", reason="extra accel is not installed")

RATE_HZ, STEPS, HISTORY, TICK_NS = 25.0, 25, 25, 40_000_000
COUNT = len(JOINTS)
CALIBRATION = load_calibration(shipped_calibration("constant_velocity"))
KERNELS: tuple[tuple[Any, str], ...] = (
    (human_speed, "_velocities"),
    (human_speed, "_moving"),
    (joint_speeds, "_measured"),
    (radii, "_radii"),
    (joint_zones, "_spheres"),
    (body_zones, "_capsules"),
    (self_check, "verdict"),
)
# the learned scale is compiled on both sides: in single precision its sums differ by their order,
# and test_learned_scale compares both versions with double precision
# a cut's radius is the root of a difference: what differs by 2e-16 of 1 may differ by 1e-8 of it
# afterwards; times ten, for the cuts that follow each other along a limb
TOLERANCE: Any = {"rtol": 1e-7, "atol": 1e-7}


def engine_of(**own: Any) -> RiskEngine:
    coverage, limits = own.get("coverage", CoverageSettings()), own.get("limits", HumanLimits())
    return RiskEngine(
        settings=RiskSettings(mode="predictive", coverage=coverage, limits=limits),
        robots=[],
        skeleton=CANONICAL,
        absent_parts=own.get("absent", []),
        named_zones=[],
        field_of_view=None,
        budget=DelayBudget.from_settings(RATE_HZ, [LinkSettings(name="bus", kind="can")], 0.1),
        forecast_rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        calibration=CALIBRATION if own.get("calibrated", True) else None,
    )


def ticks_of(
    seed: int, people: int, hidden: float, *, lost: int = 0, std: bool = False, ticks: int = 6
) -> Iterator[tuple[PeopleSnapshot, Forecast | None]]:
    """People who walk and tremble, each joint hidden for a share of the time, and a forecast."""
    random = np.random.default_rng(seed)
    velocity = random.normal(0.0, 1.0, (people, 1, 1, 3)) * [1.0, 1.0, 0.1]
    start = standing_body() + random.uniform(-4.0, 4.0, (people, 1, 1, 3))
    times = np.arange(HISTORY + ticks + STEPS) / RATE_HZ
    path = start + velocity * times[:, None, None]
    path = path + random.normal(0.0, 0.01, path.shape)
    seen: Any = random.random(path.shape[:-1]) >= hidden
    none = np.zeros(COUNT)
    gone = tuple(
        LostPerson(
            id=100 + i,
            positions=standing_body() + random.uniform(-4.0, 4.0, 3),
            joint_age_s=np.where(random.random(COUNT) < hidden, np.inf, 0.02),
            last_seen_ns=TICK_NS * (HISTORY - 5),
            speed_m_s=1.7,
            limbs_m_s=none + 0.5,
        )
        for i in range(lost)
    )
    # joints of each person that are inferred wherever they are seen
    blind: Any = random.random((people, COUNT)) < random.choice([0.0, 0.3])
    for tick in range(ticks):
        now = HISTORY - 1 + tick
        window = slice(now + 1 - HISTORY, now + 1)
        age = np.argmax(seen[:, window][:, ::-1], axis=1)  # steps since each joint was seen
        ever = seen[:, window].any(1)
        joints = blind & seen[:, now]
        inferred = Inferred(
            joints=joints,
            within_m=np.where(joints, random.uniform(0.02, 0.3, joints.shape), 0.0),
            measured=seen[:, window] & ~blind[:, None],
            shown=~blind,
        )
        last = np.take_along_axis(path, (now - age)[:, None, :, None], axis=1)[:, 0]
        snapshot = PeopleSnapshot(
            now_ns=now * TICK_NS + 15_000_000,
            ids=tuple(range(people)),
            history=path[:, window],
            observed=seen[:, window],
            capture_ns=np.full(people, now * TICK_NS, np.int64),
            last_positions=np.where(ever[..., None], last, np.nan),
            joint_age_s=np.where(ever, age / RATE_HZ, np.inf),
            lost=gone,
            reasons=(),
            newest_capture_ns=now * TICK_NS,
            captures=tick,
            counters={},
            recent=RecentCaptures.of_history(path[:, window], seen[:, window], RATE_HZ)
            if random.random() < 0.5
            else None,
            inferred=inferred if joints.any() else None,
        )
        ahead = path[:, now + 1 : now + 1 + STEPS] * random.uniform(0.98, 1.02)
        spread = np.abs(random.normal(0.0, 0.1, ahead.shape[:-1])) if std else None
        yield snapshot, None if random.random() < 0.1 else Forecast(ahead, spread)


def by_arrays(patch: pytest.MonkeyPatch) -> None:
    for module, name in KERNELS:
        patch.setattr(module, name, getattr(module, name).__wrapped__)


def close(ours: Any, theirs: Any) -> None:
    np.testing.assert_allclose(ours, theirs, **TOLERANCE)


def same(found: BodyZones, expected: BodyZones) -> None:
    for part in ("a", "b", "radius"):
        for which in (lambda b: b.zones.capsules, lambda b: b.paths, lambda b: b.captured):
            ours, theirs = getattr(which(found), part), getattr(which(expected), part)
            close(ours, theirs)
    close(found.segments_m_s, expected.segments_m_s)
    np.testing.assert_array_equal(found.as_assumed, expected.as_assumed)
    assert found.reasons == expected.reasons
    for name in ("fast", "unknown", "fastest_joint"):
        ours, theirs = getattr(found.speeds, name), getattr(expected.speeds, name)
        np.testing.assert_array_equal(ours, theirs)
    for name in ("fastest_m_s", "beyond_standard_m_s"):
        ours, theirs = getattr(found.speeds, name), getattr(expected.speeds, name)
        close(ours, theirs)
    assert (found.claimed is None) == (expected.claimed is None)
    if found.claimed is not None:
        close(found.claimed, expected.claimed)
    assert (found.toward is None) == (expected.toward is None)
    if found.toward is not None and expected.toward is not None:
        for mine, other in zip(found.toward, expected.toward, strict=True):
            close(mine, other)


def compare(ticks: list[tuple[PeopleSnapshot, Forecast | None]], **own: Any) -> None:
    compiled = engine_of(**own)
    ours = [compiled.zones(*tick) for tick in ticks]
    with pytest.MonkeyPatch.context() as patch:
        by_arrays(patch)
        arrays = engine_of(**own)
        theirs = [arrays.zones(*tick) for tick in ticks]
    for found, expected in zip(ours, theirs, strict=True):
        same(found, expected)
    mine, other = compiled.self_check(), arrays.self_check()
    assert (mine is None) == (other is None)
    if mine is not None and other is not None:
        for key in ("judged", "judged_in_use", "ticks_widened", "ticks_unlike"):
            assert mine[key] == other[key]


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**16),
    people=st.integers(0, 4),
    hidden=st.sampled_from([0.0, 0.2, 0.7, 1.0]),
    calibrated=st.booleans(),
    lost=st.integers(0, 2),
    of=st.sampled_from(["joint", "body"]),
)
def test_loops_and_arrays_give_the_same_zones(
    seed: int, people: int, hidden: float, calibrated: bool, lost: int, of: Any
) -> None:
    ticks = list(ticks_of(seed, people, hidden, lost=lost))
    compare(ticks, calibrated=calibrated, coverage=CoverageSettings(of=of))


@pytest.mark.parametrize("calibrated", [True, False])
def test_loops_and_arrays_give_the_same_zones_of_sixteen_people(calibrated: bool) -> None:
    compare(list(ticks_of(1, 16, 0.1, ticks=8)), calibrated=calibrated)


def test_loops_and_arrays_agree_where_parts_of_the_body_are_absent() -> None:
    compare(list(ticks_of(2, 2, 0.2)), absent=["left_leg", "right_arm"])


def test_loops_and_arrays_agree_where_the_forecast_tells_its_spread() -> None:
    for calibrated in (True, False):
        ticks = list(ticks_of(3, 2, 0.1, std=True))
        compare(ticks, calibrated=calibrated, limits=HumanLimits(std_factor=2.0))


def test_loops_and_arrays_take_a_forecast_that_is_no_number_as_no_radius() -> None:
    ticks = list(ticks_of(4, 1, 0.0))
    broken = ticks[2][1]
    assert broken is not None
    beyond = np.full_like(broken.positions, np.inf)
    evidence = learned_scale.Evidence(
        history=ticks[2][0].history,
        observed=ticks[2][0].observed,
        forecast=beyond,
        error_m=np.full((1, 2, COUNT), np.nan),
        residual_m=np.full(1, np.nan),
    )
    scale = learned_scale.LearnedScale(CALIBRATION.scale, CANONICAL, RATE_HZ, STEPS)
    with np.errstate(all="ignore"), pytest.MonkeyPatch.context() as patch:
        ours = scale(evidence)
        patch.setattr(learned_scale, "_scale", learned_scale._scale.__wrapped__)  # type: ignore[attr-defined]
        np.testing.assert_array_equal(np.isinf(ours), np.isinf(scale(evidence)))


def test_warming_up_leaves_no_trace() -> None:
    ticks = list(ticks_of(5, 2, 0.1))
    cold, warm = engine_of(), engine_of()
    warm.warm_up()
    for tick in ticks:
        first, second = cold.zones(*tick), warm.zones(*tick)
        np.testing.assert_array_equal(first.zones.capsules.a, second.zones.capsules.a)
        np.testing.assert_array_equal(first.zones.capsules.radius, second.zones.capsules.radius)
    assert cold.self_check() == warm.self_check()


def test_nothing_is_compiled_after_the_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    import numba.core.dispatcher as dispatcher

    engine = engine_of()
    engine.warm_up()
    compiled: list[str] = []
    compile_one = dispatcher.Dispatcher.compile

    def counted(self: Any, sig: Any) -> Any:
        compiled.append(self.py_func.__qualname__)
        return compile_one(self, sig)

    monkeypatch.setattr(dispatcher.Dispatcher, "compile", counted)
    for hidden, lost, people in ((0.0, 0, 1), (0.3, 2, 3), (1.0, 0, 2), (0.2, 1, 0)):
        for snapshot, forecast in ticks_of(6, people, hidden, lost=lost, std=True):
            if forecast is not None:  # a predictor may give single precision, read only
                positions: Any = forecast.positions.astype(np.float32)
                positions.setflags(write=False)
                forecast = Forecast(positions, forecast.std)
            engine.zones(snapshot, forecast)
    assert compiled == []


def test_the_warm_up_compiles_a_scale_that_reads_the_spread() -> None:
    """Without a spread such a scale evaluates nothing, and would be compiled in the first tick."""
    for _, forecast in made_up_ticks(COUNT, STEPS, RATE_HZ):
        assert forecast is None or forecast.std is not None
