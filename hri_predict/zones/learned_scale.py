"""Learned scale: expected error of the forecast of each joint, from data known when it is made.

A small network of two hidden layers, shared by all joints, gives a *scale* in metres for each joint
and step; the conformal factors of a calibration turn it into a radius (``radii``). Its inputs
depend only on the past and on the forecast, so radii stay valid for people and motion outside the
network's training data: J. Lei et al., "Distribution-Free Predictive Inference for Regression",
JASA 113 (2018) 1094, section 5.2 (locally weighted conformal inference). The network is fitted to a
quantile of the error's logarithm (``lab.calibration.scale_fit``); this module only evaluates it, in
single precision: with the shipped networks the scale differs from double precision by less than a
millionth of itself.

Its inputs are invariant to rotation and translation of the room, and do not identify a body: bone
lengths are not used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints, Singles, plain_flags
from hri_predict.base.geometry import norm
from hri_predict.base.machine.compiled import kernel, plain
from hri_predict.base.skeleton import JOINTS, Skeleton
from hri_predict.zones.loops.scale import (
    BACK,
    BEFORE,
    BEYOND,
    ERROR,
    LEAST_M,
    MOST_ERROR,
    MOST_M,
    MOST_SPEED,
    SPEED,
    EvidenceArrays,
    Tables,
    scale_by_loops,
)
from hri_predict.zones.motion_class import trunk_joints

__all__ = ["BEYOND", "LEAST_M", "MOST_M", "Evidence", "LearnedScale", "ScaleNetwork"]

LEADS_S = (0.12, 0.4)
"""Ages of the past forecasts whose errors are inputs: the first error shows noise, the second how
predictable a person is."""
LEAD_TOLERANCE_S = (0.045, 0.07)
"""Maximum difference between a forecast's age and its entry of ``LEADS_S``: at 8 to 60 captures per
second, a forecast is always found.
"""

KNOT_STEPS = (1, 2, 3, 5, 8, 11, 15, 20, 25, 30)
"""Steps at which the network is evaluated; the scale's logarithm is linear between them."""

MOST_NUMBER = 10.0
"""Maximum magnitude of a number of the network; fitted ones are below 2. A damaged one may make
every zone small, and large ones that cancel need more than single precision."""

KINDS = tuple(dict.fromkeys(n.removeprefix("l_").removeprefix("r_") for n in JOINTS))

