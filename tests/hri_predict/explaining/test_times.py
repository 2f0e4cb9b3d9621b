"""Times as people write them."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import situation
from hri_predict.explaining.times import NS, asked, dated, shown
from tests.hri_predict.explaining.made_up import NOON, SECOND, told, written

DAY = 86_400 * SECOND


@pytest.fixture
def noon(tmp_path):
    """Two minutes from noon on."""
    return Recordings([written(tmp_path / "a.mcap", told("C" * 121, 1.0))])


@pytest.mark.parametrize(
    ("text", "seconds", "width_s"),
    [
        ("12:00:07", 7, 1),
        ("12:00:07.5", 7.5, 0.1),
        ("12:01", 60, 60),
        ("12:00:07.250Z", 7.25, 0.001),  # as alerts and the log have it
        ("2026-03-08T12:00:07", 7, 1),
        ("2026-03-08 12:00:07Z", 7, 1),
        ("2026-03-08T13:00:07+01:00", 7, 1),
        ("2026-03-08T07:30:07-04:30", 7, 1),
        ("7", 7, 1),
        ("7.25", 7.25, 0.01),
    ],
)
def test_each_way_to_write_a_time(noon, text, seconds, width_s):
    found = asked(text, noon)
    assert found.start_ns - NOON == round(seconds * NS)
    assert found.width_ns == round(width_s * NS)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("25:00:00", "not a time of day"),
        ("12:00:61", "not a time of day"),
        ("13:30:00", "not recorded; these recordings are from 2026-03-08T12:00:00.00"),
        ("2026-02-30T12:00:00", "not a date"),
        ("noon", ": not a time"),
        ("-3", ": not a time"),
        ("1e3", ": not a time"),
    ],
)
def test_what_is_no_time_is_one_line(noon, text, words):
    with pytest.raises(ConfigError, match=words):
        asked(text, noon)


@pytest.mark.parametrize("text", ["25:99", "noon"])
def test_an_impossible_time_is_said_before_missing_utc(tmp_path, text):
    virtual = Recordings([written(tmp_path / "a.mcap", told("CC"), utc_ns=None)])
    with pytest.raises(ConfigError, match="not a time"):
        asked(text, virtual)


def test_a_time_of_two_days_needs_its_date(tmp_path):
    written(tmp_path / "a.mcap", told("CC"))
    written(tmp_path / "b.mcap", told("CC"), utc_ns=NOON + DAY)
    with pytest.raises(ConfigError, match="on which day"):
        asked("12:00:00", Recordings([tmp_path]))
    found = asked("2026-03-09T12:00:00", Recordings([tmp_path]))
    assert found.start_ns == NOON + DAY


def test_a_recording_after_midnight_has_the_next_day(tmp_path):
    """From 23:59:30 on: 00:00:10 is of the day after."""
    start = NOON + DAY // 2 - 30 * SECOND
    late = Recordings([written(tmp_path / "a.mcap", told("C" * 60, 1.0), utc_ns=start)])
    assert asked("00:00:10", late).start_ns == start + 40 * SECOND


def test_without_utc_only_seconds_are_taken(tmp_path):
    virtual = Recordings([written(tmp_path / "a.mcap", told("CC"), utc_ns=None)])
    assert asked("0.1", virtual).start_ns == virtual.start_ns + NS // 10
    with pytest.raises(ConfigError, match="have no UTC"):
        asked("12:00:00", virtual)


def test_what_is_shown_can_be_asked(noon):
    at_ns = NOON + 7_250_000_000
    assert shown(at_ns, noon) == "12:00:07.2"
    assert asked(dated(at_ns, noon), noon).start_ns == at_ns


@pytest.mark.parametrize("text", ["0001-01-01T00:00:00+23:59", "9999-12-31T23:59:59-23:59"])
def test_a_time_before_or_after_all_dates_is_one_line(noon, text):
    with pytest.raises(ConfigError, match="not recorded"):
        situation(noon, asked(text, noon), None)
