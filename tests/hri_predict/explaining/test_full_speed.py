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


def explained(
    path, *, stated=STATED, pair_m=0.6, separation_m=None, stops_late=0, detail="", **grounds
):
    grounds = {"person": 1, "way": "standard", "pair_m": pair_m, "terms_m": TERMS} | grounds
    said = advice("STOP", "PERSON_NEAR", body_part=3, grounds=grounds, detail=detail)
    said["separation_m"] = separation_m
    node = {"people": {}, "node": {"robot_stops_late": stops_late}, "links": {}}
    messages = [(0.0, "/scene", SCENE), (0.1, "/advice/arm", said), (0.2, "/node", node)]
    recordings = Recordings([written(path / "a.mcap", messages, full_speed=stated)])
    return explain(situation(recordings, AskedTime(NOON, SECOND), "arm"))


def test_it_is_told_with_the_robot_s_own_uncertainty(tmp_path):
    found = explained(tmp_path)
    assert found["separation"]["full_speed_enough_m"] == pytest.approx(1.52)
    assert "; 1.52 m are enough for full speed" in found["answer"]
    assert any("enough for full speed" in line and "1.520 m" in line for line in told(found))


def test_a_robot_that_may_not_move_is_told_what_it_lacks_to_start(tmp_path):
    """Not only that it needs more: how far people must be, and how much that is more."""
    stated = {"arm": FullSpeed(1.5, 0.01, 0.8)}
    grounds = {"pair_m": 0.4, "slack_m": 0.25, "way": "zones"}
    found = explained(tmp_path, stated=stated, separation_m=0.35, **grounds)
    assert found["separation"]["start_enough_m"] == pytest.approx(0.82)
    assert found["separation"]["start_short_m"] == pytest.approx(0.47)
    assert "; 0.82 m are enough to start, and 1.52 m for full speed" in found["answer"]
    lines = [" ".join(line.split()) for line in told(found)]
    assert "distance that is enough to start or to move on 0.820 m" in lines
    assert "missing of it 0.470 m" in lines


def test_a_robot_that_is_kept_only_by_the_wait_for_captures_is_told_so(tmp_path):
    stated = {"arm": FullSpeed(1.5, 0.01, 0.8)}
    grounds = {"pair_m": 0.9, "slack_m": 0.25, "way": "zones"}
    found = explained(tmp_path, stated=stated, separation_m=0.9, **grounds)
    assert found["separation"]["start_short_m"] == pytest.approx(-0.08)
    assert "0.82 m are enough to start, once new captures confirm it" in found["answer"]
    assert any("risk.release_captures" in line for line in told(found))


def test_what_it_lacks_is_not_told_where_it_is_not_known(tmp_path):
    found = explained(tmp_path, separation_m=0.35)
    assert found["separation"]["start_enough_m"] is None
    assert found["separation"]["start_short_m"] is None


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


def test_people_far_enough_for_a_start_for_a_second_do_not_stop_the_robot(near):
    recordings = Recordings([near])
    stated = recordings.info.full_speed["arm"]
    assert stated.start_m is not None
    assert 0.0 < stated.start_m < stated.enough_m
    since = None
    seen = 0
    for each in recordings.read(["/advice"]):
        grounds = each.data.get("grounds") or {}
        known = grounds.get("person") is not None and not grounds.get("human_m_s")
        if not known or each.data["separation_m"] < stated.start_m:
            since = None
            continue
        since = each.utc_ns if since is None else since
        if each.utc_ns - since > SECOND:
            seen += 1
            assert each.data["level"] not in ("STOP", "UNKNOWN"), each.data
    assert seen > 0
