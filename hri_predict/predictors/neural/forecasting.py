"""From the room to a network and back, with any engine of the network.

Networks compute in single precision about the person's own origin, which is subtracted in double
precision, so a forecast is equally precise anywhere in the room.
"""

from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import PredictorError
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts.predictor import Forecast, checked
from hri_predict.predictors.neural.entering import enter, leave
from hri_predict.predictors.neural.windows import Entered, Histories, Singles, Tables

# The first calls of a network allocate and choose kernels. Then a different number of people costs
# nothing once; the most take their memory here, not in the loop.
_WARM_UP_PEOPLE = (1, 2, 16)


class Forecasting(ABC):
    """Base of predictors with a network; see ``contracts.predictor.Predictor``."""

    skeleton: Skeleton
    history_steps: int
    horizon_steps: int
    rate_hz: float
    _tables: Tables

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Predict with the network; see ``Predictor.predict``.

        Raises:
            PredictorError: the network's result has another shape.
        """
        if len(history) == 0:
            shape = (0, self.horizon_steps, len(self.skeleton.joints), 3)
            return Forecast(np.zeros(shape), None)
        histories = Histories(
            np.ascontiguousarray(history, dtype=np.float64),
            np.ascontiguousarray(observed, dtype=np.bool_),
        )
        entered = enter(histories, self._tables)
        _stand_at_carried(entered, histories, self._tables)
        ahead = self._ahead(entered)
        people, joints = len(history), len(self._tables.given)
        shape = (*ahead.shape[:1], *ahead.shape[2:])
        if shape not in ((people, joints, 3), (people, joints, 4)):
            raise PredictorError(  # the compiled loops below would read past its end
                f"the network gave shape {ahead.shape}, not ({people}, H, {joints}, 3 or 4)"
            )
        ahead = ahead[:, : self.horizon_steps]
        predicted = np.ascontiguousarray(ahead[..., :3])
        std = self._std(ahead[..., 3]) if ahead.shape[-1] == 4 else None
        return Forecast(leave(predicted, entered, histories, self._tables), std)

    def _std(self, log: Singles) -> Floats:
        """(P, H, K) m, of the logarithms (P, H, 28); not finite where a logarithm is not.

        A joint in the middle of two is at most as uncertain as the mean of both says.
        """
        with np.errstate(over="ignore"):  # ``checked`` refuses what is infinite
            std = np.exp(np.where(log > -np.inf, log, np.nan).astype(np.float64))
        result: Floats = std[:, :, self._tables.taken].mean(axis=3)
        return result

    @abstractmethod
    def _ahead(self, entered: Entered) -> Singles:
        """(P, at least ``horizon_steps``, 28, 3 or 4), as ``Network.forward`` gives it."""

    def _warm_up(self, method: str, path: Path) -> None:
        """Predict for one person, two and many, so that the first ticks are not late.

        Raises:
            PredictorError: a forecast is not finite.
        """
        for people in _WARM_UP_PEOPLE:
            shape = (people, self.history_steps, len(self.skeleton.joints))
            observed = np.ones(shape, dtype=bool)
            observed[:, 0] = False  # so that the filling runs, too
            try:
                checked(self.predict(np.zeros((*shape, 3)), observed), people, self)
            except PredictorError as error:
                raise PredictorError(
                    f"predictor {method}: weights {path}: {error}; train them again, or give "
                    f"another file"
                ) from error


def _stand_at_carried(entered: Entered, histories: Histories, tables: Tables) -> None:
    """Move the frames of people if all joints ever seen are ones that the network lacks.

    A tracker may deliver the waist or the top of the head alone. Without this, such a body in its
    rest pose would stand at the room's origin instead of at that joint.
    """
    bare = ~entered.observed.any(axis=(1, 2))
    if not bare.any():  # as in nearly every tick
        return
    rest = tables.rest[tables.taken].mean(axis=1)  # (K, 3), in a frame along the room's axes
    for person in np.flatnonzero(bare & histories.observed.any(axis=(1, 2))):
        seen = histories.observed[person]
        joints = np.flatnonzero(seen.any(axis=0))
        newest = len(seen) - 1 - seen[::-1, joints].argmax(axis=0)
        places = histories.positions[person, newest, joints]
        entered.frames[person, :3] = (places - rest[joints]).mean(axis=0)
