"""The engine on a UR5e: what it advises, why, and what it never calls clear."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.settings import Region
from hri_predict.base.skeleton import CANONICAL, JOINTS, in_words
from hri_predict.contracts.predictor import Forecast
from hri_predict.protocol.messages import Advice, Level, RobotMode
from hri_predict.protocol.reason_row import Kind
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.separation.stage import RobotFindings
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotSettings
from tests.hri_predict.lost_person import lost_person
from tests.hri_predict.risk.engine_cell import (
    MODEL,
    MODES,
    RATE_HZ,
    READY,
    ROBOT,
    SETTINGS,
    STEPS,
    TICK_NS,
    Cell,
    body,
)


def test_a_stop_that_waits_for_its_release_says_so_and_what_comes_after_that():
    cell = Cell(SETTINGS)
    cell.settle()
    levels: dict[Level, float] = {}
    for x in np.arange(6.0, 0.4, -0.04):
        levels.setdefault(cell.step(x).level, x)
    waits = cell.step(levels[Level.SLOW])
    assert waits.level is Level.STOP
    assert "waiting to release: what stopped it has cleared" in waits.detail
    assert "; slow after that: a person may get too close" in waits.detail


@MODES
def test_a_person_who_comes_and_goes(mode):
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    assert cell.settle().level is Level.CLEAR
    levels = [cell.step(x).level for x in np.arange(6.0, 0.4, -0.04)]
    order = [Level.CLEAR, Level.WARN, Level.SLOW, Level.STOP]
    if mode == "fixed":  # knows no slow speed
        order.remove(Level.SLOW)
    assert sorted(set(levels), key=order.index) == order
    assert levels == sorted(levels, key=order.index)
    near = cell.step(0.4)
    assert (near.level, near.reason, near.speed_limit_m_s) == (Level.STOP, Reason.PERSON_NEAR, 0.0)
    assert near.time_to_breach_s is not None
    assert "person 10" in near.detail
    assert "clears when" in near.detail
    assert near.body_part is not None
    assert near.robot_link is not None
    assert in_words(CANONICAL.segments[near.body_part].name) in near.detail
    assert in_words(MODEL.capsule_names[near.robot_link]) in near.detail
    assert cell.settle(6.0).level is Level.CLEAR


@MODES
def test_a_robot_that_stands_near_a_person_is_told_to_stay(mode):
    data = ROBOT.model_dump() | {"motion": {"kind": "standing", "positions": list(READY)}}
    robot = RobotSettings.model_validate(data)
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}), robot=robot)
    advice = cell.settle(0.7)
    assert (advice.level, advice.speed_limit_m_s) == (Level.STOP, 0.0)
    assert cell.settle(6.0).level is Level.CLEAR


@MODES
def test_the_separation_is_the_distance(mode):
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    advice = cell.settle(3.0)
    capsules = MODEL.capsules(np.array(READY))
    # nothing of the robot is farther along x than this, nothing of the body nearer than that
    front = (np.maximum(capsules.a, capsules.b)[:, 0] + capsules.radius).max()
    assert advice.separation_m == pytest.approx(3.0 - front, abs=0.3)
    assert advice.predicted_separation_m is not None
    assert advice.separation_m is not None
    assert advice.predicted_separation_m < advice.separation_m
    assert cell.settle().separation_m is None


SCENE = [reason for reason in Reason if reason.row.kind in (Kind.INPUT, Kind.MEMORY)]


@MODES
@pytest.mark.parametrize("reason", SCENE)
def test_what_cannot_be_trusted_is_unknown_at_once(mode, reason):
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    cell.settle()
    advice = cell.step(reasons=(reason,))
    assert (advice.level, advice.reason, advice.speed_limit_m_s) == (Level.UNKNOWN, reason, 0.0)
    assert reason.clears_when in advice.detail
    assert cell.step().level is Level.UNKNOWN  # one good capture is not enough
    assert cell.settle().level is Level.CLEAR


def test_the_engine_looks_at_the_age_itself():
    cell = Cell()
    cell.settle()
    old = cell.now_ns - 1_000_000_000
    advice = cell.step(newest_capture_ns=old)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.INPUT_STALE)
    assert cell.step(newest_capture_ns=None).reason is Reason.NO_INPUT
    assert cell.step(newest_capture_ns=cell.now_ns + 10**9).reason is Reason.CLOCK_JUMP


def test_the_robots_own_reasons():
    cell = Cell()
    cell.settle()
    advice = cell.step(mode=RobotMode.MANUAL)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.ROBOT_NOT_AUTOMATIC)
    cell.settle()
    advice = cell.settle(ticks=4, report=False)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.ROBOT_STATE_STALE)
    assert cell.settle().level is Level.CLEAR
    cell.turn = 100.0
    assert cell.step().reason is Reason.ROBOT_STATE_INVALID


@MODES
def test_without_a_forecast_the_physical_limits_serve(mode):
    cell, why = Cell(SETTINGS.model_copy(update={"mode": mode})), (Reason.PREDICTOR_LATE,)
    assert cell.settle(6.0, forecast=None, why=why).level is Level.CLEAR
    reason = cell.step(6.0, forecast=None, why=why).reason
    assert reason is (Reason.NONE if mode == "reactive" else Reason.PREDICTOR_LATE)
    assert cell.assessment.reasons == (() if mode == "reactive" else why)
    assert cell.step(0.7, forecast=None, why=why).level is Level.STOP


def test_reactive_gives_nothing_for_a_forecast():
    advices = []
    for drift in (0.0, 2.0, np.nan):
        cell = Cell(SETTINGS.model_copy(update={"mode": "reactive"}))
        for x in np.arange(4.0, 1.0, -0.04):
            forecast = Forecast(cell.still(cell.snapshot(x)).positions + drift, None)
            advice = cell.step(x, forecast=forecast)
        advices.append(advice)
    assert advices[0] == advices[1] == advices[2]
    assert advices[0].level is Level.STOP


@MODES
def test_who_runs_is_named_and_counts_as_fast(mode):
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    back = np.arange(STEPS - 1, -1, -1)[:, None, None] / RATE_HZ
    observed = np.ones((1, STEPS, len(JOINTS)), bool)
    found = {}
    for speed in (1.5, 3.0):  # towards the robot
        run = body(2.2)[None] + back * np.array([speed, 0.0, 0.0])
        found[speed] = cell.settle(2.2, history=run[None], observed=observed)
        assert ("is fast: waist 3.0 m/s" in found[speed].detail) == (speed == 3.0)
    walked, ran = np.array([a.speed_limit_m_s for a in found.values()], float)  # None becomes NaN
    assert ran < walked if mode == "iso" else ran <= walked
    far = cell.settle(8.0, history=run[None], observed=observed)
    assert (far.level, far.reason) == (Level.CLEAR, Reason.PERSON_FAST)
    assert "no person is too close; note: " in far.detail  # else it contradicts the level
    assert "clears when" not in far.detail


@pytest.mark.parametrize(
    ("turn", "words"), [(0.3, "the robot's present speed"), (0.0, "the standing robot to start")]
)
def test_how_much_too_close_is_said_of_the_robot_as_it_moves(turn, words):
    cell = Cell(SETTINGS.model_copy(update={"mode": "iso"}))
    cell.turn = turn
    detail = cell.settle(0.6).detail
    assert re.search(rf"\d m too close for {words}", detail)


def test_the_distance_that_is_told_is_that_of_the_pair_that_is_named():
    cell = Cell(SETTINGS.model_copy(update={"mode": "predictive"}))
    cell.settle(3.0)
    for x in np.arange(3.0, 1.2, -0.04):  # somebody walks up: not the nearest part decides
        advice = cell.step(x)
    told = re.search(r"person 10, ([\w ]+), ([\d.]+) m from ([\w ]+)", advice.detail)
    assert told is not None
    zones, (robot,) = cell.assessment.zones, cell.assessment.grounds
    segment = [in_words(name) for name in zones.segments].index(told[1])
    link = [in_words(name) for name in MODEL.capsule_names].index(told[3])
    body, arm = zones.capsules, robot.capsules
    assert arm is not None
    apart = capsule_distance(
        Capsules(body.a[0, 0, segment], body.b[0, 0, segment], body.radius[0, 0, segment]),
        Capsules(arm.a[link], arm.b[link], arm.radius[link]),
    )
    assert float(told[2]) == pytest.approx(max(float(apart), 0.0), abs=0.0051)  # two decimals


def test_a_forecast_that_is_no_forecast_is_not_used():
    cell = Cell(SETTINGS.model_copy(update={"mode": "predictive"}))
    cell.settle(6.0)
    wrong = cell.still(cell.snapshot(6.0))
    wrong.positions[0, 3, 2, 1] = np.nan
    for forecast in (wrong, Forecast(wrong.positions[:, :4] * 0, None)):
        assert cell.step(6.0, forecast=forecast).reason is Reason.PREDICTOR_FAILED
        assert np.isfinite(cell.assessment.zones.capsules.a).all()


@MODES
def test_a_lost_person_counts(mode):
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    cell.settle(3.5)
    lost = lost_person(7, body(3.5), cell.now_ns)
    advices = [cell.step(lost=(lost,)) for _ in range(40)]
    limits = [advice.speed_limit_m_s for advice in advices]
    assert (advices[-1].level, advices[-1].reason) == (Level.STOP, Reason.PERSON_LOST)
    assert limits == sorted(limits, reverse=True)
    assert limits[-1] == 0.0


def test_a_latched_stop():
    cell = Cell(SETTINGS.model_copy(update={"latch": ["stop"]}))
    cell.settle(6.0)
    stopped = cell.step(0.7)
    assert (stopped.latch_id, stopped.detail.endswith("; latch: stop")) == (0, True)
    advice = cell.settle(6.0)
    latch = advice.latch_id
    assert (advice.level, advice.reason) == (Level.STOP, Reason.LATCHED)
    assert advice.detail.endswith(f"; latch {latch}: stop")
    assert cell.engine.acknowledge(latch)
    assert not cell.engine.acknowledge(latch)
    assert cell.step(6.0).level is Level.STOP
    assert cell.settle(6.0).level is Level.CLEAR
    cell.step(0.7)
    assert cell.settle(6.0).latch_id not in (0, latch)


def test_what_is_wrong_with_the_state_file_is_named_until_that_latch_is_acknowledged():
    cell = Cell(SETTINGS.model_copy(update={"latch": ["stop", "restart"]}))
    cell.engine.distrust("there is no state file x")
    advice = cell.settle(6.0)
    assert advice.detail.endswith(": stop, restart (there is no state file x)")
    assert not cell.engine.acknowledge(advice.latch_id + 1)
    assert "no state file" in cell.settle(6.0).detail
    assert cell.engine.acknowledge(cell.settle(6.0).latch_id)
    cell.settle(0.9)
    later = cell.settle(6.0)
    assert later.detail.endswith(f"; latch {later.latch_id}: stop")


def test_a_named_zone():
    door = NamedZoneSettings(
        name="door", polygon=[[5, -1], [6, -1], [6, 1], [5, 1]], level="slow", speed_limit_m_s=0.2
    )
    cell = Cell(zones=(door,))
    assert cell.settle(8.0).level is Level.CLEAR
    advice = cell.step(5.5)
    assert (advice.level, advice.reason) == (Level.SLOW, Reason.ZONE_OCCUPIED)
    assert advice.speed_limit_m_s == 0.2
    assert "door" in advice.detail
    assert cell.assessment.named_zones[0].occupied
    cell.step(8.0, reasons=(Reason.SOURCE_BLIND,))
    assert cell.assessment.named_zones[0].occupied  # who knows
    with pytest.raises(ConfigError, match="did you mean 'arm'"):
        Cell(zones=(door.model_copy(update={"robots": ["amr"]}),))


@MODES
def test_what_the_sensor_does_not_see_is_occupied(mode):
    def square(half: float) -> Region:
        return Region(polygon=[[-half, -half], [half, -half], [half, half], [-half, half]])

    risk = SETTINGS.model_copy(update={"mode": mode})
    assert Cell(risk, view=square(5.0)).settle().level is Level.CLEAR
    slow = Cell(risk, view=square(1.9)).settle()
    assert (slow.level, slow.reason) == (Level.SLOW, Reason.OUT_OF_VIEW)
    stop = Cell(risk, view=square(1.0)).settle()
    assert (stop.level, stop.reason) == (Level.STOP, Reason.OUT_OF_VIEW)


def test_a_delay_past_the_horizon():
    with pytest.raises(ConfigError, match=r"predictor\.horizon_s"):
        Cell(horizon_steps=10)
    limits = SETTINGS.limits.model_copy(update={"extend_beyond_horizon": True})
    risk = SETTINGS.model_copy(update={"mode": "predictive", "limits": limits})
    extended = Cell(risk, horizon_steps=10)
    assert extended.settle(6.0).level is Level.CLEAR
    cell = Cell(SETTINGS.model_copy(update={"mode": "predictive"}))
    cell.settle(6.0)
    late = np.array([cell.now_ns + TICK_NS - 700_000_000])
    advice = cell.step(6.0, capture_ns=late)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.HORIZON_TOO_SHORT)


def test_the_advice_rests_on_the_oldest_capture():
    cell = Cell()
    captures = np.array([cell.now_ns - 30_000_000, cell.now_ns - 10_000_000])
    assert cell.step(4.0, 5.0, capture_ns=captures).capture_ns == captures.min()


@MODES
def test_the_separation_stage_has_no_memory(mode):
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    cell.settle(2.0)
    engine, snapshot = cell.engine, cell.snapshot(1.5)
    bodies = engine.zones(snapshot, cell.still(snapshot))
    robots = engine.robots(snapshot.now_ns)
    found = engine.separation(bodies, robots)
    assert found.robots[0].people is not None
    elsewhere = cell.snapshot(0.8, 3.0)
    engine.separation(engine.zones(elsewhere, cell.still(elsewhere)), robots)
    assert engine.separation(bodies, robots) == found
    untrusted = replace(bodies, untrusted=(Reason.SOURCE_BLIND,))
    blind = RobotFindings((Reason.SOURCE_BLIND,), asked=robots[0].asked)
    assert engine.separation(untrusted, robots).robots == (blind,)


def test_an_exception_leaves_nothing_that_speaks_for_a_release(monkeypatch):
    cell = Cell()
    cell.settle(6.0)
    with pytest.raises(AttributeError):
        cell.engine.assess(None, None)  # type: ignore[arg-type]
    assert cell.step(6.0).level is Level.UNKNOWN


@MODES
@settings(max_examples=25)
@given(
    x=st.floats(0.3, 4.0),
    nearer=st.floats(0, 1.0),
    turn=st.floats(-1.0, 1.0),
    drift=st.floats(-1.0, 1.0),
)
def test_nearer_never_raises_the_limit_or_lowers_the_level(mode, x, nearer, turn, drift):
    """Along the line from the robot's base, on the side where the arm is."""

    def advice(at: float) -> Advice:
        cell = Cell(RiskSettings(mode=mode, release_captures=1, speed_rise_m_s2=100.0))
        cell.turn = turn
        for _ in range(3):
            here = cell.snapshot(at)
            ahead = np.arange(1, STEPS + 1)[None, :, None, None] / RATE_HZ
            moving = here.last_positions[:, None] + ahead * np.array([drift, 0.0, 0.0])
            result = cell.step(at, forecast=Forecast(moving, None))
        return result

    far, near = advice(x + 1.3 + nearer), advice(x + 1.3)
    assert near.speed_limit_m_s is not None
    assert far.speed_limit_m_s is not None
    assert near.speed_limit_m_s <= far.speed_limit_m_s
    assert near.level.rank >= far.level.rank


