"""Where a robot was slowed: from when to when, and what names it."""

import pytest

from hri_predict.explaining.episodes import episodes
from hri_predict.explaining.explanation import explain, listing
from hri_predict.explaining.reason_clause import because
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.shift.tally import tally
from hri_predict.explaining.situation import situation
from hri_predict.explaining.times import AskedTime
from hri_predict.explaining.words import told as told_as
from hri_predict.protocol.reasons import CLEARED, RISING
from tests.hri_predict.explaining.made_up import NOON, SECOND, advice, told, written


def found(tmp_path, messages):
    recordings = Recordings([written(tmp_path / "a.mcap", messages)])
    return recordings, list(episodes(recordings.read(["/advice"])))


def test_each_slowdown_is_one_with_its_worst_phase(tmp_path):
    recordings, (first, second) = found(tmp_path, told("CCSSXXXRRSCCUUC"))
    assert (first.start_ns, first.end_ns) == (
        recordings.start_ns + 200_000_000,
        recordings.start_ns + 1_000_000_000,
    )
    assert (first.before, first.after) == ("CLEAR", "CLEAR")
    assert (first.worst.level, first.worst.reason) == ("STOP", "PERSON_NEAR")
    assert [phase.level for phase in first.phases] == ["SLOW", "STOP", "STOP", "SLOW"]
    assert second.worst.reason == "INPUT_STALE"


def test_a_slowdown_costs_what_the_limit_takes_away(tmp_path):
    """1 s at 0.25 m/s and 2 s of stop, of 1 m/s: 0.75 and 2 s; each advice holds until the next."""
    config = "robots: [{name: arm, max_speed_m_s: 1.0}]"
    path = written(tmp_path / "a.mcap", told("C" + "S" * 10 + "X" * 20 + "C"), config=config)
    recordings = Recordings([path])
    (episode,) = episodes(recordings.read(["/advice"]))
    assert episode.lost_s(1.0) == pytest.approx(2.75, abs=1e-6)  # times have nanoseconds
    assert listing(episode, recordings)["lost_s"] == 2.8
    (robot,) = tally(recordings, None, None)["robots"]
    assert robot["lost_s"] == 2.8
    assert [cause["lost_s"] for cause in robot["causes"]] == [2.8]


def test_without_a_full_speed_no_cost_is_claimed(tmp_path):
    recordings, (episode,) = found(tmp_path, told("CXXC"))
    assert listing(episode, recordings)["lost_s"] is None


def test_what_waits_is_not_what_names_it(tmp_path):
    _, (episode,) = found(tmp_path, told("CRRXXRRC"))
    assert episode.worst.reason == "PERSON_NEAR"
    waiting = episode.cause_before(episode.phases[-1].first.utc_ns)
    assert waiting is not None
    assert waiting.reason == "PERSON_NEAR"


def test_a_pause_of_the_recording_ends_an_episode(tmp_path):
    later = [(at + 60.0, topic, message) for at, topic, message in told("XX")]
    _, both = found(tmp_path, [*told("XX"), *later])
    assert len(both) == 2
    assert both[0].end_ns is None


def test_a_level_that_nobody_knows_stops(tmp_path):
    _, (episode,) = found(tmp_path, [(0.0, "/advice/arm", advice("HURRY", "NOTHING"))])
    assert episode.worst.level == "UNKNOWN"


def test_a_shift_counts_what_was_told(tmp_path):
    """1 s each of clear, slow, stop and unknown, then clear again: counted by hand."""
    levels = "C" * 10 + "S" * 10 + "X" * 10 + "U" * 10 + "C" * 11
    path = written(tmp_path / "a.mcap", told(levels, separation_m=0.55), config="robots: []")
    (robot,) = tally(Recordings([path]), None, None)["robots"]
    assert robot["seconds_at"] == {
        "CLEAR": 2.0, "WARN": 0.0, "SLOW": 1.0, "STOP": 1.0, "UNKNOWN": 1.0, "FAULT": 0.0,
    }  # fmt: skip
    assert (robot["stops"], robot["stopped_s"]) == (1, 2.0)
    assert (robot["nearest_m"], robot["nearest_at"]) == (0.55, "12:00:00.0")
    # 2 s of five at 1 m/s, 1 s at 0.25 m/s
    assert robot["permitted_share"] == pytest.approx(2.25 / 5.0, abs=1e-4)  # rounded to 4 digits
    assert robot["full_speed_share"] == pytest.approx(0.4, abs=1e-4)
    assert dict(map(tuple, robot["separation"]))[0.5] == 5.0
    assert robot["age_p99_s"] == pytest.approx(0.02, abs=0.0011)  # bins of 1 ms


def test_a_shift_says_what_was_not_recorded(tmp_path):
    later = [(at + 60.0, topic, message) for at, topic, message in told("CC")]
    path = written(tmp_path / "a.mcap", [*told("CC"), *later])
    (robot,) = tally(Recordings([path]), None, None)["robots"]
    assert robot["seconds"] == pytest.approx(0.2)
    assert robot["not_recorded_s"] == pytest.approx(59.9)


def test_a_part_of_a_shift(tmp_path):
    recordings = Recordings([written(tmp_path / "a.mcap", told("C" * 20 + "X" * 20))])
    part = tally(recordings, recordings.start_ns + 2 * SECOND, None)
    assert part["robots"][0]["seconds_at"]["CLEAR"] == 0.0


