"""Procedural people: human speeds, constant bones, feet on the floor, scripts kept."""

import math
from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Region, validated
from hri_predict.base.skeleton import CANONICAL, JOINTS, PARENTS
from hri_sim.people.procedural import DEMO, ProceduralSettings, ProceduralSource, inside

BUSY = {
    "start": [0.0, 0.0],
    "script": [
        {"do": "walk", "via": [[1.5, 0.4], [2.0, 1.5]], "to": [0.5, 2.5], "speed_m_s": 1.4},
        {"do": "turn", "yaw": 0.3},
        {"do": "reach", "hand": "left", "to": [1.0, 2.9, 1.2], "hold_s": 0.4},
        {"do": "reach", "hand": "right", "to": [0.9, 2.4, 0.7], "hold_s": 0.0},
        {"do": "walk", "to": [-0.2, 2.4], "speed_m_s": 0.5, "backwards": True},
        {"do": "wait", "seconds": 0.7},
    ],
}


def _source(people: list[dict[str, Any]] | None = None, **more: Any) -> Any:
    data = {"kind": "procedural"} | ({"people": people} if people else {}) | more
    source = ProceduralSource(validated(ProceduralSettings, data, "source"))
    source.open(0)
    return source


def _film(source: Any, seconds: float, person: int = 1):
    """Captures (N,) in seconds and joints (N, 21, 3) of one person while there."""
    times, film = [], []
    while (due := source.next_ns()) is not None and due <= seconds * 1e9:
        scene = source.poll(due)
        for p in scene.people:
            if p.id == person:
                times.append(scene.stamp_ns * 1e-9)
                film.append(p.positions)
    return np.array(times), np.array(film)


def _rates(times, film):
    """Speeds and accelerations (N, 21), only where the film has no gap."""
    dt = np.diff(times)
    v = np.diff(film, axis=0) / dt[:, None, None]
    even = np.isclose(dt, np.median(dt), rtol=1e-3)
    a = np.diff(v, axis=0) / dt[1:, None, None]
    both = even[1:] & even[:-1]
    return np.linalg.norm(v[even], axis=-1), np.linalg.norm(a[both], axis=-1)


def _j(name: str) -> int:
    return JOINTS.index(name)


@pytest.fixture(scope="module", params=["demo", "busy"])
def film(request):
    people = DEMO if request.param == "demo" else [BUSY]
    return _film(_source(people, rate_hz=120.0), 26.0)


# Real walking (the data pack's walks, 30 Hz differences, greatest values): wrist 2.9 m/s and
# 33 m/s2, elbow 2.1 and 30, ankle 4.4 and 58, hips 1.7 and 21. A procedural person stays at or
# below what people do, with some room for speeds other than those recorded.
@pytest.mark.parametrize(
    ("joint", "speed", "acceleration"),
    [("wrist", 2.9, 33.0), ("elbow", 2.4, 30.0), ("ankle", 4.8, 58.0), ("knee", 4.0, 58.0)],
)
def test_limbs_move_no_faster_than_people_do(film, joint, speed, acceleration) -> None:
    v, a = _rates(*film)
    for side in "lr":
        assert v[:, _j(f"{side}_{joint}")].max() < speed
        assert a[:, _j(f"{side}_{joint}")].max() < acceleration


def test_the_body_moves_smoothly(film) -> None:
    v, a = _rates(*film)
    assert 1.0 < v[:, _j("waist")].max() < 1.9
    assert a[:, _j("waist")].max() < 21.0


def test_bones_keep_their_length_and_fit_a_human_skeleton(film) -> None:
    _, joints = film
    for j, parent in enumerate(PARENTS):
        if parent >= 0:
            length = np.linalg.norm(joints[:, j] - joints[:, parent], axis=-1)
            assert np.ptp(length) < 1e-9
            assert 0.05 < length[0] < CANONICAL.reach[j, parent]


def test_feet_stay_above_the_floor_and_at_least_one_stands_still(film) -> None:
    times, joints = film
    ankles = joints[:, [_j("l_ankle"), _j("r_ankle")]]
    assert joints[..., 2].min() > 0.0
    even = np.isclose(np.diff(times), 1 / 120, rtol=1e-3)
    speed = np.linalg.norm(np.diff(ankles, axis=0), axis=-1)[even] * 120
    # Between two swings both are slow; during a swing the other foot is planted.
    assert np.percentile(speed.min(axis=1), 90) < 1e-6
    assert speed.min(axis=1).max() < 0.5


