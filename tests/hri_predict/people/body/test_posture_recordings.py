"""No recorded person is refused, and every wrong rotation of one who stands or walks is found."""

import numpy as np
import pytest

from hri_predict.cli.check.floor import Floor, floor_of
from tests.hri_predict.people.body.posture_table import (
    COCO,
    SEEN,
    noisy,
    recordings,
    refused_after_s,
    seen_of,
    verdicts,
    wrong,
)
from tests.shared import DATA

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not DATA.exists(), reason="the data pack is not here"),
]


@pytest.fixture(scope="module")
def everyone():
    return list(recordings(DATA))


def test_no_recorded_capture_is_refused(everyone):
    for played in everyone:
        assert not any(verdicts(played.positions, played.observed)), played.name


@pytest.mark.parametrize(("number", "kind"), list(enumerate(SEEN)))
def test_no_recorded_capture_is_refused_without_a_trunk_in_view(everyone, number, kind):
    for played in everyone[number % 2 :: 2]:  # each recording in half of the views
        assert not any(verdicts(played.positions, played.observed & seen_of(kind))), played.name


def test_every_wrong_rotation_and_mirror_of_a_walker_is_found_within_a_second(everyone):
    walks = [p for p in everyone if p.group == "cmu_mocap/test"]
    for played in walks[::4]:
        for kind, positions, view in wrong(played, 1.2):
            seen = played.observed[: len(positions)] & COCO
            assert refused_after_s(noisy(positions), seen, view) <= 1.0, (played.name, kind)


def test_in_no_span_a_recorded_body_is_at_an_impossible_height_and_one_metre_off_it_is(everyone):
    """Frames of the two sets of upper bodies begin above the floor."""
    upper = seen_of("head, neck, shoulders, arms")
    wrong_by: dict[float, list[bool]] = {-1.0: [], 0.0: [], 1.0: []}
    for played in everyone:
        if played.group in ("assembly", "motion/beside_robot"):
            continue
        for start in range(0, max(1, len(played.positions) - 89), 45):
            span = played.positions[start : start + 90]
            seen = played.observed[start : start + 90] & upper
            for off_m, found in wrong_by.items():
                floor = floor_of({1: (span + np.array([0, 0, off_m]), seen)}, 0.0).floor
                found.append(floor is not Floor.UNSEEN)
    assert len(wrong_by[0.0]) > 1000
    assert not any(wrong_by[0.0])
    assert all(wrong_by[-1.0])
    assert np.mean(wrong_by[1.0]) > 0.999


def test_the_recordings_are_there(everyone):
    assert len({played.group for played in everyone}) == 8
    assert all(np.isfinite(played.positions).all() for played in everyone)
