"""How far people must be for the robot's full speed: told where the recording holds it."""

import pytest

from hri_predict.explaining.explanation import explain
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import situation
from hri_predict.explaining.times import AskedTime
from hri_predict.explaining.words import told
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.mcap.info import FullSpeed
from tests.hri_predict.explaining.made_up import NOON, SECOND, advice, written

STATED = {"arm": FullSpeed(1.5, 0.01)}
TERMS = {"s_h": 0.3, "s_r": 0.0, "s_s": 0.0, "c": 0.0, "z_d": 0.05, "z_r": 0.03}
SCENE = {
    "capture_ns": 0,
    "people": [{"id": 1, "observed": "1" * 21, "positions": [[0.0, 0.0, 1.0]] * 21}],
}


def explained(path, *, stated=STATED, pair_m=0.6, stops_late=0, detail="", **grounds):
    grounds = {"person": 1, "way": "standard", "pair_m": pair_m, "terms_m": TERMS} | grounds
    said = advice("STOP", "PERSON_NEAR", body_part=3, grounds=grounds, detail=detail)
    node = {"people": {}, "node": {"robot_stops_late": stops_late}, "links": {}}
    messages = [(0.0, "/scene", SCENE), (0.1, "/advice/arm", said), (0.2, "/node", node)]
    recordings = Recordings([written(path / "a.mcap", messages, full_speed=stated)])
    return explain(situation(recordings, AskedTime(NOON, SECOND), "arm"))


def test_it_is_told_with_the_robot_s_own_uncertainty(tmp_path):
    found = explained(tmp_path)
    assert found["separation"]["full_speed_enough_m"] == pytest.approx(1.52)
    assert "; 1.52 m are enough for full speed" in found["answer"]
    assert any("enough for full speed" in line and "1.520 m" in line for line in told(found))


@pytest.mark.parametrize(
    "given",
    [
        {"stated": {}},
        {"stated": {"other": FullSpeed(1.5, 0.01)}},
        {"stops_late": 1},
        {"human_m_s": 2.4},
        {"detail": "speed of person 1 unknown"},
        {"person": 2},
    ],
)
def test_it_is_not_told_where_it_is_not_known(tmp_path, given):
    """Not stated, or by a wrong table; or of somebody fast, of unknown speed, or not seen."""
    found = explained(tmp_path, **given)
    assert found["separation"]["full_speed_enough_m"] is None
    assert "enough" not in found["answer"]
    assert not any("enough for full speed" in line for line in told(found))


def test_the_answer_leaves_it_out_where_another_pair_was_nearer(tmp_path):
    assert "enough" not in explained(tmp_path, pair_m=1.6)["answer"]


def test_people_that_far_away_do_not_slow_the_robot(near):
    recordings = Recordings([near])
    stated = recordings.info.full_speed["arm"]
    beyond = 0
    for each in recordings.read(["/advice"]):
        grounds = each.data.get("grounds") or {}
        if grounds.get("person") is None or grounds.get("human_m_s"):
            continue
        if not Reason[each.data["reason"]].row.by_distance:
            continue  # a start, or the wait after one
        moved_m = grounds["terms_m"]["z_r"] - stated.z_r_m
        if each.data["separation_m"] >= stated.enough_m + moved_m:
            beyond += 1
            assert each.data["level"] == "WARN", each.data
    assert beyond > 0
