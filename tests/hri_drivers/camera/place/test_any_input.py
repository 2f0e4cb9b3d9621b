"""Whatever a network gives: a place that is finite and has a stated error, or a reason."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hri_drivers.camera.place.alone import place_alone
from hri_drivers.camera.place.by_depth import place_by_depth
from hri_drivers.camera.place.placed import Placed, Unplaced
from hri_drivers.camera.place.together import View, place_together
from hri_drivers.camera.seen import Seen
from tests.hri_drivers.camera.place.bodies import CAMERA, person, seen_at
from tests.hri_drivers.camera.place.test_together import LEFT, RIGHT

ANY = st.floats(width=64)
WIDE = st.one_of(ANY, st.floats(-2, 2), st.floats(0, 1300))
BODIES = st.builds(
    Seen,
    id=st.integers(1, 3),
    layout=st.just("mediapipe33"),
    pixels=arrays(np.float64, (33, 2), elements=WIDE),
    visibility=arrays(np.float64, 33, elements=st.one_of(ANY, st.just(1.0))),
    world=arrays(np.float64, (33, 3), elements=WIDE),
)
MAX_ERROR_M = 20.0  # of the scene stream


def check(placed):
    if isinstance(placed, Unplaced):
        assert placed.why
        return
    assert isinstance(placed, Placed)
    assert np.isfinite(placed.positions[placed.observed]).all()
    assert np.isnan(placed.positions[~placed.observed]).all()
    assert 0 < placed.error_m <= MAX_ERROR_M


def mixed(seen: Seen, which: int) -> Seen:
    """A good body of which some joints are as another one's."""
    good = seen_at(np.array([0.2, 0, 3.0]))
    assert good.world is not None
    assert seen.world is not None
    wrong = np.arange(33) % 7 == which
    return replace(
        good,
        pixels=np.where(wrong[:, None], seen.pixels, good.pixels),
        world=np.where(wrong[:, None], seen.world, good.world),
    )


pytestmark = pytest.mark.filterwarnings("error")


@given(BODIES, st.integers(0, 6))
def test_one_camera(seen, which):
    check(place_alone(seen, CAMERA))
    check(place_alone(mixed(seen, which), CAMERA))


@given(BODIES, BODIES)
def test_two_cameras(one, other):
    for found in place_together([View(LEFT, 0, (one,)), View(RIGHT, 0, (other,))]):
        check(found.placed)


@given(BODIES, st.integers(0, 6), st.floats(width=32))
def test_a_depth_camera(seen, which, metres):
    depth = np.full((CAMERA.size[1], CAMERA.size[0]), metres, np.float32)
    check(place_by_depth(seen, depth, CAMERA))
    body = CAMERA.project(np.add(person(), [0.2, 0, 3.0]))
    x, y = np.rint(body[which]).astype(int)
    depth[y - 5 : y + 6, x - 5 : x + 6] = 3.0
    check(place_by_depth(mixed(seen, which), depth, CAMERA))
