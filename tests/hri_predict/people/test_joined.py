"""Two ids that a source found to be one person's: one track goes, and nobody is lost by it."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import SourceSettings
from hri_predict.people.people import People
from hri_predict.people.settings import PeopleSettings
from hri_sim.people.body import Body

FIGURE = Body(1.75)
SEEN = np.ones(len(JOINTS), np.bool_)
PERIOD_NS = 40_000_000


def person(number: int, x: float, k: int) -> Person:
    joints = FIGURE.joints(FIGURE.standing(np.array([x, 0.0]), 0.0))
    noise = np.random.default_rng([number, k]).normal(0.0, 0.004, joints.shape)
    return Person(number, joints + noise, SEEN)


def nobody() -> People:
    return People(
        settings=PeopleSettings(),
        joint_map=load_joint_map("canonical"),
        source_settings=SourceSettings.model_validate({"kind": "x", "room_from_source": {}}),
        rate_hz_source=25.0,
        declares_noise=True,
        history_steps=10,
        rate_hz_predictor=25.0,
    )


@pytest.mark.parametrize(
    ("joined", "shows_kept", "lost"), [(((2, 1),), True, 0), ((), True, 1), (((2, 1),), False, 2)]
)
def test_the_id_that_is_gone_is_lost_unless_the_other_one_is_seen(joined, shows_kept, lost):
    people = nobody()
    for k in range(40):
        both = (person(1, 2.0, k), person(2, 2.1, k))
        found = both if k < 20 else both[:1] if shows_kept else ()
        told = joined if k == 20 else ()
        now_ns = 10**9 + k * PERIOD_NS
        people.receive(Scene(now_ns, k, True, found, joined=told), now_ns)
    snapshot = people.snapshot(now_ns)
    assert snapshot.ids == ((1,) if shows_kept else ())
    assert len(snapshot.lost) == lost


@pytest.mark.parametrize(
    ("apart_m", "is_one"), [(0.35, True), (0.45, True), (0.8, False), (3, False)]
)
@pytest.mark.parametrize("still_shown", [False, True])
def test_two_bodies_that_were_just_seen_apart_are_two_people_whatever_the_source_says(
    apart_m, is_one, still_shown
):
    people = nobody()
    for k in range(40):
        both = (person(1, 2.0, k), person(2, 2.0 + apart_m, k))
        found = both if k < 20 or (still_shown and k == 20) else both[:1]
        now_ns = 10**9 + k * PERIOD_NS
        joined = ((2, 1),) if k == 20 else ()
        people.receive(Scene(now_ns, k, True, found, joined=joined), now_ns)
    snapshot = people.snapshot(now_ns)
    assert len(snapshot.lost) == (0 if is_one else 1)
    assert snapshot.counters.get("joined", 0) == is_one
    assert snapshot.counters.get("joined_too_far_apart", 0) == (not is_one)
