"""``check`` tells how old a calibration is, what it rests on and what it guarantees."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from hri_predict.cli.check.zones import calibration_lines, calibration_notes, facts_of
from hri_predict.zones.calibration import SiteParts, UsedRecording, load_calibration, save_text
from tests.hri_predict.zones.conftest import calibration_of

TODAY = date(2026, 6, 2)


def lines(**changes):
    return calibration_lines(facts_of(calibration_of(**changes), TODAY))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (None, "it does not say when it was made; from 20 recordings"),
        (date(2026, 6, 2), "made on 2026-06-02, 0 days ago; from 20 recordings"),
        (date(2026, 6, 1), "1 day ago; from 20 recordings"),
        (date(2025, 6, 1), "366 days ago; does it still match the people and the tracker? See"),
        (date(2026, 6, 3), "in the future: check this computer's date; from"),
    ],
)
def test_the_age_is_told(made, said):
    assert said in lines(recordings=20, made=made)[0]


def test_each_level_tells_whether_it_is_guaranteed():
    first, *levels = lines(recordings=20)
    assert first.startswith("calibration:")
    assert levels[0].strip() == "90 %: guaranteed"
    assert levels[1].strip() == "95 %: guaranteed"
    assert "99 %: estimated; a guarantee needs 79 more recordings of" in levels[2]


def test_parts_of_a_site_are_told_and_guarantee_nothing():
    parts = tuple(
        UsedRecording(name=f"night from minute {n}", windows=(9, 9, 9)) for n in range(99)
    )
    site = SiteParts(base="0123456789abcdef", recordings=parts)
    first, *levels = lines(recordings=20, site=site)
    assert "from 20 recordings, moved by 99 parts of a site's" in first
    assert "estimated" in levels[2]


def test_date_and_site_survive_the_file(tmp_path):
    site = SiteParts(base="0123", recordings=(UsedRecording(name="n", windows=(1, 2, 3)),))
    made = replace(calibration_of(), made=TODAY, site=site)
    path = tmp_path / "own.json"
    path.write_text(save_text(made))
    back = load_calibration(path)
    assert (back.made, back.site) == (TODAY, site)
    assert back.used == (*made.recordings, *site.recordings)


def test_without_a_calibration_nothing_is_said():
    assert calibration_lines(None) == []
    assert calibration_notes(None) == []


def test_a_speed_that_too_few_recordings_show_is_told():
    whole = calibration_of(recordings=20)
    assert calibration_notes(facts_of(whole, TODAY)) == []
    estimated = {of: table.copy() for of, table in whole.estimated.items()}
    for table in estimated.values():
        table[:, 0] = np.inf
    (note,) = calibration_notes(facts_of(replace(whole, estimated=estimated), TODAY))
    assert "too few recordings of people who are still; physical limits are used" in note
