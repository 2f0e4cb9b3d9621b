"""The senders of the fault table are heard by the sources of the node."""

import time
from pathlib import Path

import numpy as np
import pytest

from hri_drivers.sources.live import LiveSource
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts import registry
from hri_predict.contracts.scene import Person, Scene
from hri_sim.people.body import Body
from hri_sim.senders.live_ends import LIVE_ENDS

pytestmark = pytest.mark.realtime

ENDS = ("udp", "json", "websocket", "mvn", "mvn over tcp", "serial", "zenoh")
COUNT = 12
_BODY = Body(1.75)
STANDING = _BODY.joints(_BODY.standing(np.array([1.7, 0.2]), np.pi))


def newest(source, wanted: int) -> Scene:
    """The last scene that is heard, once ``wanted`` were decoded."""
    give_up_s = time.monotonic() + 20.0
    heard: list[Scene] = []
    while source.counters.scenes < wanted or not heard:
        assert time.monotonic() < give_up_s, source.counters
        source.arrived.wait(0.1)
        source.arrived.clear()
        while (scene := source.poll(time.monotonic_ns())) is not None:
            heard.append(scene)
    return heard[-1]


@pytest.mark.parametrize("kind", ENDS)
def test_what_is_sent_is_heard(kind, tmp_path: Path) -> None:
    end = LIVE_ENDS[kind](tmp_path)
    cls = registry.load("sources", end.source["kind"])
    settings = {"room_from_source": {}, "rate_hz": 30} | end.source
    source = cls(validated(cls.settings_model, settings, "source"))
    assert isinstance(source, LiveSource)
    source.open(time.monotonic_ns())
    try:
        for run in (1, 2):  # the second time it begins anew
            end.start()
            for sequence in range(COUNT):
                person = Person(1, STANDING, np.ones(len(JOINTS), np.bool_))
                sent = Scene(time.time_ns(), sequence, True, (person,))
                for unit in end.encode(sent):
                    end.write(unit)
            # MVN's of the second run count as late until there are too many of them
            (person,) = newest(source, COUNT if run == 1 else COUNT + 3).people
            joints, observed = source.joint_map.map(person.positions, person.observed)
            assert np.count_nonzero(observed) >= 18
            np.testing.assert_allclose(joints[observed], STANDING[observed], atol=1e-3)
            end.stop()
        assert source.counters.restarts == 1
    finally:
        source.close()
        end.stop()
