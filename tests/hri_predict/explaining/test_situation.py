"""Who was there at a moment."""

import pytest

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.explaining.situation import people_seen
from hri_predict.explaining.window import TimeWindow
from hri_predict.recording import RecordingInfo
from hri_predict.recording.mcap.messages import Told

SECOND = 1_000_000_000
INFO = RecordingInfo(joint_map=load_joint_map("canonical"), rate_hz=2.0, declares_noise=False)


def scene(seconds, observed):
    ns = round(seconds * SECOND)
    person = {"id": 1, "observed": observed * 21, "positions": [[0.0, 0.0, 1.0]] * 21}
    return Told("/scene", ns, ns, {"capture_ns": ns, "people": [person]})


@pytest.mark.parametrize(("first", "ago_s"), [("1", 0.5), ("0", None)])
def test_a_person_without_a_joint_was_not_seen_then(first, ago_s):
    window = TimeWindow(scenes=[scene(1.0, first), scene(1.5, "0")])
    (found,) = people_seen(window, INFO, round(1.5 * SECOND), "")
    assert (found["observed"], found["last_seen_s"]) == (0, ago_s)
