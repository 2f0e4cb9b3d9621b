from dataclasses import replace

import numpy as np
import pytest

import hri_predict
from hri_predict.base.errors import ConfigError, PredictorError, RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Scene
from hri_predict.predictors.baselines import ZeroVelocity
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.recording import recording_of
from hri_sim.people.body import Body

RATE_HZ = 30.0


@pytest.fixture
def walk(tmp_path):
    """Two people for 1 s; person 7 walks along x at 1 m/s, person 3 stands."""
    body = Body(1.75)
    times = np.arange(30)[:, None, None] / RATE_HZ
    pose = body.joints(body.standing(np.zeros(2), 0.0))
    moving = pose + times * np.array([1.0, 0.0, 0.0])
    legs = [k for k, name in enumerate(JOINTS) if name[2:] in ("knee", "ankle", "foot")]
    moving[:, legs, 0] += 0.2 * np.sin(2 * np.pi * times[:, 0])
    standing = np.broadcast_to(pose + np.array([0.0, 3.0, 0.0]), moving.shape)
    raw = np.stack([moving, standing], axis=1)
    return recording_of(
        path=tmp_path / "walk.csv",
        kind="csv",
        joint_map=load_joint_map("canonical"),
        raw=raw,
        rate_hz=RATE_HZ,
        ids=[7, 3],
    )


def test_every_scene_has_a_forecast_that_carries_on(walk):
    predictor = hri_predict.load_predictor("constant_velocity", horizon_s=0.4)
    found = list(hri_predict.forecasts(walk, predictor))
    assert [f.time_s for f in found] == pytest.approx([k / RATE_HZ for k in range(30)])
    last = found[-1]
    assert last.ids == (3, 7)  # the node sorts by id
    assert last.horizons_s == pytest.approx(np.arange(1, 11) / 25)
    assert last.positions.shape == (2, 10, 21, 3)
    assert last.reasons == ()
    waist = last.joints.index("waist")
    expected = walk.scenes[-1].people[0].positions[waist] + np.array([0.4, 0.0, 0.0])
    # exact in real numbers; resampling costs roundings of metres, 1e-16 each, over 0.12 s spans
    np.testing.assert_allclose(last.positions[1, -1, waist], expected, atol=1e-9)


def test_one_time_is_the_newest_scene_by_then(walk):
    predictor = hri_predict.load_predictor("kalman", horizon_s=0.4)
    every = list(hri_predict.forecasts(walk, predictor))
    for time_s, k in [(0.0, 0), (0.05, 1), (walk.duration_s, 29)]:
        once = hri_predict.forecast_at(walk, predictor, time_s)
        assert once.time_s == every[k].time_s
        np.testing.assert_array_equal(once.positions, every[k].positions)


def test_nothing_later_is_looked_at(walk):
    predictor = hri_predict.load_predictor("constant_velocity")
    cut = replace(walk, scenes=walk.scenes[:15], arrival_ns=walk.arrival_ns[:15])
    whole = list(hri_predict.forecasts(walk, predictor))[:15]
    for a, b in zip(whole, hri_predict.forecasts(cut, predictor), strict=True):
        np.testing.assert_array_equal(a.positions, b.positions)


def test_a_blind_scene_says_so_and_an_empty_room_has_nobody(walk):
    first = walk.scenes[0]
    scenes = [Scene(first.stamp_ns, 0, True, ()), Scene(walk.scenes[1].stamp_ns, 1, False, ())]
    short = replace(walk, scenes=scenes, arrival_ns=walk.arrival_ns[:2])
    predictor = hri_predict.load_predictor("zero_velocity")
    empty, blind = hri_predict.forecasts(short, predictor)
    assert (empty.ids, empty.positions.shape) == ((), (0, 25, 21, 3))
    assert empty.reasons == ()
    assert Reason.SOURCE_BLIND in blind.reasons


def test_mistakes_are_one_line(walk):
    with pytest.raises(ConfigError, match="unknown predictor 'kalmann'; did you mean 'kalman'"):
        hri_predict.load_predictor("kalmann")
    with pytest.raises(ConfigError, match=r"load_predictor\('kalman'\): horizon: unknown key"):
        hri_predict.load_predictor("kalman", horizon=1.0)
    predictor = hri_predict.load_predictor("zero_velocity")
    for time_s in (-0.1, 1.0, float("nan")):
        with pytest.raises(RecordingError, match=r"give a time from 0 to 0\.967 s"):
            hri_predict.forecast_at(walk, predictor, time_s)


def test_a_predictor_that_breaks_its_contract_is_an_error(walk):
    class Broken(ZeroVelocity):
        def predict(self, history, observed):
            found = super().predict(history, observed)
            return replace(found, positions=found.positions * np.nan)

    broken = Broken(ZeroVelocity.settings_model(name="zero_velocity"))
    with pytest.raises(PredictorError, match="not finite"):
        next(hri_predict.forecasts(walk, broken))
