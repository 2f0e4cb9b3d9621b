"""From the room to a shipped network and back, where little of a body is seen."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts import registry
from hri_predict.predictors.building import predictor_of

MOVE_M = np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def mixer():
    return predictor_of(registry.predictor_settings("mixer")(name="mixer"))


@pytest.mark.parametrize("only", [["waist"], ["head_top"], ["neck", "head_top"]])
def test_a_person_seen_only_by_joints_that_the_network_lacks_stands_there(mixer, only):
    joints = [JOINTS.index(name) for name in only]
    shape = (2, mixer.history_steps, len(JOINTS))
    observed = np.zeros(shape, dtype=bool)
    observed[:, :, joints] = True
    history = np.zeros((*shape, 3)) + np.array([[4.0, 3.0, 1.2], [-5.0, 2.0, 1.2]])[:, None, None]
    ahead = mixer.predict(history, observed).positions
    apart = np.linalg.norm(ahead[:, :, :, :2] - history[:, -1:, :1, :2], axis=-1)
    assert apart.max() < 1.0  # within a body, and not at the room's origin
    assert ahead[:, 0, joints] == pytest.approx(history[:, -1, joints], abs=0.1)
    moved = mixer.predict(history + MOVE_M, observed).positions
    np.testing.assert_allclose(moved, ahead + MOVE_M, rtol=0, atol=1e-4)


def test_people_seen_otherwise_or_not_at_all_are_as_before(mixer):
    rng = np.random.default_rng(3)
    history = rng.normal(0, 0.3, (2, mixer.history_steps, len(JOINTS), 3)) + 1.5
    observed = np.ones(history.shape[:3], dtype=bool)
    observed[1] = False
    both = mixer.predict(history, observed).positions
    alone = mixer.predict(history[:1], observed[:1]).positions
    np.testing.assert_allclose(both[:1], alone, rtol=0, atol=1e-5)
    assert np.isfinite(both).all()
