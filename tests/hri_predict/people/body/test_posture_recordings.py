"""No recorded person is refused, and every wrong rotation of one who stands or walks is found."""

import numpy as np
import pytest

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


def test_the_recordings_are_there(everyone):
    assert len({played.group for played in everyone}) == 8
    assert all(np.isfinite(played.positions).all() for played in everyone)
