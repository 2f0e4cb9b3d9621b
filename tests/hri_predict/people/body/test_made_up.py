"""Bodies that a tracker makes up are recognised within the stated time, and true ones are not."""

from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.made_up import CAPTURES, MadeUpWatch, Sign, _Record
from hri_predict.people.body.relative import hips_are_origin
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body as Sent
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.opening import open_recording
from hri_sim.people.body import Body

RATE_HZ = 30
ALL = np.ones(len(JOINTS), bool)
MOTION = Path(__file__).resolve().parents[5] / "shared" / "data" / "motion"
_WHO = Body(1.75)
NOISES = pytest.mark.parametrize(
    "noise_m", [0.004, *(pytest.param(other, marks=pytest.mark.long) for other in (0.0, 0.01))]
)


def walker(t, speed=1.4, since=2.0):
    """(21, 3) of somebody who stands, and then walks for good along -x with swinging limbs."""
    way = max(t - since, 0.0) * speed
    body = _WHO.joints(_WHO.standing(np.array([5.0 - way, 0.6]), np.pi))
    swing = np.sin(2 * np.pi * way / 1.4)
    for side, sign in (("l_", 1.0), ("r_", -1.0)):
        for name, metres in (("knee", 0.12), ("ankle", 0.3), ("foot", 0.3), ("hand", -0.2)):
            body[JOINTS.index(side + name), 0] += sign * metres * swing
    return body


def signs(shown, noise_m, seconds, origin=(9.0, 9.0, 9.0), rate_hz=RATE_HZ):
    """(t, sign) for each capture of ``shown(t, k)``."""
    watch = MadeUpWatch(PeopleSettings(), np.array(origin), round(1e9 / rate_hz))
    rng = np.random.default_rng(0)
    for k in range(round(seconds * rate_hz)):
        t = k / rate_hz
        body = shown(t, k) + rng.normal(0.0, noise_m, (len(JOINTS), 3))
        yield t, watch.judge(Sent(1, body, ALL), round(t * 1e9))


def first(shown, noise_m, seconds=7.0):
    return next(((t, sign) for t, sign in signs(shown, noise_m, seconds) if sign), (None, None))


@NOISES
@pytest.mark.parametrize("speed", [0.6, 0.9, 1.4, 2.0])
def test_who_walks_or_stands_is_believed(noise_m, speed):
    assert first(lambda t, k: walker(t, speed), noise_m) == (None, None)


@NOISES
@pytest.mark.parametrize("since", [2.4, 3.0, 3.33, 3.61])
def test_a_body_that_freezes_in_a_step_is_recognised_and_stays_so(noise_m, since):
    found = list(signs(lambda t, k: walker(min(t, since)), noise_m, 8.0))
    assert not any(sign for t, sign in found if t < since)
    assert all(sign for t, sign in found if t > since + 0.3)


@NOISES
@pytest.mark.parametrize(
    "rate_hz", [45, 120, *(pytest.param(other, marks=pytest.mark.long) for other in (60, 100))]
)
def test_a_freeze_is_recognised_at_higher_rates(noise_m, rate_hz):
    for since in np.arange(3.0, 4.0, 0.13):
        found = list(signs(lambda t, k: walker(min(t, since)), noise_m, 4.5, rate_hz=rate_hz))  # noqa: B023
        t = next(t for t, sign in found if sign)
        assert since < t < since + 0.25


@NOISES
@pytest.mark.parametrize("rate_hz", [30, 60, 120])
def test_who_slows_down_gently_is_believed_at_any_rate(noise_m, rate_hz):
    def way_m(t):  # 0.5 m/s, and from 2 s on down to nothing within a second
        slowing = min(max(t - 2.0, 0.0), 1.0)
        return 0.5 * (min(t, 2.0) + slowing - slowing**2 / 2)

    body = walker(0.0)
    swing = 0.3 * np.cos(np.arange(len(JOINTS)))[:, None] * [1.0, 0.0, 0.0]

    def shown(t, k):
        return body + (swing - [1.0, 0.0, 0.0]) * way_m(t)

    assert all(sign is not Sign.FROZEN for _, sign in signs(shown, noise_m, 4.0, rate_hz=rate_hz))


