"""A scene's people are mapped to canonical joints as each would be alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person
from hri_predict.people.body.canonical import canonical_bodies, canonical_body
from hri_sim.people.body import Body

CANONICAL, ORIGIN = load_joint_map("canonical"), np.array([0.5, 0.0, 1.0])
J = len(JOINTS)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.4))
SPOILS = ("nothing", "unseen", "origin", "waist", "far", "huge", "nan", "shape", "error", "flags",
          "ints", "letters")  # fmt: skip


def spoilt(how, number, rng):
    """A person, as a tracker with that fault sends them."""
    positions, seen = BODY + rng.normal(0.0, 0.02, 3), rng.random(J) < 0.9
    some = rng.random(J) < 0.4
    error_m = float("nan") if how == "error" else 0.0
    if how == "unseen":
        seen[:] = False
    elif how == "origin":
        positions[some] = ORIGIN
    elif how == "waist":
        positions += ORIGIN - positions[JOINTS.index("waist")]
        positions[JOINTS.index("waist")] = ORIGIN
    elif how == "far":
        positions[some] += 3.0
    elif how == "huge":
        positions[some] *= 2000.0
    elif how == "nan":
        positions[some] = np.nan
    elif how == "shape":
        positions = positions[:-1]
    elif how == "flags":
        seen = seen[:-1]
    elif how == "ints":
        seen = seen.astype(np.uint8)
    elif how == "letters":
        positions = positions.astype(str)
    return Person(number, positions, seen, error_m=error_m)


def same(found, alone):
    assert found._replace(body=None) == alone._replace(body=None)
    assert (found.body is None) == (alone.body is None)
    if found.body is not None and alone.body is not None:
        assert found.body.id == alone.body.id
        np.testing.assert_array_equal(found.body.observed, alone.body.observed)
        # products of matrices may add up in another order: coordinates below 4 m
        np.testing.assert_allclose(found.body.positions, alone.body.positions, atol=1e-14)
        assert not found.body.positions[~found.body.observed].any()


@given(hows=st.lists(st.sampled_from(SPOILS), max_size=6), seed=st.integers(0, 2**32 - 1))
def test_a_body_is_mapped_alike_whoever_else_is_in_the_scene(hows, seed):
    rng = np.random.default_rng(seed)
    people = [spoilt(how, number, rng) for number, how in enumerate(hows)]
    found = canonical_bodies(people, CANONICAL, ORIGIN)
    assert len(found) == len(people)
    for person, mapped in zip(people, found, strict=True):
        same(mapped, canonical_body(person, CANONICAL, ORIGIN))


@pytest.mark.parametrize(
    ("how", "trouble"),
    [("nothing", None), ("shape", "malformed_bodies"), ("flags", "malformed_bodies"),
     ("ints", "malformed_bodies"), ("letters", "malformed_bodies"), ("error", "absurd_errors"),
     ("unseen", None), ("waist", None)],
)  # fmt: skip
def test_the_trouble_is_that_of_the_person(how, trouble):
    rng = np.random.default_rng(3)
    people = [spoilt("nothing", 0, rng), spoilt(how, 1, rng), spoilt("nothing", 2, rng)]
    found = canonical_bodies(people, CANONICAL, ORIGIN)
    assert [mapped.trouble for mapped in found] == [None, trouble, None]
    assert (found[1].body is not None) == (how in ("nothing", "waist"))
    assert found[1].hip_centred == (how == "waist")
    for number in (0, 2):
        body = found[number].body
        assert body is not None
        assert body.id == number
