"""What contact permits, against a plain reading of the rule, and by hand."""

import re
from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError, RobotError
from hri_predict.base.files import data_path
from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.contact.clamping import thickness_m
from hri_predict.risk.contact.judge import MAX_BESIDE, RUNGS, ContactJudge
from hri_predict.risk.contact.judges import contact_judges
from hri_predict.risk.contact.limits import FOLLOWS
from hri_predict.risk.fixtures import floor
from hri_predict.risk.levels.advice import Levels
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import travel_m
from hri_predict.robots.model import load_robot
from hri_predict.robots.tracker import RobotNow
from tests.hri_predict.risk.contact.cell import (
    CONSTANTS,
    HYBRID,
    LIMITS,
    MODEL,
    READY,
    ROBOT,
    SEGMENTS,
    TIMES,
    TIP,
    beside,
    found,
    limit_of,
    moving,
    people,
    rung_below,
    stage,
    standing,
)

MODEL_FILE = data_path("robots", "ur5e.yaml")


def test_beside_a_hand_the_robot_may_be_as_fast_as_the_hand_bears():
    (demand, finding), _ = found(people({"l_hand": beside()}))
    assert demand.level is Level.WARN  # a hand bears more than this robot's 1 m/s
    assert demand.reason is Reason.CONTACT_POSSIBLE
    assert demand.limit_m_s == 1.0
    assert finding.segment == list(SEGMENTS).index("l_hand")


@pytest.mark.parametrize("segment", ["thorax", "shoulders", "abdomen", "l_shank", "r_thigh"])
def test_beside_another_part_it_is_as_slow_as_that_part_needs(segment):
    (demand, finding), _ = found(people({segment: beside()}))
    assert demand.level is Level.SLOW
    assert demand.limit_m_s == pytest.approx(rung_below(limit_of(segment)))
    assert demand.reason is Reason.CONTACT_POSSIBLE
    assert finding.segment == list(SEGMENTS).index(segment)


def test_the_most_delicate_part_within_reach_decides():
    (demand, _), _ = found(people({"l_hand": beside(), "thorax": beside(z=0.2)}))
    assert demand.limit_m_s == pytest.approx(rung_below(limit_of("thorax")))


def test_a_head_within_reach_means_stop():
    (demand, finding), _ = found(people({"head": beside(), "l_hand": beside()}))
    assert demand.level is Level.STOP
    assert demand.reason is Reason.PERSON_NEAR
    assert finding.segment == list(SEGMENTS).index("head")


def test_the_parts_own_speed_counts():
    (demand, _), _ = found(people({"l_hand": beside()}, own=0.6))
    assert demand.limit_m_s == pytest.approx(rung_below(limit_of("l_hand") - 0.6))
    assert found(people({"l_hand": beside()}, own=2.0))[0][0].level is Level.STOP
    assert found(people({"l_hand": beside()}, own=np.inf))[0][0].level is Level.STOP


def test_the_parts_own_speed_may_be_left_out_but_must_be_known():
    contact = HYBRID.contact.model_copy(update={"own_speed": "left_out"})
    alone = HYBRID.model_copy(update={"contact": contact})
    hand = {"l_hand": beside()}
    assert found(people(hand, own=2.0), risk=alone)[0][0].limit_m_s == 1.0
    assert found(people(hand, own=np.inf), risk=alone)[0][0].level is Level.STOP


def test_nobody_whose_speed_is_unknown_or_who_is_lost_may_be_touched():
    body = people({"l_hand": beside()})
    unknown = np.array([True])
    speeds = replace(body.speeds, unknown=unknown)
    assert found(replace(body, speeds=speeds))[0][0].level is Level.STOP
    gone = replace(body, lost=unknown, segments_m_s=np.full_like(body.segments_m_s, np.inf))
    assert found(gone)[0][0].level is Level.STOP