def of_run(levels):
    """A start of the node, then these levels at 10 a second, then its end."""
    start = [(0.1 * k, "/advice/arm", advice("UNKNOWN", "STARTING")) for k in range(3)]
    wait = [(0.3 + 0.1 * k, "/advice/arm", advice("UNKNOWN", "RELEASE_PENDING")) for k in range(5)]
    rest = [(0.8 + at, topic, message) for at, topic, message in told(levels)]
    end = [(0.8 + 0.1 * len(levels), "/advice/arm", advice("UNKNOWN", "STOPPING"))]
    return [*start, *wait, *rest, *end]


def test_a_start_is_named_by_the_start_and_not_by_its_wait(tmp_path):
    _, (start, end) = found(tmp_path, of_run("CCCC"))
    assert start.worst.reason == "STARTING"
    assert end.worst.reason == "STOPPING"


def test_start_and_end_of_a_run_are_no_stops_of_a_shift(tmp_path):
    path = written(tmp_path / "a.mcap", of_run("CCXXXXXCC"), config="robots: []")
    (robot,) = tally(Recordings([path]), None, None)["robots"]
    assert robot["stops"] == 1
    assert robot["stopped_s"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("level", "detail", "answer"),
    [
        ("SLOW", RISING, "at first slowly: its limit had risen to 0.25 m/s"),
        ("STOP", CLEARED, "waited for new captures"),
        ("SLOW", "", "no more than 0.25 m/s was safe"),
    ],
)
def test_a_robot_that_only_waits_is_not_explained_by_who_is_near(tmp_path, level, detail, answer):
    """The reason is kept for some captures; the detail is of the moment."""
    said = advice(level, "PERSON_APPROACHING", detail=f"arm: {detail}; person 1", speed_m_s=0.2)
    recordings, _ = found(tmp_path, [(0.1 * k, "/advice/arm", said) for k in range(5)])
    assert answer in because(situation(recordings, AskedTime(recordings.start_ns, SECOND), "arm"))


@pytest.mark.parametrize(
    ("reason", "detail", "answer"),
    [
        ("PERSON_APPROACHING", "", "its full speed, 0.25 m/s, was safe"),
        ("PERSON_APPROACHING", RISING, "its limit had risen to its full speed, 0.25 m/s"),
        ("RELEASE_PENDING", "", "its limit was its full speed again"),
    ],
)
def test_a_limit_of_full_speed_does_not_read_as_a_restriction(tmp_path, reason, detail, answer):
    said = advice("SLOW", reason, detail=f"arm: {detail}; person 1", speed_m_s=0.2)
    config = "robots: [{name: arm, max_speed_m_s: 0.25}]"
    path = written(tmp_path / "a.mcap", [(0.1 * k, "/advice/arm", said) for k in range(5)])
    unknown = explain(situation(Recordings([path]), AskedTime(NOON, SECOND), "arm"))
    path = written(tmp_path / "b.mcap", [(0.0, "/advice/arm", said)], config=config)
    found = explain(situation(Recordings([path]), AskedTime(NOON, SECOND), "arm"))
    assert answer in found["answer"]
    assert "no more than" not in found["answer"]
    assert "at first slowly" not in found["answer"]
    assert any("speed limit 0.25 m/s (its full speed)" in line for line in told_as(found, 200))
    assert answer not in unknown["answer"]


def test_a_cause_that_comes_and_goes_is_named_not_the_wait_between(tmp_path):
    there = advice("STOP", "PERSON_NEAR", separation_m=0.5)
    waits = advice("STOP", "PERSON_NEAR", separation_m=0.9, detail=f"arm: {CLEARED}; person 1")
    told = [there, waits, waits, there]
    recordings, _ = found(tmp_path, [(0.1 * k, "/advice/arm", each) for k, each in enumerate(told)])

    def answer(after_s: float, width_s: float) -> str:
        asked = AskedTime(recordings.start_ns + round(after_s * SECOND), round(width_s * SECOND))
        return because(situation(recordings, asked, "arm"))

    assert answer(0.1, 1.0).startswith("a person was 0.50 m")
    waited = answer(0.1, 0.1)
    assert waited.startswith("it waited for new captures")
    assert "before that, until 12:00:00.0: a person was 0.50 m" in waited


def test_a_shift_of_two_runs_adds_up_what_they_dropped_and_names_a_changed_speed(tmp_path):
    """Each run of the node counts from 0, and each file states its own configuration."""
    paths = []
    for k, (dropped, speed) in enumerate(((3, 1.0), (2, 0.5))):
        lost = [(1.0, "/clock", {"dropped": 0}), (2.0, "/clock", {"dropped": dropped})]
        config = f"robots: [{{name: arm, max_speed_m_s: {speed}}}]"
        path = tmp_path / f"{k}.mcap"
        messages = sorted((*told(30 * "C"), *lost), key=lambda message: message[0])
        paths.append(written(path, messages, config=config, utc_ns=NOON + k * 60 * SECOND))
    shift = tally(Recordings(paths), None, None)
    assert shift["dropped"] == 5
    assert any("max_speed_m_s was changed between the files" in note for note in shift["notes"])
    alone = tally(Recordings(paths[:1]), None, None)
    assert (alone["dropped"], alone["notes"]) == (3, [])
