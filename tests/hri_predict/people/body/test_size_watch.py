"""People of a wrong size are refused, in whole or in part, and no recorded person is."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.size_watch import SizeWatch
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body
from hri_predict.protocol.reasons import Reason
from hri_sim.people.body import Body as Figure
from tests.hri_predict.people.body.posture_table import COCO, RATE_HZ, recordings
from tests.shared import DATA

ALL = np.ones(len(JOINTS), np.bool_)
_FIGURE = Figure(1.75)
STANDS = _FIGURE.joints(_FIGURE.standing(np.array([3.0, 1.0]), 0.3))
SEEN = {
    "whole": ALL,
    "no legs": ~np.isin(JOINTS, [f"{s}_{j}" for s in "lr" for j in ("knee", "ankle", "foot")]),
    "one arm": np.isin(JOINTS, ["r_shoulder", "r_elbow", "r_wrist"]),
    "COCO": COCO,
}


def verdicts(positions, observed, watch=None):
    watch = watch or SizeWatch(PeopleSettings())
    return [
        watch.is_wrong(Body(1, at, seen), round(k * 1e9 / RATE_HZ))
        for k, (at, seen) in enumerate(zip(positions, observed, strict=True))
    ]


@pytest.mark.parametrize("seen", SEEN)
@pytest.mark.parametrize("scale", [0.39, 0.5, 1.0, 1.25, 2.0, 2.54])
def test_a_wrong_scale_is_found_within_half_a_second(seen, scale):
    found = verdicts([scale * STANDS] * 15, [SEEN[seen]] * 15)
    assert found[-1] == (scale not in (1.0, 1.25))  # a giant of 2.2 m is possible


def test_single_captures_and_parts_without_a_limb_prove_nothing():
    head = np.isin(JOINTS, ["head", "neck", "l_shoulder", "r_shoulder"])
    assert not any(verdicts([2.0 * STANDS] * 30, [head] * 30))
    torn = [2.0 * STANDS if k % 21 == 0 else STANDS for k in range(60)]
    assert not any(verdicts(torn, [ALL] * 60))


def test_a_person_of_a_wrong_size_stays_wrong_while_limbs_are_hidden():
    head = np.isin(JOINTS, ["head", "neck", "l_shoulder", "r_shoulder"])
    found = verdicts([2.0 * STANDS] * 105, [ALL] * 15 + [head] * 90)  # three seconds
    assert all(found[14:])


def test_a_cell_without_posture_checks_may_have_any_bodies():
    watch = SizeWatch(PeopleSettings(posture_unchecked="a robot with legs"))
    assert not any(verdicts([2.0 * STANDS] * 30, [ALL] * 30, watch))


def test_another_person_starts_anew():
    watch = SizeWatch(PeopleSettings())
    assert verdicts([2.0 * STANDS] * 15, [ALL] * 15, watch)[-1]
    later_ns = 5_000_000_000  # the id is another person's
    assert not watch.is_wrong(Body(1, STANDS, ALL), later_ns)


def test_the_node_refuses_a_body_of_twice_its_size_and_still_tracks_it(make_room):
    room = make_room(posture_unchecked=None)
    snapshot = room.see(Person(1, 2.0 * STANDS, SEEN["no legs"]), times=15)
    assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons
    assert snapshot.counters["wrong_size_bodies"] > 0
    assert snapshot.ids == (1,)


@pytest.mark.long
@pytest.mark.skipif(not DATA.exists(), reason="the data pack is not here")
def test_no_recorded_person_is_of_a_wrong_size():
    rng = np.random.default_rng(0)
    for played in recordings(DATA):
        for part in (ALL, SEEN["no legs"], SEEN["COCO"]):
            noise = rng.normal(0.0, 0.02, played.positions.shape)
            seen = played.observed & part
            assert not any(verdicts(played.positions + noise, seen)), played.name