def test_a_hand_on_the_table_under_the_tip_bears_only_the_quasi_static_limit():
    low = READY + np.array([0, 0.2, 0, 0, 0, 0])  # the tool comes down
    tip = MODEL.capsules(low).a[-1]
    assert 0.75 < tip[2] < 1.0
    hand = people({"l_hand": (tip[0] + 0.2, tip[1], 0.8)})
    robot = RobotNow(q=low, qd=np.zeros(6), speed_m_s=0.0)
    clamped = LIMITS.clamped_m_s[list(SEGMENTS).index("l_hand")] / FOLLOWS
    assert found(hand, robot, fixtures=True)[0][0].limit_m_s == pytest.approx(rung_below(clamped))
    assert found(hand, robot)[0][0].limit_m_s == 1.0


def test_a_hand_that_the_robot_may_push_onto_the_table_bears_only_the_quasi_static_limit():
    low = READY + np.array([0, 0.1, 0, 0, 0, 0])
    tip = MODEL.capsules(low).a[-1]
    robot = RobotNow(q=low, qd=np.zeros(6), speed_m_s=0.0)
    hand = people({"l_hand": (tip[0], tip[1], 0.95)}, growth=0.0)  # 0.15 m above the table
    limit = found(hand, robot, fixtures=True)[0][0].limit_m_s
    assert found(hand, robot)[0][0].limit_m_s == 1.0
    # slower, it stands before the hand is at the table
    assert LIMITS.clamped_m_s[list(SEGMENTS).index("l_hand")] < limit < 1.0


def test_a_head_that_reaches_a_robot_that_creeps_means_stop_though_a_fast_one_would_be_gone():
    """Found by sampling courses: the head's zone follows, and only a fast robot gets away."""
    qd = np.array([0.6, 0, 0, 0, 0, 0])
    robot = RobotNow(q=READY, qd=qd, speed_m_s=float(MODEL.tip_speed(READY, qd)))
    constants, separation = stage()
    limits = []
    for y in np.linspace(0.3, 0.8, 26):  # behind the tool, which moves towards -y
        head = people({"head": tuple(TIP + np.array([0.0, y, 0.0]))}, growth=0.6)
        motion = separation._motion(0, robot, head)
        contact = separation(head, [robot]).robots[0].contact
        assert contact is not None
        zone, s = head.zones.capsules, list(SEGMENTS).index("head")
        stands_s = motion.until_braking_s + constants.curve.time_s[1]
        last = int(np.searchsorted(TIMES, stands_s))
        near = capsule_distance(
            Capsules(zone.a[0, last, s], zone.b[0, last, s], zone.radius[0, last, s]),
            motion.capsules,
        ).min()
        creeps = near >= motion.clearance_m + HYBRID.contact.slow_margin_m - 1e-6
        assert creeps or contact.limits[0] == 0
        limits.append(contact.limits[0])
    assert min(limits) == 0
    assert max(limits) > 0


def test_beside_too_many_people_nobody_may_be_touched():
    hands = [{"l_hand": beside()}] * (MAX_BESIDE + 1)
    (demand, _), finding = found(people(*hands))
    assert finding.contact is None
    assert demand.level is Level.STOP
    far = [{"l_hand": beside()}, *[{"l_hand": (5.0, float(i), 1.0)} for i in range(12)]]
    assert found(people(*far))[0][0].limit_m_s == 1.0


def test_far_people_need_no_contact():
    (demand, _), finding = found(people({"head": (4.0, 0, 1)}))
    assert demand.level is Level.CLEAR
    assert finding.contact is None


@pytest.mark.parametrize("field", ["a", "radius"])
def test_zones_that_are_not_finite_permit_nothing(field):
    body = people({"l_hand": beside()})
    capsules = body.zones.capsules
    bad = np.array(getattr(capsules, field))
    bad[0, 3, 0] = np.nan
    zones = replace(body.zones, capsules=replace(capsules, **{field: bad}))
    demand = found(replace(body, zones=zones))[0][0]
    assert demand.level is Level.STOP


def test_a_present_speed_that_the_part_does_not_bear_is_a_stop():
    near = people({"thorax": beside()})
    fast = found(near, moving(1.2))[0][0]
    assert moving(1.2).speed_m_s > limit_of("thorax")
    assert fast.level is Level.STOP
    assert found(near, moving(0.3))[0][0].level is Level.SLOW