@MODES
@settings(max_examples=25)
@given(
    where=st.sampled_from(["last_positions", "joint_age_s", "forecast", "both"]),
    value=st.sampled_from([np.nan, np.inf, -np.inf]),
    whole=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_numbers_that_are_none_never_give_clear_near_a_person(mode, where, value, whole, seed):
    rng = np.random.default_rng(seed)
    cell = Cell(SETTINGS.model_copy(update={"mode": mode}))
    cell.settle(0.9, ticks=5)
    snapshot = cell.snapshot(0.9)
    last, age = snapshot.last_positions.copy(), snapshot.joint_age_s.copy()
    forecast = cell.still(snapshot)
    hit = np.ones(len(JOINTS), bool) if whole else rng.random(len(JOINTS)) < 0.5
    if where in ("last_positions", "both"):
        last[0, hit] = value
    if where in ("joint_age_s", "both"):
        age[0, hit] = value
    if where in ("forecast", "both"):
        forecast.positions[0, :, hit] = value
    for _ in range(8):
        advice = cell.step(0.9, last_positions=last, joint_age_s=age, forecast=forecast)
        assert advice.level.rank == Level.STOP.rank
        assert advice.speed_limit_m_s == 0.0
        for number in (advice.separation_m, advice.predicted_separation_m, advice.time_to_breach_s):
            assert number is None or np.isfinite(number)
        capsules = cell.assessment.zones.capsules
        assert np.isfinite(capsules.a).all()
        assert np.isfinite(capsules.b).all()
        assert np.isfinite(capsules.radius).all()
