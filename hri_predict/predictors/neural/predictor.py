"""The node's side of every trained predictor: from the room to the network and back.

Each method's module derives its predictor from ``NeuralPredictor`` and names its network; nothing
else is needed. ``ExportedPredictor`` gives the same forecasts without torch.
"""

import logging
from pathlib import Path
from typing import ClassVar

import torch

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL, Skeleton
from hri_predict.predictors.masked import steps_to_cover
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.engine import engine_for
from hri_predict.predictors.neural.entering import tables
from hri_predict.predictors.neural.forecasting import Forecasting
from hri_predict.predictors.neural.network import BodyFrames, NetworkClass
from hri_predict.predictors.neural.settings import NeuralSettings, shipped_weights
from hri_predict.predictors.neural.weights import Header, LoadedWeights, load_weights, read_header
from hri_predict.predictors.neural.windows import Entered, Singles

log = logging.getLogger(__name__)

_STRETCH = 2  # times the trained horizon; beyond it a chained network drifts far


class NeuralPredictor(Forecasting):
    """Base of the trained predictors; see ``contracts.predictor.Predictor`` for the attributes.

    Works on ``CANONICAL``, as the node does, or on ``BODY``. The network does not predict three
    canonical joints: waist, neck and head_top. Each of them starts where it was last observed and
    moves by the mean displacement of the joints that it lies between (hips, shoulders) or on
    (head); its rotation about them is ignored. If it was never observed, it is placed where those
    joints are. The network guesses all other joints that were never observed from their neighbours.
    There is a standard deviation if the network states one; these three joints have the mean of
    those of the joints that they move with.

    Attributes:
        network: the network, in inference mode.
        engine: engine that computes it.
        card: description of the weights, from their file.
    """

    method: ClassVar[str]
    network_class: ClassVar[NetworkClass]
    settings_model: ClassVar[type[NeuralSettings]] = NeuralSettings

    def __init__(self, settings: NeuralSettings, skeleton: Skeleton = CANONICAL) -> None:
        """Load the weights and warm up the network.

        Sets torch's number of threads for the whole process.

        Raises:
            ConfigError: the weights do not exist, or their method, rate or skeleton differs.
            PredictorError: the weights are broken, or their forecast is not finite.
        """
        path = self._path(settings)
        header = read_header(path)
        self._check(header, settings, skeleton, path)
        wanted = steps_to_cover(settings.horizon_s, settings.rate_hz)
        loaded = self._load(path, header, settings, wanted)
        self.network = loaded.network
        self.card = loaded.card
        self.skeleton = skeleton
        self.rate_hz = settings.rate_hz
        self.history_steps = self.network.shape.history_steps
        self.horizon_steps = min(wanted, self.network.shape.horizon_steps)
        if self.horizon_steps < wanted:
            log.warning(
                "predictor %s: its weights reach %.3g s, not predictor.horizon_s %.3g s",
                self.method,
                self.horizon_steps / self.rate_hz,
                settings.horizon_s,
            )
        elif self.horizon_steps > _STRETCH * header.shape.horizon_steps:
            log.warning(
                "predictor %s: predictor.horizon_s %.3g s is far beyond the %.3g s that its "
                "weights were trained for; do not rely on forecasts beyond that",
                self.method,
                settings.horizon_s,
                header.shape.horizon_steps / self.rate_hz,
            )
        self._tables = tables(
            skeleton, self.network.rest.double().numpy(), self.network.nearest.numpy()
        )
        torch.set_num_threads(settings.threads)
        self.engine = engine_for(self.network, settings.engine, settings.threads)
        self._warm_up(self.method, path)

    def _ahead(self, entered: Entered) -> Singles:
        with torch.inference_mode():
            window = BodyFrames(
                torch.from_numpy(entered.window), torch.from_numpy(entered.observed)
            )
            ahead: Singles = self.engine.forward(window).contiguous().numpy()
        return ahead

    def _weights_method(self, settings: NeuralSettings) -> str:
        """Method of the weights it loads; their shipped file is the default."""
        return self.method

    def _path(self, settings: NeuralSettings) -> Path:
        if settings.weights is not None:
            return Path(settings.weights)
        method = self._weights_method(settings)
        path = shipped_weights(method)
        if not path.is_file():
            raise ConfigError(
                f"predictor {self.method}: no weights of '{method}' are shipped; train some and "
                f"name them with predictor.weights (evaluate: --weights FILE)"
            )
        return path

    def _load(
        self, path: Path, header: Header, settings: NeuralSettings, horizon_steps: int
    ) -> LoadedWeights:
        """Load a file's network, with ``horizon_steps`` if any horizon is possible."""
        any_horizon = self.network_class.any_horizon
        return load_weights(path, horizon_steps=horizon_steps if any_horizon else None)

    def _check(
        self, header: Header, settings: NeuralSettings, skeleton: Skeleton, path: Path
    ) -> None:
        wanted = self._weights_method(settings)
        if header.method not in (self.method, wanted):
            whose = "this predictor" if wanted == self.method else f"'{wanted}'"
            raise ConfigError(
                f"predictor {self.method}: weights {path} are for '{header.method}'; "
                f"give the file of {whose}"
            )
        if skeleton not in (BODY, CANONICAL):
            raise ConfigError(
                f"predictor {self.method}: works on skeleton '{BODY.name}' or '{CANONICAL.name}', "
                f"not on '{skeleton.name}'"
            )
        if header.shape.skeleton != BODY.name or header.shape.framed:
            raise ConfigError(
                f"predictor {self.method}: weights {path} are for skeleton "
                f"'{header.shape.skeleton}'{' in a frame of its own' * header.shape.framed}; "
                f"give weights for '{BODY.name}' in the room"
            )
        if header.shape.rate_hz != settings.rate_hz:
            raise ConfigError(
                f"predictor {self.method}: rate_hz is {settings.rate_hz:g}, but its weights {path} "
                f"are for {header.shape.rate_hz:g}; set predictor.rate_hz to that"
            )