@NOISES
@pytest.mark.parametrize("velocity", [[0, 1.4, 0], [0.3, 0.2, 0], [1.0, 0, 0], [-1.4, 0, 0]])
def test_a_body_that_glides_on_is_recognised(noise_m, velocity):
    since = 3.2

    def shown(t, k):
        return walker(min(t, since)) + np.array(velocity) * max(t - since, 0.0)

    t, sign = first(shown, noise_m)
    assert sign is Sign.COASTING
    assert since < t < since + 0.65


@NOISES
@pytest.mark.parametrize("rate_hz", [15, 30, 60])
@pytest.mark.parametrize("jump", [[0, 3.0, 0], [0.6, 0, 0]])
def test_who_stands_is_believed_although_the_tracker_jumps(noise_m, rate_hz, jump):
    def shown(t, k):  # there for two seconds, and back
        return walker(0.0) + np.array(jump) * (2.0 <= t < 4.0)

    assert not any(sign for _, sign in signs(shown, noise_m, 6.0, rate_hz=rate_hz))


@NOISES
def test_a_body_that_glides_on_is_recognised_although_captures_are_lost(noise_m):
    def shown(t, k):
        return walker(min(t, 3.2)) + np.array([0, 1.4, 0]) * max(t - 3.2, 0.0)

    watch = MadeUpWatch(PeopleSettings(), np.full(3, 9.0), round(1e9 / RATE_HZ))
    rng = np.random.default_rng(0)
    seen = [k for k in range(126) if not 102 < k < 108]  # until 1 s after it began to glide
    bodies = [shown(k / RATE_HZ, k) + rng.normal(0, noise_m, (len(JOINTS), 3)) for k in seen]
    found = [
        watch.judge(Sent(1, body, ALL), round(k / RATE_HZ * 1e9))
        for k, body in zip(seen, bodies, strict=True)
    ]
    assert found[-1] is Sign.COASTING


def test_a_body_whose_joints_each_go_on_is_recognised():
    step = walker(3.2) - walker(3.2 - 1 / RATE_HZ)
    t, sign = first(lambda t, k: walker(min(t, 3.2)) + step * RATE_HZ * max(t - 3.2, 0.0), 0.004)
    assert sign is Sign.COASTING
    assert 3.2 < t < 4.35


@NOISES
@pytest.mark.parametrize("captures", [2, 3, 5, 12, 30])
def test_a_loop_is_recognised_in_its_second_round(noise_m, captures):
    since = 3.5
    kept = {}

    def shown(t, k):
        if t < since:
            kept[k % captures] = walker(t)
        return kept[k % captures]

    t, sign = first(shown, noise_m)
    assert sign is Sign.LOOPED
    assert since <= t < since + captures / RATE_HZ + 0.3


def test_a_frozen_body_is_believed_again_when_its_limbs_move():
    found = list(signs(lambda t, k: walker(t if t < 3.0 else max(t - 1.5, 3.0)), 0.004, 8.0))
    assert {sign for t, sign in found if 3.3 < t < 4.5} == {Sign.FROZEN}
    assert not any(sign for t, sign in found if t > 5.5)


@NOISES
@pytest.mark.parametrize("lifted_m", [0.0, 0.95])
def test_coordinates_about_the_hips_are_recognised(noise_m, lifted_m):
    def shown(t, k):
        body = walker(t)
        return body - body[0] + [0.0, 0.0, lifted_m]

    found = [sign for t, sign in signs(shown, noise_m, 5.0, origin=(0.0, 0.0, 0.0)) if t > 4.5]
    assert set(found) == {Sign.RELATIVE}


def test_a_waist_at_the_origin_is_enough_if_the_body_is_around_it(make_room):
    """The hips' joints of some rigs are below the waist. A waist that was lost is elsewhere."""
    room = make_room(posture_unchecked=None, floor_m=-1.0)
    for k in range(40):
        body = walker(2 + k / 25) - walker(2 + k / 25)[0]
        body[[JOINTS.index("l_hip"), JOINTS.index("r_hip")], 2] -= 0.1
        snapshot = room.see(Person(1, body, ALL))
    assert Reason.INPUT_RELATIVE in snapshot.reasons
    room = make_room(posture_unchecked=None)
    body = walker(0.0)
    body[0] = 0.0
    assert room.see(Person(1, body, ALL), times=40).reasons == ()