NOW = (
    "speed_1", "speed_3", "speed_10", "to_trunk", "change", "path", "shake",
    "trunk", "fastest", "mean_speed", "seen",
    "error_short", "error_long", "no_short", "no_long",
    "body_short", "body_long", "residual", "no_residual",
)  # fmt: skip
"""Inputs that are the same for all steps."""
AHEAD = ("moved", "speed_ahead", "lead", "log_lead", "spread")
"""Inputs of each step. The spread is the standard deviation that a forecast states, such as how far
the members of ``average`` differ; 0 without one, which only a network that ignores it may see."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evidence:
    """Data on P people when a forecast is made. T steps back, H steps ahead, J joints.

    Attributes:
        history, observed: (P, T, J, 3) metres and (P, T, J); if T is short, speeds are measured
            over the available steps.
        forecast: (P, H, J, 3) metres.
        error_m: (P, 2, J) errors of the forecasts made ``LEADS_S`` ago; NaN if unknown.
        residual_m: (P,) residual, see ``motion_class``; NaN if unknown.
        measured: (P, T, J) where the history was measured; ``None``: where it was observed.
        std: (P, H, J) metres, standard deviation that the forecast states; ``None``: none.
    """

    history: Floats
    observed: Bools
    forecast: Floats
    error_m: Floats
    residual_m: Floats
    measured: Bools | None = None
    std: Floats | None = None


def inputs_now(evidence: Evidence, rate_hz: float, skeleton: Skeleton) -> Floats:
    """Return (P, J, ``NOW``) the inputs that all steps share."""
    return _inputs_now(evidence, rate_hz, trunk_joints(skeleton))


def _inputs_now(
    evidence: Evidence | EvidenceArrays, rate_hz: float, in_trunk: Sequence[int] | Ints
) -> Floats:
    history, seen = evidence.history, evidence.observed
    people, joints = history.shape[0], history.shape[2]
    velocity = {back: _velocity(history, seen, skip=0, back=back, rate_hz=rate_hz) for back in BACK}
    before = _velocity(history, seen, skip=BEFORE - BACK[1], back=BACK[1], rate_hz=rate_hz)
    speed = {back: norm(v) for back, v in velocity.items()}
    steps_back = min(BACK[-1], history.shape[1] - 1)
    start = max(history.shape[1] - 1 - BACK[1], 0)
    measured = seen[:, -1, in_trunk] & seen[:, start, in_trunk]
    count = np.maximum(measured.sum(1), 1)[:, None, None]  # others have the velocity 0
    trunk = velocity[BACK[1]][:, in_trunk].sum(1, keepdims=True) / count
    recent, newest = seen[:, -steps_back - 1 :], history[:, -steps_back - 1 :]
    steps = recent[:, 1:] & recent[:, :-1]
    moves = np.where(steps[..., None], np.diff(newest, axis=1), 0.0)
    path = norm(moves).sum(1) * rate_hz / np.maximum(steps.sum(1), 1)
    everybody = np.ones((people, joints))
    error, lacks = _known(evidence.error_m)
    body, _ = _known(_mean(evidence.error_m))
    residual, no_residual = _known(evidence.residual_m)
    columns = [
        *(_log_speed(speed[back]) for back in BACK),
        _log_speed(norm(velocity[BACK[1]] - trunk)),
        _log_speed(8.0 * norm(velocity[BACK[1]] - before)),
        _log_speed(path),
        _log_speed(np.maximum(path - speed[BACK[-1]], 0.0)),
        _log_speed(norm(trunk)) * everybody,
        _log_speed(speed[BACK[1]].max(1, keepdims=True)) * everybody,
        _log_speed(speed[BACK[1]].mean(1, keepdims=True)) * everybody,
        recent.mean(1),
        *(_log_error(error[:, i]) for i in range(2)),
        *(lacks[:, i] for i in range(2)),
        *(_log_error(body[:, i, None]) * everybody for i in range(2)),
        _log_error(residual)[:, None] * everybody,
        no_residual[:, None] * everybody,
    ]
    return np.stack(columns, axis=-1)


def inputs_ahead(evidence: Evidence | EvidenceArrays, knots: Ints, rate_hz: float) -> Floats:
    """Return (P, K, J, ``AHEAD``) the inputs for the steps ``knots`` (K,), counted from 1."""
    last = evidence.history[:, -1:]
    seen = evidence.observed[:, -1:, :]
    at = evidence.forecast[:, knots - 1]
    first = knots == 1
    earlier = np.where(first[:, None, None], last, evidence.forecast[:, np.maximum(knots - 2, 0)])
    moved = np.where(seen, norm(at - last), 0.0)
    speed = np.where(seen | ~first[:, None], norm(at - earlier), 0.0) * rate_hz
    lead = (knots / rate_hz)[None, :, None] * np.ones(moved.shape)
    std = evidence.std
    spread = np.zeros(moved.shape) if std is None or not std.size else std[:, knots - 1]
    columns = [_log_speed(moved), _log_speed(speed), lead, np.log(lead), _log_error(spread)]
    return np.stack(columns, axis=-1)


def _velocity(history: Floats, seen: Bools, *, skip: int, back: int, rate_hz: float) -> Floats:
    """Return (P, J, 3) m/s over ``back`` steps, ending ``skip`` before the newest; 0 if unseen."""
    end, start = history.shape[1] - 1 - skip, max(history.shape[1] - 1 - skip - back, 0)
    both = seen[:, end] & seen[:, start]
    moved = history[:, end] - history[:, start]
    return np.where(both[..., None], moved, 0.0) * (rate_hz / max(end - start, 1))


def _mean(error: Floats) -> Floats:
    known = ~np.isnan(error)
    total = np.where(known, np.minimum(error, MOST_ERROR), 0.0).sum(-1)
    return np.where(known.any(-1), total / np.maximum(known.sum(-1), 1), np.nan)


def _known(values: Floats) -> tuple[Floats, Floats]:
    """Return the values, with 0 where unknown, and flags that are 1 where they are unknown."""
    unknown = np.isnan(values)
    return np.where(unknown, 0.0, values), unknown.astype(np.float64)


def _log_speed(value: Floats) -> Floats:
    return np.log1p(SPEED * np.minimum(value, MOST_SPEED))


def _log_error(value: Floats) -> Floats:
    return np.log1p(ERROR * np.minimum(value, MOST_ERROR))


def kind_of(skeleton: Skeleton) -> Ints:
    """Return (J,) index into ``KINDS`` of each joint; -1 for other joints."""
    plain = [n.removeprefix("l_").removeprefix("r_") for n in skeleton.joints]
    return np.array([KINDS.index(n) if n in KINDS else -1 for n in plain], np.intp)


def knots_within(horizon_steps: int) -> Ints:
    """Return the knots of a horizon; its last step is always a knot."""
    return np.array(sorted({*(k for k in KNOT_STEPS if k < horizon_steps), horizon_steps}))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScaleNetwork:
    """The fitted network. ``NOW`` + ``AHEAD`` + ``KINDS`` inputs, hidden layers of ReLU.

    Attributes:
        mean, deviation: mean and standard deviation of all inputs except kinds.
        layers: weights (inputs, outputs) and biases (outputs,), first to last; the last gives the
            natural logarithm of the scale in metres.
    """

    mean: Floats
    deviation: Floats
    layers: tuple[tuple[Floats, Floats], ...]

    def to_json(self) -> dict[str, Any]:
        """Return lists of numbers."""
        return {
            "mean": _rounded(self.mean),
            "deviation": _rounded(self.deviation),
            "layers": [{"weights": _rounded(w), "biases": _rounded(b)} for w, b in self.layers],
        }

    @staticmethod
    def of_json(data: Mapping[str, Any]) -> "ScaleNetwork":
        """Invert ``to_json``.

        Raises:
            ValueError: a shape or number is invalid.
        """
        try:
            mean, deviation = _array(data["mean"]), _array(data["deviation"])
            layers = tuple((_array(d["weights"]), _array(d["biases"])) for d in data["layers"])
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError("the scale is not a valid network") from error
        plain, width = len(NOW) + len(AHEAD), len(NOW) + len(AHEAD) + len(KINDS)
        if mean.shape == (plain - 1,) == deviation.shape and _inputs_of(layers) == width - 1:
            mean, deviation, layers = _without_spread(mean, deviation, layers)
        if mean.shape != (plain,) or deviation.shape != (plain,) or not (deviation > 1e-4).all():
            raise ValueError("the scale's mean or deviation does not fit its inputs")
        for weights, biases in layers:
            if weights.ndim != 2 or weights.shape[0] != width or biases.shape != weights.shape[1:]:
                raise ValueError("a layer of the scale does not fit the one before it")
            width = weights.shape[1]
        if width != 1 or len(layers) < 2:
            raise ValueError("the scale's network must have one output")
        return ScaleNetwork(mean=mean, deviation=deviation, layers=layers)


_Layers = tuple[tuple[Floats, Floats], ...]


def _inputs_of(layers: _Layers) -> int | None:
    return layers[0][0].shape[0] if layers and layers[0][0].ndim == 2 else None


def _without_spread(
    mean: Floats, deviation: Floats, layers: _Layers
) -> tuple[Floats, Floats, _Layers]:
    """Insert a spread without influence: calibrations of 0.2 do not have this input."""
    (weights, biases), *rest = layers
    weights = np.insert(weights, len(mean), 0.0, axis=0)
    return np.append(mean, 0.0), np.append(deviation, 1.0), ((weights, biases), *rest)


def _rounded(values: Floats) -> Any:
    return np.round(values, 5).tolist()


def _array(values: Any) -> Floats:
    found = np.array(values, dtype=np.float64)
    if not (np.abs(found) <= MOST_NUMBER).all():
        raise ValueError(f"the scale's network holds a number beyond {MOST_NUMBER:g}, or none")
    return found


_NO_STD = np.zeros((0, 0, 0))


class LearnedScale:
    """The scale for forecasts of one predictor.

    Args:
        network: see ``ScaleNetwork``.
        skeleton: skeleton of the forecasts.
        rate_hz: steps per second.
        horizon_steps: H.
    """

    def __init__(
        self, network: ScaleNetwork, skeleton: Skeleton, rate_hz: float, horizon_steps: int
    ) -> None:
        knots, steps = knots_within(horizon_steps), np.arange(1, horizon_steps + 1)
        above = np.minimum(knots.searchsorted(steps), len(knots) - 1)
        below = np.maximum(above - 1, 0)
        kinds, now = kind_of(skeleton), len(NOW)
        (weights, biases), *rest = network.layers
        self._reads_spread = bool(weights[now + AHEAD.index("spread")].any())
        of_kind = np.concatenate([weights[now + len(AHEAD) :], np.zeros((1, weights.shape[1]))])
        self._tables = Tables(
            rate_hz=float(rate_hz),
            trunk=trunk_joints(skeleton),
            knots=knots,
            below=below,
            above=above,
            part=(steps - knots[below]) / np.maximum(knots[above] - knots[below], 1),
            mean=network.mean,
            deviation=network.deviation,
            now=_single(weights[:now]),
            ahead=_single(weights[now : now + len(AHEAD)]),
            first=_single(of_kind[kinds] + biases),
            rest=tuple((_single(w), _single(b)) for w, b in rest),
            other=kinds < 0,
        )

    def __call__(self, evidence: Evidence) -> Floats:
        """Return (P, H, J) metres; never shrinks with the horizon; infinite without a kind.

        Also infinite where a network that reads the spread is given none: 0 would mean that a
        forecast is certain.

        Raises:
            ValueError: ``std`` is not of the forecast's shape.
        """
        if evidence.std is not None and evidence.std.shape != evidence.forecast.shape[:3]:
            raise ValueError(f"std has the shape {evidence.std.shape}, not that of the forecast")
        if evidence.std is None and self._reads_spread:
            return np.full(evidence.forecast.shape[:3], np.inf)
        seen = EvidenceArrays(
            history=plain(evidence.history),
            observed=plain_flags(evidence.observed),
            forecast=plain(evidence.forecast),
            error_m=plain(evidence.error_m),
            residual_m=plain(evidence.residual_m),
            std=_NO_STD if evidence.std is None else plain(evidence.std),
        )
        return _scale(seen, self._tables)


def _scale_by_arrays(seen: EvidenceArrays, tables: Tables) -> Floats:
    count = len(NOW)
    now = _normal(_inputs_now(seen, tables.rate_hz, tables.trunk), tables, slice(0, count))
    ahead = _normal(inputs_ahead(seen, tables.knots, tables.rate_hz), tables, slice(count, None))
    hidden = (now @ tables.now + tables.first)[:, None] + ahead @ tables.ahead
    for weights, biases in tables.rest:
        hidden = np.maximum(hidden, np.float32(0.0)) @ weights + biases
    knots = np.maximum.accumulate(hidden[..., 0].astype(np.float64), axis=1)  # (P, K, J)
    lower = knots[:, tables.below]
    log = lower + tables.part[:, None] * (knots[:, tables.above] - lower)
    scale = np.exp(np.clip(log, np.log(LEAST_M), np.log(MOST_M)))
    return np.where(tables.other | ~np.isfinite(scale), np.inf, scale)


def _normal(values: Floats, tables: Tables, own: slice) -> Singles:
    values = (values - tables.mean[own]) / tables.deviation[own]
    return _single(np.minimum(np.maximum(values, -BEYOND), BEYOND))


def _single(values: Floats) -> Singles:
    """Return the numbers in single precision, contiguous, as compiled loops need them."""
    return np.array(values, np.float32, order="C")


_scale = kernel(scale_by_loops, _scale_by_arrays)
