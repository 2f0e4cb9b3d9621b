"""A part that nobody saw is not told as if it had been seen."""

import pytest

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.explaining.explanation import explain, listing
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import episode_around, situation
from hri_predict.explaining.times import AskedTime
from hri_predict.explaining.words import told
from hri_predict.recording.mcap.info import FullSpeed
from tests.hri_predict.explaining.made_up import NOON, SECOND, advice, written

FOOT = CANONICAL.segment_names.index("l_foot")
GROUNDS = {"person": 1, "way": "zones", "pair_m": 0.7, "slack_m": -3.5, "terms_m": {"c": 0.0}}


def scene(*hidden):
    bits = "".join("0" if joint in hidden else "1" for joint in JOINTS)
    person = {"id": 1, "observed": bits, "positions": [[0.0, 0.0, 1.0]] * len(JOINTS)}
    return {"capture_ns": 0, "people": [person]}


def about(path, hidden=(), reasons=(), **grounds):
    said = advice(
        "STOP",
        "PERSON_NEAR",
        body_part=FOOT,
        robot_link=0,
        speed_m_s=0.0,
        grounds=GROUNDS | grounds,
    )
    status = {"type": "Status", "reasons": list(reasons)}
    messages = [(0.0, "/scene", scene(*hidden)), (0.1, "/status", status)]
    messages.append((0.1, "/advice/arm", said))
    full = {"arm": FullSpeed(1.9, 0.01)}
    return situation(
        Recordings([written(path / "a.mcap", messages, full_speed=full)]),
        AskedTime(NOON, SECOND),
        "arm",
    )


@pytest.mark.parametrize(
    ("hidden", "stated", "said"),
    [
        ((), None, "left foot was 0.70 m"),
        (("l_foot",), None, "left foot (seen in part; the rest is inferred) was 0.70 m"),
        (("l_ankle", "l_foot"), None, "left foot (not seen; its zone is inferred) was 0.70 m"),
        ((), 2, "left foot (not seen; its zone is inferred) was 0.70 m"),
        (("l_ankle", "l_foot"), 0, "left foot was 0.70 m"),
    ],
)
def test_an_answer_says_that_the_deciding_part_was_not_seen(tmp_path, hidden, stated, said):
    """By the advice, or, in older recordings, by the scene."""
    moment = about(tmp_path, hidden, **({} if stated is None else {"hidden_ends": stated}))
    found = explain(moment)
    assert said in found["answer"]
    part = said.partition(" was ")[0]
    assert any(f"From person 1's {part} to the robot's base" in p for p in told(found, 200))


def test_the_list_says_it_in_short(tmp_path):
    moment = about(tmp_path, hidden_ends=2)
    episode = episode_around(moment.recordings, "arm", moment.advice.utc_ns)
    assert episode is not None
    why = listing(episode, moment.recordings)["why"]
    assert why == "person 1's left foot (not seen) 0.70 m from base, too close"


def test_a_distance_by_physical_limits_is_told_with_their_cause(tmp_path):
    found = explain(about(tmp_path, reasons=["PREDICTOR_LATE"]))
    assert (
        "4.20 m were needed before the standing robot may start, because the predictor "
        in (found["answer"])
    )
    assert "enough" not in found["answer"]  # 1.9 m were not
    lines = list(told(found, 200))
    assert any("(more than usual, because the predictor was late" in line for line in lines)
    assert "Separation at 12:00:00.1" in lines


@pytest.mark.parametrize(
    ("slack_m", "answer", "row"),
    [
        (0.2, "too near for the standing robot to start; 1.90 m are enough", "0.200 m to spare."),
        (-0.3, "0.30 m more were needed before the standing robot may start; 1.90 m", "missing."),
    ],
)
def test_the_milder_rule_states_what_was_needed(tmp_path, slack_m, answer, row):
    """Zones by physical limits asked for 4.2 m, and the standard for less, so that decided."""
    milder = {"milder_way": "standard", "milder_slack_m": slack_m}
    found = explain(about(tmp_path, reasons=["PREDICTOR_LATE"], **milder))
    assert answer in found["answer"]
    assert "4.20 m" not in found["answer"]
    assert "; the zones were larger than usual, because the predictor was" in found["answer"]
    text = " ".join(" ".join(told(found)).split())
    assert "Judged by the standard's distance, the robot needed less, so that decided: " in text
    assert row in text
    assert "(more than usual, because the predictor was late" in text  # the zones' distance
    assert "(which decided)" in text