PLACES = st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-0.4, 0.6))
BODIES = st.dictionaries(
    st.sampled_from(["head", "thorax", "l_hand", "r_forearm", "l_shank"]), PLACES, min_size=1
)


def gaps_of(judge_motion, body):
    """[step][segment] distances to the robot's capsules, which no speed changes."""
    zones = body.zones.capsules
    return [
        [
            capsule_distance(
                Capsules(zones.a[0, k, s], zones.b[0, k, s], zones.radius[0, k, s]),
                judge_motion.capsules,
            ).tolist()
            for s in range(len(SEGMENTS))
        ]
        for k in range(len(judge_motion.times_s))
    ]


def permits(judge_motion, body, speed, gaps):
    """The rule, read plainly: loops, and no bounds."""
    curve, clearance = CONSTANTS.curve, judge_motion.clearance_m + HYBRID.contact.slow_margin_m
    stop_s, stop_m = curve.at(speed)
    fixtures = [floor(0.0, "floor"), floor(0.75, "table")]
    thick = thickness_m(list(SEGMENTS), np.array([s.radius for s in SEGMENTS.values()]))
    capsules = body.zones.capsules
    last = 0.0
    wider = clearance + HYBRID.band_m  # what counts as reached where parts may be clamped
    reach: set[tuple[int, int]] = set()
    near: set[tuple[int, int]] = set()
    for k in range(1, len(judge_motion.times_s)):
        begin, end = judge_motion.times_s[k - 1], judge_motion.times_s[k]
        if begin > judge_motion.until_braking_s + stop_s:
            break
        last = float(
            travel_m(
                end,
                reaction_s=judge_motion.until_braking_s,
                speed_m_s=speed,
                stopping_s=stop_s,
                stopping_m=stop_m,
            )
        )
        for s in range(len(SEGMENTS)):
            for c, gap in enumerate(gaps[k][s]):
                reach |= {(s, c)} if gap - last < clearance else set()
                near |= {(s, c)} if gap - last < wider else set()
    pressed = set()
    for s, c in near:
        links = judge_motion.capsules
        link_z = min(links.a[c, 2], links.b[c, 2]) - links.radius[c]
        zones = capsules.a[0, 1 : len(judge_motion.times_s), s, 2]
        grown = capsules.radius[0, 1 : len(judge_motion.times_s), s]
        for plane in fixtures:
            height = plane.point[2]
            # the robot may push the part towards the plane until it stops
            beside_it = (zones - height - grown).min() < judge_motion.clearance_m + last
            narrow = link_z - height - last < thick[s] + judge_motion.clearance_m
            if c > 0 and beside_it and narrow:
                pressed.add(s)
    for s, _ in reach:
        free = LIMITS.transient_m_s[s] / FOLLOWS - body.segments_m_s[0, s]
        if LIMITS.transient_m_s[s] == 0 or speed > free:
            return False
        if s in pressed and speed > LIMITS.clamped_m_s[s] / FOLLOWS:
            return False
    return True


@settings(max_examples=15)
@given(BODIES, st.floats(0, 0.5))
def test_a_standing_robot_may_be_as_fast_as_the_plain_rule_says(where, own):
    body = people({name: tuple(TIP + np.array(at)) for name, at in where.items()}, own=own)
    constants, separation = stage(fixtures=True)
    motion = separation._motion(0, standing(), body)
    judge = contact_judges(
        settings=HYBRID, robots=[constants], segments=list(CANONICAL.segments), floor_m=0.0
    )[0]
    assert isinstance(judge, ContactJudge)
    people_finding = separation(body, [standing()]).robots[0].people
    judged = judge(motion, body, people_finding)
    assert judged is not None
    limit = judged.limits[0]
    gaps = gaps_of(motion, body)
    rungs = (np.arange(1, RUNGS + 1) / RUNGS).tolist()
    permitted = takewhile(lambda rung: permits(motion, body, rung, gaps), rungs)
    assert limit == pytest.approx(max(permitted, default=0.0))


