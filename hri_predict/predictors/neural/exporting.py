"""The process that exports a trained predictor: it needs torch, writes the copy, and exits."""

import json
import logging
import os
import sys

from hri_predict.base.errors import HriPredictError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.predictors.neural.engine import probes
from hri_predict.predictors.neural.exported import NOT_EXPORTED, Stored
from hri_predict.predictors.neural.predictor import NeuralPredictor


def main(text: str) -> int:
    """Write the copy to standard output; return 0, or ``NOT_EXPORTED`` without a copy.

    Args:
        text: the predictor's settings as JSON.
    """
    out = os.dup(1)
    os.dup2(2, 1)  # torch's exporter may print
    data = json.loads(text)
    notes = _Notes()
    logging.getLogger().addHandler(notes)
    try:
        model = registry.predictor_settings(data["name"])
        predictor = registry.load("predictors", data["name"])(validated(model, data, "predictor"))
    except HriPredictError as error:
        print(error, file=sys.stderr)
        return NOT_EXPORTED
    if not isinstance(predictor, NeuralPredictor) or not predictor.engine.model:
        return NOT_EXPORTED
    with os.fdopen(out, "wb") as file:
        file.write(_stored(predictor, notes.lines).packed())
    return 0


def _stored(predictor: NeuralPredictor, warnings: list[str]) -> Stored:
    network = predictor.network
    return Stored(
        model=predictor.engine.model,
        history_steps=predictor.history_steps,
        horizon_steps=predictor.horizon_steps,
        rest=network.rest.double().numpy(),
        probes=[(each.positions, each.observed, each.wanted) for each in probes(network)],
        warnings=warnings,
    )


class _Notes(logging.Handler):
    """Collects the predictor's own warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line."""
        if record.name == NeuralPredictor.__module__:
            self.lines.append(record.getMessage())
