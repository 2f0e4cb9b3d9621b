"""What a tracker makes of a procedural body: its joints, its noise, its stamps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.people.tracker import Wander, delivered_by

STANDS = {"start": [2.0, 0.0], "script": [{"do": "wait", "seconds": 60.0}]}
TRACKERS = ("coco17", "mediapipe33", "azure_kinect32", "zed34")


def source(**settings):
    data = {"kind": "procedural", "people": [STANDS]} | settings
    made = ProceduralSource(validated(ProceduralSettings, data, "source"))
    made.open(0)
    return made


def captured(made, count: int):
    """(N, J, 3) of the only person, and (N,) stamps."""
    scenes = [made.poll(10**12) for _ in range(count)]
    return np.array([s.people[0].positions for s in scenes]), np.array([s.stamp_ns for s in scenes])


@pytest.mark.parametrize("name", TRACKERS)
def test_only_what_the_tracker_delivers_arrives(name):
    made, tracker = source(joint_map=name), load_joint_map(name)
    person = made.poll(0).people[0]
    joints, observed = made.joint_map.map(person.positions, person.observed)
    np.testing.assert_array_equal(observed, tracker.mapped)
    truth = made.truth(0)[1][0]
    own = [JOINTS.index(j) for j in ("l_wrist", "r_hip", "l_shoulder", "head")]
    np.testing.assert_array_equal(joints[own], truth[own])
    assert np.isnan(person.positions[JOINTS.index("head_top")]).all()


def test_a_derived_joint_has_the_errors_of_those_that_it_is_derived_from():
    made = delivered_by(load_joint_map("coco17"))
    positions = np.random.default_rng(0).normal(size=(len(JOINTS), 3))
    joints, _ = made.map(positions, np.ones(len(JOINTS), bool))
    hips = positions[[JOINTS.index("l_hip"), JOINTS.index("r_hip")]]
    np.testing.assert_allclose(joints[JOINTS.index("waist")], hips.mean(0), atol=1e-15)


@pytest.mark.parametrize("name", TRACKERS)
def test_what_is_delivered_weighs_one(name):
    weights = delivered_by(load_joint_map(name)).weights.sum(1)
    assert set(np.round(weights, 12)) == {0.0, 1.0}


@given(rate_hz=st.floats(8, 120), wander_s=st.floats(0.05, 2.0), seed=st.integers(0, 99))
def test_wandering_noise_is_as_large_and_as_correlated_as_said(rate_hz, wander_s, seed):
    wander = Wander(0.02, wander_s, rate_hz, [seed])
    # 3000 series at once, three captures: 4.5 standard errors of a deviation and of a correlation
    first, second, third = (wander.next(1000).ravel() for _ in range(3))
    assert third.std() == pytest.approx(0.02, rel=4.5 / math.sqrt(2 * 3000))
    expected = math.exp(-1 / (rate_hz * wander_s))
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(expected, abs=4.5 / math.sqrt(3000))


def test_wandering_noise_declares_noise_and_begins_anew_with_the_source():
    made = source(wander_m=0.02, seed=4)
    assert made.declares_noise
    first, _ = captured(made, 5)
    made.open(0)
    np.testing.assert_array_equal(captured(made, 5)[0], first)
    assert not np.array_equal(captured(source(wander_m=0.02, seed=5), 5)[0], first)


def test_stamps_are_late_by_up_to_the_jitter_and_stay_in_order():
    plain, late = source(), source(stamp_jitter_s=0.03)
    clean, captures = captured(plain, 200)
    positions, stamps = captured(late, 200)
    np.testing.assert_array_equal(positions, clean)  # of the capture's time, not of the stamp's
    off = stamps - captures
    assert off.min() >= 0
    assert off.max() < 30_000_000
    assert np.ptp(off) > 20_000_000
    assert (np.diff(stamps) > 0).all()


def test_jitter_beyond_a_period_is_refused_with_the_remedy():
    with pytest.raises(ConfigError, match="less than one period"):
        source(stamp_jitter_s=0.04, rate_hz=30.0)


def test_an_unknown_tracker_is_refused():
    with pytest.raises(ConfigError, match="coco18"):
        source(joint_map="coco18")
