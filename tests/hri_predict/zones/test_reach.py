"""What bodies can do: the bounds by hand, what they keep, and what people in the data pack did."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL, JOINTS, PARENTS
from hri_predict.lab.calibration.presence import presences_of
from hri_predict.lab.calibration.scores import window_at
from hri_predict.lab.datasets.splits import split
from hri_predict.recording.opening import open_recording
from hri_predict.zones.reach import BONE_FACTOR, BONE_MARGIN_M, BodyReach
from hri_predict.zones.settings import HumanLimits, Reach

RATE_HZ = 25.0
DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
COUNT = len(JOINTS)
HAND, WAIST, FOOT = (JOINTS.index(name) for name in ("l_hand", "waist", "r_foot"))
LIMITS = HumanLimits(
    reach={
        "trunk": Reach(speed_m_s=10.0, burst_m_s=2.0, sustained_m_s2=8.0),
        "arm": Reach(speed_m_s=15.0, burst_m_s=4.0, sustained_m_s2=8.0),
        "leg": Reach(speed_m_s=20.0, burst_m_s=9.0, sustained_m_s2=8.0),
    }
)


def bounds(velocity, since, until, limits=LIMITS, around=np.inf, known=True):
    """Spheres (J, 3) and (J,) of one body that was at 0 with this velocity, for one interval."""
    v = np.broadcast_to(np.asarray(velocity, float), (1, COUNT, 3))
    mid, radius = BodyReach.of(limits, CANONICAL, RATE_HZ).cut_by_motion(
        np.zeros((1, 1, COUNT, 3)),
        np.full((1, 1, COUNT), around),
        last=np.zeros((1, COUNT, 3)),
        velocity=(v, np.full((1, COUNT), known)),
        since=np.array([[since]]),
        until=np.array([[until]]),
    )
    return mid[0, 0], radius[0, 0]


def test_from_rest_the_change_of_velocity_binds_first_by_hand():
    # at 0.2 s: the speed allows 10 x 0.2 = 2, 15 x 0.2 = 3 and 20 x 0.2 = 4 m; from rest it is
    # (2 + 8 x 0.1) 0.2 = 0.56, (4 + 0.8) 0.2 = 0.96 and (9 + 0.8) 0.2 = 1.96
    mid, radius = bounds([0, 0, 0], 0.16, 0.2)
    assert radius[[WAIST, HAND, FOOT]] == pytest.approx([0.56, 0.96, 1.96])
    assert not mid.any()


def test_a_velocity_that_is_not_known_leaves_the_speed_alone():
    _, radius = bounds([3, 0, 0], 0.16, 0.2, known=False)
    assert radius[[WAIST, HAND, FOOT]] == pytest.approx([2, 3, 4])


def test_who_moves_is_about_where_the_velocity_leads_during_the_interval():
    # the middle of 0.16..0.20 s at 5 m/s is 0.9 m on; until either end it is 5 x 0.02 = 0.1 m more:
    # 0.56 + 0.1 for the trunk, all of it within 2 m of the start
    mid, radius = bounds([5, 0, 0], 0.16, 0.2)
    assert mid[WAIST] == pytest.approx([0.9, 0, 0])
    assert radius[WAIST] == pytest.approx(0.66)


def test_both_bounds_hold_at_once():
    # 10 m/s ahead for 1 s: within 10 m of the start, and within (2 + 8 / 2) 1 = 6 m of 10 m ahead;
    # the spheres meet at x = (10^2 + 10^2 - 6^2) / 20 = 8.2 m, rim sqrt(100 - 67.24) = 5.724 m
    mid, radius = bounds([10, 0, 0], 1.0, 1.0)
    assert mid[WAIST] == pytest.approx([8.2, 0, 0])
    assert radius[WAIST] == pytest.approx(np.sqrt(100 - 8.2**2))


def test_a_sphere_inside_of_the_bounds_stays_as_it_is():
    mid, radius = bounds([0, 0, 0], 0.16, 0.2, around=0.5)
    assert (radius == 0.5).all()
    assert not mid.any()


@given(
    st.integers(0, 2**32 - 1),
    st.floats(0, 1),
    st.floats(0, 0.1),
    st.floats(0, 8),
)
def test_a_joint_that_keeps_the_limits_stays_inside(seed, since, span, speed):
    # straight from the start with the velocity v + c, |c| <= burst + a t / 2 and |v + c| <= speed
    rng = np.random.default_rng(seed)
    velocity = rng.normal(size=3)
    velocity *= speed / np.linalg.norm(velocity)
    mid, radius = bounds(velocity, since, since + span)
    of_part = {"trunk": WAIST, "arm": HAND, "leg": FOOT}
    for part, own in LIMITS.reach.items():
        joint = of_part[part]
        for t in (since, since + rng.random() * span, since + span):
            change = rng.normal(size=3)
            most = own.burst_m_s + 0.5 * own.sustained_m_s2 * t
            change *= rng.random() * most / np.linalg.norm(change)
            if np.linalg.norm(velocity + change) > own.speed_m_s:
                continue
            at = (velocity + change) * t
            assert np.linalg.norm(at - mid[joint]) <= radius[joint] + 1e-6


@given(st.floats(0, 6), st.floats(0.05, 1), st.sampled_from(["speed", "burst", "sustained"]))
def test_no_bound_shrinks_when_a_limit_grows(speed, t, which):
    key = {"speed": "speed_m_s", "burst": "burst_m_s", "sustained": "sustained_m_s2"}[which]
    more = LIMITS.model_copy(
        update={
            "reach": {
                part: own.model_copy(update={key: 1.5 * getattr(own, key)})
                for part, own in LIMITS.reach.items()
            }
        }
    )
    _, before = bounds([speed, 0, 0], t, t)
    _, after = bounds([speed, 0, 0], t, t, more)
    assert (after >= before - 1e-9).all()
    _, known = bounds([speed, 0, 0], t, t)
    _, unknown = bounds([speed, 0, 0], t, t, known=False)
    assert (known <= unknown + 1e-9).all()


def test_velocity_is_taken_over_two_steps_and_only_where_both_are_seen():
    body = BodyReach.of(LIMITS, CANONICAL, RATE_HZ)
    history = np.zeros((1, 4, COUNT, 3))
    history[0, :, :, 0] = np.array([9.0, 0.0, 7.0, 0.4])[:, None]
    observed = np.ones((1, 4, COUNT), bool)
    observed[0, 1, HAND] = observed[0, 3, FOOT] = False
    v, known = body.velocity(history, observed)
    assert v[0, WAIST] == pytest.approx([0.4 / 0.08, 0, 0])  # 0.4 m in two steps of 40 ms
    assert known[0].tolist() == [j not in (HAND, FOOT) for j in range(COUNT)]
    assert not v[0, [HAND, FOOT]].any()
    v, known = body.velocity(history[:, -2:], observed[:, -2:])
    assert not known.any()
    assert not v.any()


# -- bones ----------------------------------------------------------------------------------------


def cut_by_bones(mid, around, last, seen=None):
    seen = np.ones((1, COUNT), bool) if seen is None else seen
    cut_mid, cut_around = BodyReach.of(LIMITS, CANONICAL, RATE_HZ).cut_by_bones(
        mid[None, None], around[None, None], last=last[None], seen=seen
    )
    return cut_mid[0, 0], cut_around[0, 0]


def tree(rng, lengths):
    """A body of random directions whose bones have these lengths."""
    places = np.zeros((COUNT, 3))
    places[0] = rng.normal(size=3)
    for joint in range(1, COUNT):
        away = rng.normal(size=3)
        places[joint] = places[PARENTS[joint]] + lengths[joint] * away / np.linalg.norm(away)
    return places


@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_bodies_whose_bones_keep_their_lengths_stay_inside(seed, share_seen):
    rng = np.random.default_rng(seed)
    bones = rng.uniform(0.1, 0.6, COUNT)
    last = tree(rng, bones)
    seen = rng.random((1, COUNT)) < share_seen
    # where joint and parent were seen the bone may be 10 % + 2 cm longer, else as long as anybody's
    longest = np.array([CANONICAL.reach[j, p] if p >= 0 else 0 for j, p in enumerate(PARENTS)])
    both = seen[0] & seen[0, list(PARENTS)]
    most = np.where(both, BONE_FACTOR * bones + BONE_MARGIN_M, longest)
    truth = tree(rng, most * rng.uniform(0.2, 1, COUNT))
    around = rng.uniform(0, 2, COUNT)
    off = rng.normal(size=(COUNT, 3))
    off /= np.linalg.norm(off, axis=1, keepdims=True)
    mid = truth + off * (around * rng.random(COUNT))[:, None]  # each sphere holds its joint
    cut_mid, cut_around = cut_by_bones(mid, around, last, seen)
    assert (np.linalg.norm(truth - cut_mid, axis=1) <= cut_around + 1e-6).all()
    assert (cut_around <= around + 1e-9).all()


def test_an_unbounded_joint_hangs_on_its_parent():
    last = np.zeros((COUNT, 3))
    elbow, wrist, hand = (JOINTS.index(f"l_{n}") for n in ("elbow", "wrist", "hand"))
    last[wrist], last[hand] = (0.3, 0, 0), (0.5, 0, 0)
    mid, around = np.ones((COUNT, 3)), np.full(COUNT, 0.1)
    mid[[wrist, hand]], around[[wrist, hand]] = 7, np.inf
    cut_mid, cut_around = cut_by_bones(mid, around, last)
    # 0.1 about the elbow, then 1.1 x 0.3 + 0.02 = 0.35, then 1.1 x 0.2 + 0.02 = 0.24 more
    assert cut_mid[[wrist, hand]] == pytest.approx(np.ones((2, 3)))
    assert cut_around[[elbow, wrist, hand]] == pytest.approx([0.1, 0.45, 0.69])


def test_a_joint_that_was_not_seen_is_not_cut_and_one_with_an_unseen_parent_by_the_longest():
    wrist, hand = JOINTS.index("l_wrist"), JOINTS.index("l_hand")
    seen = np.ones((1, COUNT), bool)
    seen[0, wrist] = False
    around = np.full(COUNT, 0.1)
    around[[wrist, hand]] = 4.0, np.inf
    _, cut_around = cut_by_bones(np.zeros((COUNT, 3)), around, np.zeros((COUNT, 3)), seen)
    assert cut_around[wrist] == 4.0
    assert cut_around[hand] == pytest.approx(4.0 + CANONICAL.reach[hand, wrist])


# -- the settings, and people ---------------------------------------------------------------------


@pytest.mark.parametrize("part", ["trunk", "arm", "leg"])
def test_a_part_that_is_missing_is_one_clear_line(part):
    data = HumanLimits().model_dump()
    del data["reach"][part]
    with pytest.raises(ConfigError) as error:
        validated(HumanLimits, data, "node.yaml: risk.limits")
    line = str(error.value)
    assert f"{part} is missing" in line
    assert line.startswith("node.yaml: risk.limits: reach")
    assert "\n" not in line
    del data["reach"]["arm" if part != "arm" else "leg"]
    data["reach"]["tail"] = {"speed_m_s": 1, "burst_m_s": 1}
    with pytest.raises(ConfigError, match="reach"):
        validated(HumanLimits, data, "risk.limits")


@pytest.mark.long
@pytest.mark.skipif(not DATA.exists(), reason="needs ../shared/data")
def test_people_of_the_test_recordings_keep_the_limits_for_a_second():
    inside = total = 0
    by_action: dict[str, list[int]] = {}
    files = [DATA / f"{name}.npz" for name in split("test")]
    files += sorted((DATA / "assembly").glob("*.npz"))
    for path in files:
        recording = open_recording(path)
        for presence in presences_of(recording):
            held, known = _kept(presence)
            inside, total = inside + held, total + known
            action = by_action.setdefault(path.stem.split("_")[0], [0, 0])
            action[0] += held
            action[1] += known
    share = inside / total
    measured = ", ".join(f"{k} {h / max(n, 1):.5f}" for k, (h, n) in by_action.items())
    assert total > 1e5
    assert share >= 0.999, f"{share:.5f} of {total} joint-frames: {measured}"


def _kept(presence, every_s=0.2, steps=25):
    """How many joint-frames up to 1 s after every so many seconds are within the bounds."""
    body = BodyReach.of(HumanLimits(), CANONICAL, RATE_HZ)
    stamps, held, known = presence.stamps_ns, 0, 0
    until = np.arange(1, steps + 1) / RATE_HZ
    for index in range(0, len(stamps), max(1, round(every_s * presence.rate_hz))):
        history, observed = window_at(presence, index, 3, RATE_HZ)
        last, seen = presence.positions[index], presence.observed[index]
        mid, radius = body.cut_by_motion(
            np.zeros((1, steps, COUNT, 3)) + last,
            np.full((1, steps, COUNT), np.inf),
            last=last[None],
            velocity=body.velocity(history[None], observed[None]),
            since=(until - 1 / RATE_HZ)[None],
            until=until[None],
        )
        ahead = slice(index + 1, int(stamps.searchsorted(stamps[index] + 10**9, side="right")))
        step = np.ceil((stamps[ahead] - stamps[index]) * 1e-9 * RATE_HZ - 1e-6).astype(int) - 1
        off = np.linalg.norm(presence.positions[ahead] - mid[0, step], axis=-1)
        judged = presence.observed[ahead] & seen
        held += int((judged & (off <= radius[0, step] + 1e-9)).sum())
        known += int(judged.sum())
    return held, known
