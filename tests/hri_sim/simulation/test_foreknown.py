"""Zones of the true future: they hold the body as it will be, and are no wider."""

import numpy as np
import pytest

from hri_sim.referee import TruePeople
from hri_sim.simulation.approach import ApproachSource
from hri_sim.simulation.bodies import compute
from hri_sim.simulation.cell import variants


@pytest.fixture(scope="module")
def found(cell):
    modes = variants(cell.config, ["predictive", "foreknown"], [])
    return compute(cell=cell, motions=["procedural:1"], lead_in_s=0.4, variants=modes)


@pytest.mark.long
def test_zones_are_where_the_body_will_be(cell, found):
    settings = cell.source.model_copy(
        update={"motions": ["procedural:1"], "places": [[0.0, 0.0, 0.0]], "lead_in_s": 0.4}
    )
    truth = TruePeople(ApproachSource(settings, cell.config.base_dir))
    truth.open(found.snapshots[0].now_ns)
    tick = len(found.snapshots) // 2
    zones = found.zones["foreknown"][tick].zones
    step = 10
    then = truth.at(found.snapshots[tick].now_ns + round(zones.times_s[step] * 1e9))
    joints, known = then[zones.ids[0]]
    segments = {s.name: s for s in cell.predictor.skeleton.segments}
    for s, name in enumerate(zones.segments):
        segment = segments[name]
        for end, joint in (
            (zones.capsules.a, segment.joint_a),
            (zones.capsules.b, segment.joint_b),
        ):
            assert known[joint]
            apart = np.linalg.norm(end[0, step, s] - joints[joint])
            # 10 ms of the lookup's grid at 2 m/s, beside the interval's own half
            assert apart <= zones.capsules.radius[0, step, s] - segment.radius + 0.02


def test_they_are_narrower_than_those_of_a_forecast(found):
    tick = len(found.snapshots) // 2
    mine = found.zones["foreknown"][tick].zones.capsules.radius
    theirs = found.zones["predictive"][tick].zones.capsules.radius
    assert mine.shape == theirs.shape
    assert (mine[:, 10] < theirs[:, 10]).all()
    np.testing.assert_array_equal(mine[:, 0], theirs[:, 0])  # as captured


def test_whole_node_is_not_asked_about_the_future(cell):
    (mode,) = variants(cell.config, ["foreknown"], [])
    assert mode.is_foreknown
    assert dict(mode.risk) == {"mode": "predictive"}