@NOISES
def test_a_frozen_tracker_is_unknown_and_counted(make_room, noise_m):
    room = make_room(posture_unchecked=None)
    rng = np.random.default_rng(3)
    for k in range(100):
        body = walker(min(k / 25, 2.8)) + rng.normal(0, noise_m, (len(JOINTS), 3))
        snapshot = room.see(Person(1, body, ALL))
        if k / 25 < 2.8:
            assert snapshot.reasons == ()
    assert Reason.INPUT_REPEATS in snapshot.reasons
    assert snapshot.counters["frozen_bodies"] > 15


def test_a_passer_by_with_a_new_id_does_not_wake_a_frozen_body(make_room):
    """Whatever the order of the scene's people: the frozen body is still in it."""
    room = make_room(posture_unchecked=None)
    rng = np.random.default_rng(3)
    for k in range(160):
        frozen = walker(min(k / 25, 2.8)) + rng.normal(0, 0.004, (len(JOINTS), 3))
        people = [Person(7, frozen, ALL)]
        if k >= 90:  # starts 0.4 m beside it, and walks away
            beside = np.array([walker(2.8)[0, 0] - 5.0, 0.4, 0.0])
            passer = walker(2.0 + (k - 90) / 25) + beside
            people.insert(0, Person(3, passer + rng.normal(0, 0.004, passer.shape), ALL))
        snapshot = room.see(*people)
    assert Reason.INPUT_REPEATS in snapshot.reasons


def test_hips_of_somebody_who_walks_in_place_elsewhere_are_believed():
    rng = np.random.default_rng(1)
    place = np.array([1.6, -1.2, 0.9])
    bodies = np.array([walker(2 + k / 30) - walker(2 + k / 30)[0] + place for k in range(60)])
    bodies += rng.normal(0, 0.002, bodies.shape)
    assert not hips_are_origin(bodies, np.ones(bodies.shape[:2], bool), np.zeros(3))


@pytest.mark.skipif(not MOTION.is_dir(), reason="../shared/data/motion is absent")
@pytest.mark.parametrize("noise_m", [0.0, 0.004])
def test_real_people_are_believed(noise_m):
    for path in sorted(MOTION.glob("*/*.npz"))[7::40]:
        recording = open_recording(path)
        every = max(1, round(recording.rate_hz / RATE_HZ))
        bodies = [
            recording.joint_map.map(person.positions, person.observed)
            for scene in recording.scenes[::every]
            for person in scene.people
        ]
        watch = MadeUpWatch(PeopleSettings(), np.full(3, 99.0), round(1e9 / RATE_HZ))
        rng = np.random.default_rng(2)
        for k, (positions, seen) in enumerate(bodies):
            shaken = positions + rng.normal(0.0, noise_m, positions.shape)
            body = Sent(1, np.where(seen[:, None], shaken, 0.0), seen)
            assert watch.judge(body, round(k * 1e9 / RATE_HZ)) is None, path.name


def test_the_newest_captures_are_kept_however_many_there_were():
    record, rng = _Record(), np.random.default_rng(0)
    shown = [rng.normal(size=(len(JOINTS), 3)) for _ in range(5 * CAPTURES)]
    for k, positions in enumerate(shown):
        seen = ALL.copy()
        seen[0] = k % 7 > 0
        record.add(k * 1_000_000, Sent(1, positions, seen))
        count = min(k + 1, 9)
        seconds, joints, always = record.last(9)
        np.testing.assert_array_equal(seconds, np.arange(1 - count, 1) * 1_000_000 * 1e-9)
        np.testing.assert_array_equal(joints, np.array(shown[k + 1 - count : k + 1])[:, always])
        assert always[0] == all(i % 7 for i in range(k + 1 - count, k + 1))
        assert len(record.stamps) == min(k + 1, CAPTURES)
        assert record.within(0.0035) == min(k + 1, 4)
