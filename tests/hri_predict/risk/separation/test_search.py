"""Loops and arrays find the same pair, to the last bit: ties, spheres, touching, not finite."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.risk.separation import search
from hri_predict.zones.toward import NOTHING

SIZES = st.tuples(*(st.integers(1, n) for n in (3, 4, 4, 3, 3)))
VERSIONS = pytest.mark.parametrize(
    ("spheres_of", "find"),
    [
        (search.spheres_of, search.search),  # compiled, where numba is installed
        (search._spheres_by_loops, search.search_by_loops),
    ],
)


def capsules(rng: np.random.Generator, kind: str, *shape: int) -> search.Arrays:
    """Capsules on a coarse grid, where many are equally near, or anywhere."""
    a: Floats
    if kind == "anywhere":
        a = np.asarray(rng.normal(size=(*shape, 3)))
        return a, a + rng.normal(size=(*shape, 3)) * 0.5, rng.random(shape) * 0.3
    a = np.array(rng.integers(-2, 3, (*shape, 3)) * 0.5)
    along = rng.integers(-1, 2, (*shape, 3)) * 0.5
    along[rng.random(shape) < 0.3] = 0.0  # spheres
    radius = np.where(rng.random(shape) < 0.5, 0.0, 0.25)  # of no size, or touching
    a[rng.random(shape) < (0.2 if kind == "not finite" else 0.0)] = rng.choice([np.nan, np.inf])
    return a, a + along, radius


@VERSIONS
@given(
    seed=st.integers(0, 2**32 - 1),
    size=SIZES,
    kinds=st.tuples(*[st.sampled_from(["anywhere", "grid", "not finite"])] * 2),
    enough=st.sampled_from([np.inf, 1.0, 0.5, 0.0, -1.0]),
)
def test_loops_and_arrays_find_the_same(spheres_of, find, seed, size, kinds, enough):
    rng = np.random.default_rng(seed)
    persons, steps, segments, links, groups = size
    people = capsules(rng, kinds[0], persons, steps, segments)
    robot = capsules(rng, kinds[1], groups * steps, links)
    first = rng.integers(0, steps, groups)
    courses = (
        first,
        rng.integers(0, (groups - 1) * steps + 1, groups),
        rng.integers(1, steps - first + 1),
        np.where(rng.random(groups) < 0.5, enough, np.inf),
    )
    with np.errstate(all="ignore"):
        by_loops = find((people, spheres_of(*people), NOTHING), robot, courses)
        bodies = people, search._spheres_by_arrays(*people), NOTHING
        by_arrays = search._search_by_arrays(bodies, robot, courses)
    for loops, arrays in zip(by_loops, by_arrays, strict=True):
        np.testing.assert_array_equal(loops, arrays)
