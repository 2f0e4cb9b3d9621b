"""How fast people move: velocities on the history, and who is faster than the standard assumes."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL
from hri_predict.people.snapshot import RecentCaptures
from hri_predict.zones.human_speed import (
    GAIT,
    MARGIN_M_S,
    HumanSpeeds,
    SpeedRule,
    Velocities,
    joint_velocities,
)
from hri_predict.zones.joint_speeds import joint_speeds
from hri_predict.zones.settings import HumanLimits

RATE_HZ = 25.0
JOINTS = len(CANONICAL.joints)
LIMITS = HumanLimits()
RULE = SpeedRule(CANONICAL, LIMITS)
ALL = np.ones((1, JOINTS), bool)
ENDS = (
    np.array([s.joint_a for s in CANONICAL.segments]),
    np.array([s.joint_b for s in CANONICAL.segments]),
)
ARMS = [j for side in ("l_", "r_") for j in (side + "elbow", side + "wrist", side + "hand")]


def moving(velocity: ArrayLike, steps: int = 25) -> tuple[Floats, Bools]:
    """One person, every joint at ``velocity`` (3,) or (J, 3)."""
    time = np.arange(1 - steps, 1) / RATE_HZ
    start = np.random.default_rng(3).normal(size=(JOINTS, 3))
    history = start + time[:, None, None] * np.asarray(velocity)
    return history[None], np.ones((1, steps, JOINTS), bool)


def velocities(velocity: ArrayLike) -> Velocities:
    return joint_velocities(*moving(velocity), RATE_HZ)


def velocity_but(base: ArrayLike = (0, 0, 0), **joints: float) -> Floats:
    """(J, 3): all joints at ``base``, the named ones at so many m/s along x."""
    velocity = np.tile(np.asarray(base, float), (JOINTS, 1))
    for name, speed in joints.items():
        velocity[CANONICAL.index(name)] = [speed, 0.0, 0.0]
    return velocity


def judged(velocity: ArrayLike, hidden: list[str] = [], steps: int = 25) -> HumanSpeeds:  # noqa: B006
    history, observed = moving(velocity, steps)
    for name in hidden:
        observed[:, :, CANONICAL.index(name)] = False
    captures = RecentCaptures.of_history(history, observed, RATE_HZ)
    return RULE.moving(joint_speeds(captures), ALL, ENDS).people


# -- velocities on the history ---------------------------------------------------------------------


def test_constant_velocity_is_measured_exactly():
    velocity, measured = joint_velocities(*moving([3.0, -4.0, 0.0]), RATE_HZ)
    np.testing.assert_allclose(velocity, np.tile([3.0, -4.0, 0.0], (1, JOINTS, 1)), atol=1e-12)
    assert measured.all()


def test_a_velocity_is_the_mean_over_a_fifth_of_a_second():
    # x = a t^2 / 2 over t in [-0.2, 0]: the slope of least squares of a parabola on evenly spaced
    # points is its derivative in the middle, a x -0.1; a = 10 gives -1.0 m/s
    history, observed = moving([0.0, 0.0, 0.0])
    time = np.arange(-24, 1) / RATE_HZ
    history[0, :, 0, 0] += 10.0 * time**2 / 2
    velocity, _ = joint_velocities(history, observed, RATE_HZ)
    assert velocity[0, 0, 0] == pytest.approx(-1.0)


@pytest.mark.parametrize("seen", [[], [-1], [-1, -2], [-5, -6]])
def test_what_was_not_observed_long_enough_is_not_measured(seen):
    history, observed = moving([1.0, 0.0, 0.0])
    observed[:, :, 4] = False
    observed[:, seen, 4] = True
    history[:, :, 4] = np.where(observed[:, :, 4, None], history[:, :, 4], np.nan)
    velocity, measured = joint_velocities(history, observed, RATE_HZ)
    assert np.isfinite(velocity).all()
    assert not velocity[0, 4].any()
    assert not measured[0, 4]
    assert measured[0, 3]
    assert velocity[0, 3, 0] == pytest.approx(1.0)


def test_only_observed_steps_count():
    history, observed = moving([1.5, 0.0, 0.0])
    observed[:, -3] = False
    history[:, -3] = 100.0
    np.testing.assert_allclose(joint_velocities(history, observed, RATE_HZ)[0][..., 0], 1.5)


def test_a_short_history_is_not_measured():
    velocity, measured = joint_velocities(*moving([1.0, 0.0, 0.0], steps=2), RATE_HZ)
    assert not measured.any()
    assert not velocity.any()
    nobody = np.zeros((0, 25, JOINTS, 3)), np.zeros((0, 25, JOINTS), bool)
    velocity, measured = joint_velocities(*nobody, 5.0)
    assert velocity.shape == (0, JOINTS, 3)
    assert measured.shape == (0, JOINTS)


# -- who is fast -----------------------------------------------------------------------------------


def test_a_runner_is_fast_and_a_walker_is_not():
    walker, runner = judged([1.5, 0, 0]), judged([3.0, 0, 0])
    assert walker.within_standard.all()
    assert not walker.beyond_standard_m_s.any()
    assert runner.fast.all()
    assert runner.fastest_m_s == pytest.approx([3.0])
    np.testing.assert_allclose(runner.beyond_standard_m_s, 3.0 + MARGIN_M_S)


def test_a_runner_with_hidden_hips_and_hands_is_fast():
    hidden = ["waist", "torso", "l_hip", "r_hip", *ARMS]
    runner = judged([4.0, 0, 0], hidden=hidden)
    assert runner.fast.all()
    assert runner.fastest_m_s == pytest.approx([4.0])


def test_a_hand_counts_relative_to_the_room():
    walks = [1.4, 0.0, 0.0]
    assert judged(velocity_but(walks, r_wrist=1.9)).within_standard.all()
    reaches = judged(velocity_but(walks, r_wrist=3.4))  # 2.0 m/s relative to the trunk
    assert reaches.fast.all()
    assert CANONICAL.joints[reaches.fastest_joint[0]] == "r_wrist"
    v_h = dict(zip(CANONICAL.segment_names, reaches.beyond_standard_m_s[0], strict=True))
    fast = {name for name, speed in v_h.items() if speed > 0}
    touching = {
        s.name for s in CANONICAL.segments if CANONICAL.index("r_wrist") in (s.joint_a, s.joint_b)
    }
    assert fast == touching  # the rest of the body moves as assumed
    assert v_h[touching.pop()] == pytest.approx(3.4 + MARGIN_M_S)


def test_a_kick_is_fast_and_the_swing_of_a_walk_is_not():
    walks = 1.3
    assert judged(velocity_but([walks, 0, 0], l_foot=GAIT * walks - 0.1)).within_standard.all()
    assert judged(velocity_but([walks, 0, 0], l_foot=GAIT * walks + 0.1)).fast.all()
    kick = judged(velocity_but(l_foot=6.0, l_ankle=4.0))
    assert kick.fast.all()
    assert kick.fastest_m_s == pytest.approx([6.0])
    jog = judged(velocity_but([2.0, 0, 0], l_foot=6.0))
    assert jog.beyond_standard_m_s.max() == pytest.approx(6.0 + MARGIN_M_S)  # no walk
    assert judged(velocity_but(l_foot=1.7)).fast.all()  # a person who stands has no swing


def test_a_dive_is_fast():
    dive = judged(velocity_but([0.5, 0, -0.5], head=4.0, head_top=4.2, neck=3.0))
    assert dive.fast.all()
    assert dive.fastest_m_s == pytest.approx([4.2])


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_who_has_just_appeared_has_no_known_speed_and_counts_at_the_physical_limit(steps):
    appeared = judged([4.0, 0, 0], steps=steps)
    assert appeared.unknown.all()
    assert not appeared.fast.any()
    assert not appeared.within_standard.any()
    np.testing.assert_allclose(appeared.beyond_standard_m_s, LIMITS.reach["trunk"].speed_m_s)


def test_limbs_alone_do_not_tell_how_fast_the_body_is():
    trunk = [j for j in CANONICAL.joints if j not in ARMS]
    assert judged([0.5, 0, 0], hidden=trunk).unknown.all()


def test_nobody_has_no_speed():
    recent = RecentCaptures.of_history(
        np.zeros((0, 25, JOINTS, 3)), np.zeros((0, 25, JOINTS), bool), RATE_HZ
    )
    nobody = RULE.moving(joint_speeds(recent), ALL, ENDS).people
    assert nobody.fast.shape == nobody.unknown.shape == (0,)
    assert nobody.beyond_standard_m_s.shape == (0, len(CANONICAL.segments))


# -- zones without a forecast ----------------------------------------------------------------------


def test_zones_without_a_forecast_grow_at_least_at_the_present_speed():
    history, observed = moving([3.0, 0, 0])
    observed[:, :, 7] = False
    speeds = joint_speeds(RecentCaptures.of_history(history, observed, RATE_HZ))
    growth = RULE.moving(speeds, ALL, ENDS).growth_m_s
    assert growth[0, 7] == LIMITS.physical_speed_m_s
    assert growth[0, 6] == pytest.approx(3.0)


@pytest.mark.parametrize("speed", [1.4, 5.0])
def test_zones_of_hidden_joints_grow_at_least_as_fast_as_the_trunk(speed: float) -> None:
    """The far arm of a runner goes along, although no velocity of it is measured."""
    history, observed = moving([speed, 0.0, 0.0])
    shown = ALL.copy()
    for name in ARMS:
        observed[:, -10:, CANONICAL.index(name)] = False
        shown[:, CANONICAL.index(name)] = False
    captures = RecentCaptures.of_history(history, observed, RATE_HZ)
    growth = RULE.moving(joint_speeds(captures), shown, ENDS).growth_m_s
    hidden = growth[0, [CANONICAL.index(name) for name in ARMS]]
    np.testing.assert_allclose(hidden, max(speed, 2.0))


def test_zones_of_people_whose_speed_is_unknown_grow_at_their_physical_limits():
    speeds = joint_speeds(RecentCaptures.of_history(*moving([0.0, 0, 0], steps=1), RATE_HZ))
    growth = RULE.moving(speeds, ALL, ENDS).growth_m_s
    assert growth[0, CANONICAL.index("waist")] == LIMITS.reach["trunk"].speed_m_s
    assert growth[0, CANONICAL.index("l_hand")] == LIMITS.reach["arm"].speed_m_s


# -- peaks -----------------------------------------------------------------------------------------


def swing(joint: str, ago_s: float, speed_m_s: float, steps: int = 40) -> tuple[Floats, Bools]:
    """A person who stood still but for 0.2 s in which one joint moved."""
    time = np.arange(1 - steps, 1) / RATE_HZ
    history, measured = moving((0.0, 0.0, 0.0), steps)
    way = speed_m_s * (np.clip(time, -ago_s - 0.2, -ago_s) + ago_s + 0.2)
    history[0, :, CANONICAL.index(joint), 0] += way
    return history, measured


@pytest.mark.parametrize(
    ("joint", "ago_s", "speed_m_s", "expected"),
    [
        ("waist", 0.0, 3.0, True),
        ("waist", 0.6, 2.4, True),
        ("head", 0.6, 2.4, True),
        ("waist", 1.1, 3.0, False),  # too long ago
        ("waist", 0.6, 1.2, False),  # as slow as the standard assumes
        ("r_hand", 0.6, 3.0, False),  # arms count as they move now
        ("r_ankle", 0.6, 3.0, False),  # legs swing
    ],
)
def test_who_was_fast_within_the_last_second_does_not_move_as_assumed(
    joint: str, ago_s: float, speed_m_s: float, expected: bool
) -> None:
    assert RULE.peaked(*swing(joint, ago_s, speed_m_s), RATE_HZ).tolist() == [expected]


def test_what_was_not_measured_is_no_peak() -> None:
    history, measured = swing("waist", 0.4, 3.0)
    measured[0, :, CANONICAL.index("waist")] = False
    assert not RULE.peaked(history, measured, RATE_HZ).any()
    assert not RULE.peaked(history[:, :5], measured[:, :5], RATE_HZ).any()  # too short to tell
    assert RULE.peaked(history[:0], measured[:0], RATE_HZ).shape == (0,)
