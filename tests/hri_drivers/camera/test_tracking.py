"""Ids of people in one camera's pictures."""

import numpy as np

from hri_drivers.camera.tracking import KEPT_S, Tracker
from tests.hri_drivers.camera.pictures import body

PERIOD_NS = 33_333_333
SIZE = 200.0  # pixels; a pixel is then a centimetre or less


def test_a_person_who_walks_keeps_an_id():
    tracker = Tracker()
    ids = {tracker.assign([body(100 + 8 * k)], k * PERIOD_NS)[0] for k in range(60)}
    assert ids == {1}


def test_two_people_who_cross_keep_their_ids():
    """They meet, and one hides the other for a few pictures."""
    tracker = Tracker()
    ends = None
    for k in range(61):
        left, right = body(120 + 6 * k), body(480 - 6 * k, 250)
        hidden = 27 <= k <= 33
        ids = tracker.assign([left] if hidden else [left, right], k * PERIOD_NS)
        assert ids[0] == 1
        ends = ids
    assert ends == [1, 2]


def test_the_order_of_a_networks_people_does_not_matter():
    tracker = Tracker()
    assert tracker.assign([body(100), body(400)], 0) == [1, 2]
    assert tracker.assign([body(404), body(104)], PERIOD_NS) == [2, 1]


def test_a_person_who_leaves_and_returns_gets_a_new_id():
    tracker = Tracker()
    assert tracker.assign([body(600)], 0) == [1]
    back = round(1e9 * KEPT_S) + 1
    assert tracker.assign([body(600)], back) == [2]
    assert tracker.given == 2


def test_a_person_who_was_missed_for_a_moment_keeps_the_id():
    tracker = Tracker()
    tracker.assign([body(300)], 0)
    tracker.assign([], PERIOD_NS)
    assert tracker.assign([body(304)], 2 * PERIOD_NS) == [1]


def test_another_person_elsewhere_is_another():
    tracker = Tracker()
    tracker.assign([body(100)], 0)
    assert tracker.assign([body(300)], PERIOD_NS) == [2]


def test_a_body_with_hidden_joints_is_matched_by_the_others():
    tracker = Tracker()
    tracker.assign([body(100), body(400)], 0)
    half = body(405)
    half[10:] = np.nan
    assert tracker.assign([half], PERIOD_NS) == [2]
    nothing = np.full((33, 2), np.nan)
    assert tracker.assign([nothing], 2 * PERIOD_NS) == [3]


def test_ids_fit_the_wire_for_ever():
    tracker = Tracker()
    tracker._last_id = 65_534
    assert tracker.assign([body(100), body(400), body(700)], 0) == [65_535, 1, 2]
