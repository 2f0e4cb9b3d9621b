"""Ids of the people in a snapshot."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.snapshot import LostPerson, distinct

NOBODY = np.zeros(len(JOINTS))
LOST = LostPerson(
    id=0,
    positions=np.zeros((len(JOINTS), 3)),
    joint_age_s=NOBODY,
    last_seen_ns=0,
    speed_m_s=1.6,
    limbs_m_s=NOBODY,
)
IDS = st.integers(-5, 5)


@given(st.lists(IDS), st.sets(IDS))
def test_no_id_names_two_people(lost, tracked):
    people = [replace(LOST, id=number, last_seen_ns=k) for k, number in enumerate(lost)]
    found = distinct(people, tracked)
    assert [person.last_seen_ns for person in found] == list(range(len(lost)))
    ids = [person.id for person in found]
    assert len({*ids, *tracked}) == len(ids) + len(tracked)
    if len({*lost, *tracked}) == len(lost) + len(tracked):
        assert ids == lost
