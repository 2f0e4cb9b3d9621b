"""Many ticks are forecast at once, and each as if it were alone."""

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.predictor import Forecast
from hri_predict.protocol.reasons import Reason
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.working_distance.seen import BATCH, watch

SECONDS = 7.0  # in the shipped approach somebody comes after three


class Stays:
    """Everybody stays where he is; records how many were asked for at once."""

    skeleton, history_steps, horizon_steps, rate_hz = CANONICAL, 25, 30, 25.0

    def __init__(self, farthest_m=np.inf):
        self.asked, self.farthest_m = [], farthest_m

    def predict(self, history, observed):
        self.asked.append(len(history))
        if history[..., 0].max() > self.farthest_m:
            raise RuntimeError("too far away")
        ahead = np.repeat(history[:, -1:], self.horizon_steps, axis=1)
        return Forecast(ahead, np.abs(ahead[..., 0]))


@pytest.fixture(scope="module")
def config():
    return configuration.load(configuration.shipped("simulate.yaml")).quiet()


def seen(config, predictor):
    return watch(config, assemble.build_source(config), predictor, SECONDS)


def test_many_ticks_are_forecast_at_once_and_each_gets_its_own(config):
    predictor = Stays()
    found = seen(config, predictor)
    windows = sum(len(each.ids) for each in found.snapshots)
    assert max(predictor.asked) == BATCH
    assert len(predictor.asked) == -(-windows // BATCH)
    assert sum(predictor.asked) == windows > 2 * BATCH
    for snapshot, forecast, reasons in found.ticks():
        assert reasons == ()
        here = snapshot.history[:, -1:]
        assert forecast.positions.shape == (len(snapshot.ids), 30, len(CANONICAL.joints), 3)
        np.testing.assert_array_equal(forecast.positions, np.repeat(here, 30, axis=1))
        np.testing.assert_array_equal(forecast.std, np.abs(forecast.positions[..., 0]))


def test_a_window_that_cannot_be_forecast_takes_none_of_the_others_along(config):
    far_m = 3.0
    found = seen(config, Stays(far_m))
    failed = [reasons == (Reason.PREDICTOR_FAILED,) for reasons in found.reasons]
    assert failed == [s.history[..., 0].max(initial=0) > far_m for s in found.snapshots]
    assert failed == [forecast is None for forecast in found.forecasts]
    assert 0 < sum(failed) < len(failed)
