"""How fast a lost body may go on: a runner who speeds up is faster than he was on average."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.standing import standing_body
from hri_predict.people.lost.lost_people import speeding

J = len(JOINTS)
ALL = np.ones(J, bool)
SHAPE = standing_body()
RATE = 25.0


def way(begin_s, gain_m_s2, top_m_s):
    """Metres after a time: at rest until ``begin_s``, then faster and faster up to a speed."""

    def at(t):
        run = max(t - begin_s, 0.0)
        rising = min(run, top_m_s / gain_m_s2)
        return 0.5 * gain_m_s2 * rising**2 + top_m_s * (run - rising)

    return at


def seen(make_room, at, first_s, last_s, noise_m=0.0):
    """The room after a body was seen in this time."""
    room, rng = make_room(latency=0), np.random.default_rng(3)
    for k in range(round(first_s * RATE), round(last_s * RATE) + 1):
        place = SHAPE + np.array([at(k / RATE), 0.0, 0.0]) + rng.normal(0.0, noise_m, SHAPE.shape)
        room.see(Person(1, place, ALL))
    return room


@pytest.mark.parametrize("gain", [3.0, 6.4])
@pytest.mark.parametrize("top", [4.0, 6.0, 8.0])
@pytest.mark.parametrize("seen_s", [0.16, 0.28, 0.4, 0.52])
@pytest.mark.parametrize("stood", [True, False])
def test_who_is_lost_while_speeding_up_stays_within_the_zone(make_room, gain, top, seen_s, stood):
    at = way(1.0, gain, top)
    room = seen(make_room, at, 0.2 if stood else 1.0, 1.0 + seen_s)
    (lost,) = room.see(times=4).lost
    begin = round((1.0 + seen_s) * RATE) / RATE
    for later in np.arange(0.1, 1.3, 0.1):  # until then a robot that was told so stands
        assert at(begin + later) - at(begin) <= lost.speed_m_s * later + 0.02


def test_speed_and_gain_are_those_of_the_newest_captures(make_room):
    room = seen(make_room, way(0.4, 6.0, 9.0), 0.0, 1.0)
    (track,) = room.people._tracks.values()
    assert speeding(track) == pytest.approx((3.6, 6.0), abs=0.05)  # evenly: exact but for rounding


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_who_walks_or_stands_does_not_speed_up(make_room, noise_m):
    for speed in (0.0, 1.4):
        room = seen(make_room, lambda t, v=speed: v * t, 0.0, 2.0, noise_m)
        (lost,) = room.see(times=4).lost
        # 1.25 times the speed and 0.4 m/s; the noise of 21 joints' mean is 0.01 / sqrt(21) m
        assert lost.speed_m_s == pytest.approx(max(1.6, 1.25 * speed + 0.4), abs=0.05)


def test_who_slows_down_is_as_fast_as_measured(make_room):
    room = seen(make_room, lambda t: 5.0 * t - 1.5 * t * t, 0.0, 1.0)
    (lost,) = room.see(times=4).lost
    assert 2.5 <= lost.speed_m_s <= 3.9


def test_the_limit_is_what_a_body_can_do(make_room):
    room = seen(make_room, way(0.0, 9.0, 9.0), 0.0, 0.8)
    (lost,) = room.see(times=4).lost
    assert lost.speed_m_s == 10.0


def test_a_body_seen_in_two_captures_only_does_not_speed_up(make_room):
    room = make_room(latency=0)
    room.see(Person(1, SHAPE, ALL), times=2)
    (track,) = room.people._tracks.values()
    assert speeding(track) is None


def test_a_runner_of_whom_only_a_standing_foot_was_seen_last_goes_on_at_the_trunks_speed(make_room):
    room, speed = make_room(latency=0), 3.0
    foot = np.arange(J) == JOINTS.index("r_foot")
    for k in range(20):
        body = SHAPE + np.array([speed * k / RATE, 0.0, 0.0])
        body[foot] = SHAPE[foot] + np.array([speed * min(k, 15) / RATE, 0.0, 0.0])
        seen = foot if k == 19 else ALL
        room.see(Person(1, body, seen))
    (lost,) = room.see(times=4).lost
    assert lost.speed_m_s >= 3.0
