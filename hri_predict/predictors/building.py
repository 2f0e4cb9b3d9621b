"""Builds a predictor from validated settings, in the node's process or in its own."""

import contextlib

from hri_predict.base.errors import PredictorError
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor, PredictorSettings, refuse_unsound
from hri_predict.predictors.neural.settings import NeuralSettings


def predictor_of(settings: PredictorSettings) -> Predictor:
    """Build a predictor from validated settings with resolved paths.

    A shipped network runs without torch if it can be exported; see ``neural.exported``.

    Raises:
        HriPredictError: it cannot be built; one line with the remedy.
    """
    what = f"predictor '{settings.name}'"
    if isinstance(settings, NeuralSettings):
        from hri_predict.predictors.neural.exported import NoCopyError, exported  # with numba

        with registry.building(what), contextlib.suppress(NoCopyError):
            return exported(settings)
    cls = registry.load("predictors", settings.name)
    with registry.building(what):
        predictor = cls(settings)
    try:
        refuse_unsound(predictor)
    except PredictorError as error:
        raise PredictorError(f"{what}: {error}") from error
    return predictor