def test_hips_stay_between_standing_and_a_long_step(film) -> None:
    _, joints = film
    assert joints[:, _j("waist"), 2].min() > 0.78
    assert joints[:, _j("waist"), 2].max() < 0.93  # 0.530 of 1.75 m


def test_waypoints_are_kept() -> None:
    times, joints = _film(_source([BUSY | {"repeat": False}], rate_hz=60.0), 30.0)
    waist = joints[:, _j("waist"), :2]
    for point in ([1.5, 0.4], [2.0, 1.5], [0.5, 2.5], [-0.2, 2.4]):
        assert np.linalg.norm(waist - point, axis=1).min() < 0.03
    np.testing.assert_allclose(waist[-1], [-0.2, 2.4], atol=0.02)
    assert times[-1] == pytest.approx(30.0, abs=0.05)  # stays


@pytest.mark.parametrize("hand", ["left", "right"])
def test_the_finger_tip_gets_to_the_target_and_stays(hand: str) -> None:
    target = [0.55, 0.1 if hand == "left" else -0.1, 1.0]
    person = {
        "start": [0.0, 0.0],
        "yaw": 0.0,
        "script": [{"do": "reach", "hand": hand, "to": target, "hold_s": 1.0}],
    }
    times, joints = _film(_source([person], rate_hz=100.0), 4.0)
    tip = joints[:, _j(f"{hand[0]}_hand")]
    near = np.linalg.norm(tip - target, axis=1) < 0.02
    assert np.count_nonzero(near) / 100.0 >= 1.0
    v, _ = _rates(times, joints)
    assert 0.5 < v[:, _j(f"{hand[0]}_hand")].max() < 2.0


def test_a_far_target_makes_the_person_lean() -> None:
    def neck_travel(distance: float) -> float:
        reach = {"do": "reach", "to": [distance, 0.0, 1.0], "hold_s": 0.5}
        film = _film(_source([{"start": [0, 0], "yaw": 0.0, "script": [reach]}]), 4.0)[1]
        return float(np.ptp(film[:, _j("neck"), 0]))

    assert neck_travel(0.5) < 0.03
    assert neck_travel(0.9) > 0.08


def test_people_come_in_and_go_out() -> None:
    source = _source(rate_hz=30.0)
    there = []
    while (due := source.next_ns()) is not None and due < 25e9:
        scene = source.poll(due)
        assert scene.sees_room
        there.append(bool(scene.people))
    assert not any(there[:29])  # enter_s 1.0
    assert all(there[31:500])
    changes = np.count_nonzero(np.diff(np.array(there).astype(int)))
    assert changes == 3  # in, out, in again


def test_scenes_do_not_depend_on_when_they_are_asked_for() -> None:
    more = {"noise_m": 0.005, "dropout": 0.1, "seed": 3, "rate_hz": 20.0}
    often, late = _source([BUSY, DEMO[0]], **more), _source([BUSY, DEMO[0]], **more)
    first = []
    for now in range(0, 3_000_000_000, 7_000_000):
        while (scene := often.poll(now)) is not None:
            first.append(scene)
    second = []
    while (scene := late.poll(2_999_999_999)) is not None:
        second.append(scene)
    assert len(second) - len(first) in (0, 1)
    for a, b in zip(first, second, strict=False):
        assert (a.stamp_ns, a.sequence) == (b.stamp_ns, b.sequence)
        for p, q in zip(a.people, b.people, strict=True):
            np.testing.assert_array_equal(p.positions, q.positions)
            np.testing.assert_array_equal(p.observed, q.observed)
    assert [s.sequence for s in second] == list(range(len(second)))


def test_the_seed_decides_the_noise_and_noise_is_what_it_says() -> None:
    def captured(seed: int, noise_m: float):
        return _film(_source([BUSY], seed=seed, noise_m=noise_m), 5.0)[1]

    clean, noisy = captured(1, 0.0), captured(1, 0.01)
    assert not np.array_equal(noisy, captured(2, 0.01))
    assert np.std(noisy - clean) == pytest.approx(0.01, rel=0.05)
    assert _source([BUSY], noise_m=0.01).declares_noise
    assert not _source([BUSY]).declares_noise


def test_dropout_leaves_joints_unobserved() -> None:
    source = _source([BUSY], dropout=0.2, seed=5)
    observed = []
    while (due := source.next_ns()) <= 5e9:
        (person,) = source.poll(due).people
        observed.append(person.observed)
        assert bool(np.isnan(person.positions[~person.observed]).all())
        assert bool(np.isfinite(person.positions[person.observed]).all())
    assert np.mean(observed) == pytest.approx(0.8, abs=0.03)