def test_no_robot_that_may_touch_people_is_an_error():
    aloof = replace(CONSTANTS, robot=ROBOT.model_copy(update={"contact": None}))
    with pytest.raises(ConfigError, match="contact: allowed"):
        contact_judges(
            settings=HYBRID, robots=[aloof], segments=list(CANONICAL.segments), floor_m=0.0
        )


def test_a_robot_that_hangs_needs_its_fixtures():
    hanging = ROBOT.model_copy(update={"room_from_robot": Pose(quaternion_xyzw=[1, 0, 0, 0])})
    robot = replace(CONSTANTS, robot=hanging)
    with pytest.raises(ConfigError, match=r"risk\.contact\.fixtures"):
        contact_judges(
            settings=HYBRID, robots=[robot], segments=list(CANONICAL.segments), floor_m=0.0
        )


def test_without_a_zone_for_the_head_nobody_may_be_touched():
    legs_and_arms = [s for s in CANONICAL.segments if s.part != "torso"]
    with pytest.raises(ConfigError, match="head"):
        contact_judges(settings=HYBRID, robots=[CONSTANTS], segments=legs_and_arms, floor_m=0.0)


def test_the_robot_file_must_say_what_a_person_feels(tmp_path):
    text = (MODEL_FILE).read_text().split("# What a person feels")[0]
    (tmp_path / "bare.yaml").write_text(text)
    bare = ROBOT.model_copy(update={"model": "bare.yaml"})
    with pytest.raises(RobotError, match=r"contact: 'bare\.yaml' has no contact properties"):
        load_robot(bare, tmp_path)
    assert load_robot(bare.model_copy(update={"contact": None}), tmp_path).effective_kg == 0


def test_hybrid_needs_the_self_check():
    with pytest.raises(ValueError, match="self_check"):
        RiskSettings.model_validate({"mode": "hybrid", "coverage": {"self_check": False}})


def advised(bodies, remarks=(), captures=40):
    """The advice after some captures of the same scene, at the robot's present remarks."""
    constants, separation = stage()
    levels = Levels(
        settings=HYBRID,
        robots=[constants],
        named=[],
        horizon_s=1.2,
        segment_index=np.arange(len(SEGMENTS)),
    )
    joints = len(CANONICAL.joints)
    advice = None
    for k in range(captures):
        now_ns = 10**9 + k * 40_000_000
        snapshot = PeopleSnapshot(
            now_ns=now_ns,
            ids=bodies.zones.ids,
            history=np.zeros((1, 2, joints, 3)),
            observed=np.ones((1, 2, joints), bool),
            capture_ns=np.array([now_ns]),
            last_positions=np.zeros((1, joints, 3)),
            joint_age_s=np.zeros((1, joints)),
            lost=(),
            reasons=(),
            newest_capture_ns=now_ns,
            captures=k,
            counters={},
        )
        said = [remarks if k == captures - 1 else ()]
        advice = levels(snapshot, bodies, separation(bodies, [standing()]), said)[0]
    return advice


@pytest.mark.parametrize("other", ["head", "thorax"])
def test_the_distance_that_the_detail_tells_is_that_of_the_part_it_names(other):
    there = TIP + np.array([-0.45, 0.0, 0.1])
    advice = advised(people({"l_hand": beside(x=-0.2), other: tuple(there)}, growth=0.6))
    told = re.search(r"person 7, (\w+), ([\d.]+) m from (\w+)", advice.detail)
    assert told is not None
    part, distance, link = told.groups()
    assert part == other
    links = MODEL.capsules(READY)
    c = MODEL.capsule_names.index(link)
    true = capsule_distance(
        Capsules(there, there, np.array(0.05)),
        Capsules(links.a[c], links.b[c], links.radius[c]),
    )
    assert float(distance) == pytest.approx(float(true), abs=0.006)
    assert advice.separation_m < true - 0.1  # the hand is nearer


def test_a_robot_that_does_not_keep_its_limit_may_touch_nobody():
    hand = people({"l_hand": beside()})
    obeys = advised(hand)
    assert obeys.level is not Level.STOP
    assert obeys.speed_limit_m_s > 0
    ignores = advised(hand, [Reason.ROBOT_TOO_FAST])
    assert ignores.level is Level.STOP
    assert ignores.speed_limit_m_s == 0
