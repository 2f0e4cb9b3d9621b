"""Outcomes added up, and shown."""

from dataclasses import asdict

import pytest

from hri_sim.simulation.results.outcome import Outcome, Prediction
from hri_sim.simulation.results.publish import asked_for
from hri_sim.simulation.results.report import (
    METRICS,
    judged,
    notes,
    predicted,
    recordings_table,
    shown,
    tables,
)
from hri_sim.simulation.results.statistics import Estimate


def rows(**differing):
    """Two approaches of two recordings, an hour each in all."""
    base = {"seconds": 1800.0, "judged_s": 900.0}
    pairs = [{k: v[i] for k, v in differing.items()} for i in (0, 1)]
    return [
        asdict(Outcome(index=i, motion=name, **(base | pair)))
        for i, (name, pair) in enumerate(zip("ab", pairs, strict=True))
    ]


def values(**differing):
    found = judged("p", "iso", rows(**differing)).estimates
    return {key: estimate.value for key, estimate in found.items()}


def test_rates_by_hand():
    found = values(
        contacts=(1, 0),
        contacts_standing=(1, 2),
        violation_s=(18.0, 0.0),
        moving_separation_m=(0.4, None),  # in the second it never moved
        judged_stops=(3, 1),
        false_stops=(1, 0),
        touches=(4, 4),
        missed=(1, 0),
        lead_s=([1.0, 2.0], [3.0]),
        cycles=(1.0, 2.0),
        cycles_empty=(4.0, 2.0),
    )
    assert found == pytest.approx(
        {
            "contacts": 0.5,  # 1 of 2 approaches
            "contacts_standing": 1.5,
            "violation_share": 18.0 / 3600,
            "moving_separation": 0.4,
            "stops_per_h": 4 / 1800,  # per second that can be judged
            "false_stops_per_h": 1 / 1800,
            "missed": 1 / 8,
            "lead_s": 2.0,
            "productivity": 3 / 6,
        }
    )


def test_what_each_recording_brings_in():
    many = rows(cycles=(1.0, 2.0)) + rows(cycles=(0.5, 0.0))
    found = judged("p", "iso", many).by_recording
    assert {name: (s["approaches"], s["seconds"], s["cycles"]) for name, s in found.items()} == {
        "a": (2, 3600.0, 1.5),
        "b": (2, 3600.0, 2.0),
    }


def test_productivity_by_recording_the_longest_first():
    iso = rows(seconds=(10.0, 99.6), cycles=(-1e-17, 1.0), cycles_empty=(4.0, 0.0))
    other = rows(seconds=(10.0, 99.6), cycles=(3.0, 1.0), cycles_empty=(4.0, 2.0))
    table = recordings_table([judged("p", "iso", iso), judged("p", "predictive", other)])
    assert table.columns[3:] == ("p iso", "p predictive")
    assert table.rows == (("b", "1", "100", "–", "50.0"), ("a", "1", "10", "0.0", "75.0"))


def test_nothing_to_divide_by_is_a_dash():
    found = judged("p", "iso", rows()).estimates
    assert [
        found[key].value for key in ("missed", "lead_s", "productivity", "moving_separation")
    ] == [None] * 4
    assert shown(found["missed"], METRICS[0]) == "–"


def test_a_value_is_shown_with_its_interval():
    metric = next(m for m in METRICS if m.key == "productivity")
    assert shown(Estimate(0.5, 0.25, 0.75), metric) == "50.0 [25.0, 75.0]"


def test_precision_recall_and_f1_by_hand():
    # 3 hits, 1 false alarm, 2 unforeseen: 3/4, 3/5, 2 * 3 / (2 * 3 + 1 + 2)
    counts = [
        Prediction(
            index=0,
            motion="a",
            true_positive=2,
            false_positive=1,
            false_negative=0,
            true_negative=5,
        ),
        Prediction(
            index=1,
            motion="b",
            true_positive=1,
            false_positive=0,
            false_negative=2,
            true_negative=5,
        ),
    ]
    found = predicted([asdict(c) for c in counts])
    assert [found[k].value for k in ("precision", "recall", "f1")] == pytest.approx(
        [3 / 4, 3 / 5, 6 / 9]
    )


def test_no_alarm_and_no_touch_is_a_dash_each():
    found = predicted(
        [
            asdict(
                Prediction(
                    index=0,
                    motion="a",
                    true_positive=0,
                    false_positive=0,
                    false_negative=0,
                    true_negative=9,
                )
            )
        ]
    )
    assert [e.value for e in found.values()] == [None] * 3


def test_tables_say_how_few_recordings_there_are_and_end_with_no_protection():
    result, alone = judged("p", "iso", rows()), judged("–", "no protection", rows(touches=(1, 0)))
    harm, work, touch = tables([result], alone, {"p": [asdict(Prediction(index=0, motion="a"))]})
    assert "2 approaches of 2 recordings" in harm.title
    assert (
        [row[1] for row in harm.rows]
        == [row[1] for row in work.rows]
        == [
            "iso",
            "no protection",
        ]
    )
    assert touch.rows[0][0] == "p"
    assert any("only 2" in note for note in notes([result]))
    for table in (harm, work, touch):
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert table.markdown().count("\n") == 3 + 1 + len(table.rows)


@pytest.mark.parametrize(
    ("recordings", "folders", "said"),
    [
        (["a", "b"], ["lab/monday"], "recordings a, b."),
        (list("abcd"), ["lab/monday"], "4 recordings from lab/monday; simulate.json and --json"),
        (list("abcd"), ["lab/a", "lab/b"], "4 recordings from lab/a and lab/b; "),
        (["procedural:0"] * 24, [], "24 recordings (procedural:0 and so on); "),
    ],
)
def test_many_recordings_are_counted_and_a_few_are_named(recordings, folders, said):
    asked = {"configuration": "c.yaml", "seed": 3, "recordings": recordings, "folders": folders}
    line = asked_for(asked)
    assert line.startswith(f"Settings: configuration c.yaml; seed 3; {said}")