def test_what_is_out_of_view_is_not_observed() -> None:
    view = {"polygon": [[-1, -1], [1, -1], [1, 1], [-1, 1]], "z_max": 1.2}
    source = _source([BUSY | {"repeat": False}], field_of_view=view)
    first = source.poll(0).people[0]
    seen = {JOINTS[i] for i in np.flatnonzero(first.observed)}
    assert "waist" in seen
    assert "head" not in seen
    counts = []
    while (due := source.next_ns()) <= 20e9:
        counts.append(len(source.poll(due).people))
    assert counts[0] == 1
    assert counts[-1] == 0  # walked out of view
    truth = source.truth(20_000_000_000)  # and is still there
    assert truth[1][1].all()


def test_inside_is_right_for_a_concave_region() -> None:
    region = Region(polygon=[[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]], z_min=0.5, z_max=1.0)
    points = np.array(
        [[1, 1, 0.7], [2, 3, 0.7], [3, 1, 0.7], [1, 1, 0.2], [1, 1, 1.2], [5, 1, 0.7]]
    )
    np.testing.assert_array_equal(inside(region, points), [True, False, True, False, False, False])


def test_truth_is_the_scene_without_noise_and_between_captures_moves_on() -> None:
    clean, noisy = _source([BUSY], rate_hz=10.0), _source([BUSY], rate_hz=10.0, noise_m=0.05)
    scene = [clean.poll(10**9) for _ in range(11)][-1]
    np.testing.assert_allclose(noisy.truth(10**9)[1][0], scene.people[0].positions)
    moved = noisy.truth(1_050_000_000)[1][0] - noisy.truth(10**9)[1][0]
    assert 0.0 < np.abs(moved).max() < 0.3


def test_room_from_source_and_latency_are_applied() -> None:
    pose = {"xyz": [1, 2, 0.1], "quaternion_xyzw": [0, 0, 1, 0]}
    plain, moved = _source([BUSY]), _source([BUSY], room_from_source=pose, latency_s=0.05)
    assert moved.poll(49_000_000) is None
    assert moved.next_ns() == 50_000_000
    scene = moved.poll(50_000_000)
    assert scene.stamp_ns == 0
    expected = plain.poll(0).people[0].positions * [-1, -1, 1] + [1, 2, 0.1]
    np.testing.assert_allclose(scene.people[0].positions, expected, atol=1e-9)


def test_it_ends_when_it_is_told_to() -> None:
    source = _source([BUSY], duration_s=1.0, rate_hz=10.0)
    scenes = [source.poll(10**12) for _ in range(10)]
    assert scenes[-1].stamp_ns == 900_000_000
    assert source.next_ns() is None
    assert source.poll(10**12) is None


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ([{"do": "reach", "to": [2.0, 0, 1.0]}], "nearer first"),
        ([{"do": "reach", "to": [0.05, -0.2, 1.4]}], "too close"),
        ([{"do": "reach", "to": [0.1, -0.2, 2.1]}], "overhead"),
        ([{"do": "reach", "to": [0.5, 0, 1.0], "duration_s": 0.05}], "or more"),
        ([{"do": "walk", "to": [0, 0]}], "remove it"),
        ([{"do": "turn"}], "either"),
        ([{"do": "turn", "toward": [0, 0]}], "stands"),
        ([{"do": "walk", "to": [3, 0], "speed_m_s": 9}], "speed_m_s"),
        ([{"do": "fly"}], "fly"),
        ([], "script"),
    ],
)
def test_what_no_body_can_do_is_refused_with_the_remedy(script, words) -> None:
    with pytest.raises(ConfigError) as caught:
        _source([{"start": [0, 0], "yaw": 0.0, "script": script}])
    assert words in str(caught.value)
    assert "people.0" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_people_may_not_share_an_id() -> None:
    with pytest.raises(ConfigError, match="twice"):
        _source([BUSY | {"id": 3}, BUSY | {"id": 3}])


@pytest.mark.long
def test_bodies_of_all_sizes_walk_and_reach() -> None:
    for height in (1.4, 2.1):
        v, a = _rates(*_film(_source([BUSY | {"height_m": height}], rate_hz=120.0), 20.0))
        assert v.max() < 5.0
        assert a.max() < 75.0
        assert math.isfinite(v.sum())
