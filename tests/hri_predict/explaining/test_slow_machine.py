"""A machine that was too slow is named as a cause of what it makes look late."""

import pytest

from hri_predict.explaining.explanation import explain
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import situation
from hri_predict.explaining.times import AskedTime
from hri_predict.explaining.words import told
from tests.hri_predict.explaining.made_up import NOON, SECOND, advice, written

SLOW = {"late_ticks": 20, "missed_ticks": 60, "predictor_late": 18}
SAYS = "; the node's machine was too slow: 20 ticks late and 60 missed around then"


def about(path, reason, counted):
    """Advice of 3 s at 10 Hz, explained at its end; a second's counters at 0 and 3 s."""
    node = {"now_ns": 0, "people": {}, "links": {}}
    messages = [(0.0, "/node", node | {"node": dict.fromkeys(counted, 0)})]
    for k in range(31):
        status = {"type": "Status", "cycle": 50 + k, "reasons": [reason], "age_s": 0.3}
        messages += [
            (k * 0.1, "/status", status),
            (k * 0.1, "/advice/arm", advice("UNKNOWN", reason)),
        ]
    messages.append((3.0, "/node", node | {"node": counted}))
    recordings = Recordings([written(path / "a.mcap", messages)])
    return explain(situation(recordings, AskedTime(NOON + 3 * SECOND, SECOND), "arm"))


@pytest.mark.parametrize(
    "reason", ["INPUT_STALE", "CLOCK_JUMP", "CLOCK_DRIFT", "ROBOT_STATE_STALE"]
)
def test_it_is_named_with_what_it_makes_look_late(tmp_path, reason):
    found = about(tmp_path, reason, SLOW)
    assert found["answer"].endswith(SAYS)
    lines = [line.strip() for line in told(found, 200)]
    assert {"node: late ticks +20", "node: missed ticks +60"} <= set(lines)


@pytest.mark.parametrize(
    ("reason", "counted"),
    [
        ("INPUT_STALE", {"late_ticks": 3, "missed_ticks": 0}),  # a tenth is needed
        ("INPUT_STALE", {"scenes_in": 30}),  # an older recording does not say
        ("PERSON_NEAR", SLOW),
    ],
)
def test_it_is_not_named_otherwise(tmp_path, reason, counted):
    assert "too slow" not in about(tmp_path, reason, counted)["answer"]
