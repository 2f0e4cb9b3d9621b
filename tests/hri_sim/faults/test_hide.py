"""Joints that a sensor does not see."""

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_sim.faults.injector import FaultySource
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource

STANDS = {"start": [2.0, 0.0], "script": [{"do": "wait", "seconds": 9.0}]}


def standing(**hide):
    people = [{**STANDS, "id": i} for i in (4, 5)]
    settings = ProceduralSettings.model_validate({"kind": "procedural", "people": people})
    fault = {"kind": "hide", "start_s": 1.0, "duration_s": 1.0, **hide}
    source = FaultySource(ProceduralSource(settings), [fault], 0)
    source.open(0)
    return source


@pytest.mark.parametrize("person", [None, 5])
def test_named_joints_are_hidden_for_a_time(person):
    source = standing(joints=["l_hand", "waist"], person=person)
    names = source.joint_map.source_joints
    for sequence in range(70):
        scene = source.poll(source.next_ns())
        assert scene.sequence == sequence
        for each in scene.people:
            hidden = 30 <= sequence < 60 and person in (None, each.id)
            gone = {names[j] for j in np.flatnonzero(~each.observed)}
            assert gone == ({"l_hand", "waist"} if hidden else set())
            assert np.isnan(each.positions[~each.observed]).all()


def test_a_joint_that_the_source_does_not_have_cannot_be_hidden():
    with pytest.raises(ConfigError, match=r"unknown joint 'l_hnad'.*l_hand"):
        standing(joints=["l_hnad"])
