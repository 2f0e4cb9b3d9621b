"""Learned scale: how wrong the forecast of each joint may be, from what is known when it is made.

A small network of two hidden layers, shared by all joints, gives a *scale* in metres for each
joint and step; the conformal factors of a calibration turn it into a radius (``radii``). What it
reads depends on the past and on the forecast alone, so radii stay valid for people and motion
that the network was not fitted on: J. Lei et al., "Distribution-Free Predictive Inference for
Regression", JASA 113 (2018) 1094, section 5.2 (locally weighted conformal inference). The network
is fitted to a quantile of the error's logarithm (``calibration.scale_fit``); here it only runs.

Its inputs do not change when the room is turned or moved, and name no body: lengths of bones do
not occur.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.arrays import Bools, Floats, Ints
from hri_predict.geometry import norm
from hri_predict.risk.zones.motion_class import trunk_joints
from hri_predict.skeleton import JOINTS, Skeleton

LEADS_S = (0.12, 0.4)
"""Ages of the forecasts whose errors the network reads. The first shows noise, the second how
predictable a person is."""
LEAD_TOLERANCE_S = (0.045, 0.07)
"""A forecast stands for one of ``LEADS_S`` if its age is so near: at 8 to 60 captures a second
there is one."""

BACK = (1, 3, 10)
"""Speeds are measured over so many steps."""
_BEFORE = 4  # the speed over the 3 steps before this tells the acceleration
KNOT_STEPS = (1, 2, 3, 5, 8, 11, 15, 20, 25, 30)
"""The network runs at these steps; between them the scale's logarithm is linear."""
LEAST_M, MOST_M = 0.01, 5.0
"""Bounds of the scale."""
BEYOND = 4.0
"""Inputs count as no farther than so many standard deviations from the fitted mean."""

KINDS = tuple(dict.fromkeys(n.removeprefix("l_").removeprefix("r_") for n in JOINTS))
_SPEED, _ERROR = 5.0, 20.0  # of 1 + so much x, the logarithm is read
_MOST_SPEED, _MOST_ERROR = 20.0, 2.0

NOW = (
    "speed_1", "speed_3", "speed_10", "to_trunk", "change", "path", "shake",
    "trunk", "fastest", "mean_speed", "seen",
    "error_short", "error_long", "no_short", "no_long",
    "body_short", "body_long", "residual", "no_residual",
)  # fmt: skip
"""Inputs that are the same for all steps."""
AHEAD = ("moved", "speed_ahead", "lead", "log_lead")
"""Inputs of each step."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evidence:
    """What is known of P people when a forecast is made. T steps back, H ahead, J joints.

    Attributes:
        history, observed: (P, T, J, 3) metres and (P, T, J); where T is short, speeds are measured
            over what there is.
        forecast: (P, H, J, 3) metres.
        error_m: (P, 2, J) errors of the forecasts made ``LEADS_S`` ago; NaN if unknown.
        residual_m: (P,) see ``motion_class``; NaN if unknown.
    """

    history: Floats
    observed: Bools
    forecast: Floats
    error_m: Floats
    residual_m: Floats


def inputs_now(evidence: Evidence, rate_hz: float, skeleton: Skeleton) -> Floats:
    """(P, J, ``NOW``) the inputs that all steps share."""
    history, seen = evidence.history, evidence.observed
    people, joints = history.shape[0], history.shape[2]
    velocity = {back: _velocity(history, seen, skip=0, back=back, rate_hz=rate_hz) for back in BACK}
    before = _velocity(history, seen, skip=_BEFORE - BACK[1], back=BACK[1], rate_hz=rate_hz)
    speed = {back: norm(v) for back, v in velocity.items()}
    in_trunk = trunk_joints(skeleton)
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


def inputs_ahead(evidence: Evidence, knots: Ints, rate_hz: float) -> Floats:
    """(P, K, J, ``AHEAD``) the inputs of the steps ``knots`` (K,), counted from 1."""
    last = evidence.history[:, -1:]
    seen = evidence.observed[:, -1:, :]
    at = evidence.forecast[:, knots - 1]
    first = knots == 1
    earlier = np.where(first[:, None, None], last, evidence.forecast[:, np.maximum(knots - 2, 0)])
    moved = np.where(seen, norm(at - last), 0.0)
    speed = np.where(seen | ~first[:, None], norm(at - earlier), 0.0) * rate_hz
    lead = (knots / rate_hz)[None, :, None] * np.ones(moved.shape)
    return np.stack([_log_speed(moved), _log_speed(speed), lead, np.log(lead)], axis=-1)


def _velocity(history: Floats, seen: Bools, *, skip: int, back: int, rate_hz: float) -> Floats:
    """(P, J, 3) over ``back`` steps that end ``skip`` before the newest; 0 where not observed."""
    end, start = history.shape[1] - 1 - skip, max(history.shape[1] - 1 - skip - back, 0)
    both = seen[:, end] & seen[:, start]
    moved = history[:, end] - history[:, start]
    return np.where(both[..., None], moved, 0.0) * (rate_hz / max(end - start, 1))


def _mean(error: Floats) -> Floats:
    known = ~np.isnan(error)
    total = np.where(known, np.minimum(error, _MOST_ERROR), 0.0).sum(-1)
    return np.where(known.any(-1), total / np.maximum(known.sum(-1), 1), np.nan)


def _known(values: Floats) -> tuple[Floats, Floats]:
    """The values with 0 where unknown, and 1 where they are unknown."""
    unknown = np.isnan(values)
    return np.where(unknown, 0.0, values), unknown.astype(np.float64)


def _log_speed(value: Floats) -> Floats:
    return np.log1p(_SPEED * np.minimum(value, _MOST_SPEED))


def _log_error(value: Floats) -> Floats:
    return np.log1p(_ERROR * np.minimum(value, _MOST_ERROR))


def kind_of(skeleton: Skeleton) -> Ints:
    """(J,) index into ``KINDS`` of each joint; -1 for others."""
    plain = [n.removeprefix("l_").removeprefix("r_") for n in skeleton.joints]
    return np.array([KINDS.index(n) if n in KINDS else -1 for n in plain], np.intp)


def knots_within(horizon_steps: int) -> Ints:
    """The knots of a horizon; its last step is one."""
    return np.array(sorted({*(k for k in KNOT_STEPS if k < horizon_steps), horizon_steps}))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScaleNetwork:
    """The fitted network. ``NOW`` + ``AHEAD`` + ``KINDS`` inputs, hidden layers of ReLU.

    Attributes:
        mean, deviation: of the inputs that are no kinds.
        layers: weights (inputs, outputs) and biases (outputs,), first to last; the last gives the
            natural logarithm of the scale in metres.
    """

    mean: Floats
    deviation: Floats
    layers: tuple[tuple[Floats, Floats], ...]

    def to_json(self) -> dict[str, Any]:
        """Lists of numbers."""
        return {
            "mean": _rounded(self.mean),
            "deviation": _rounded(self.deviation),
            "layers": [{"weights": _rounded(w), "biases": _rounded(b)} for w, b in self.layers],
        }

    @staticmethod
    def of_json(data: Mapping[str, Any]) -> "ScaleNetwork":
        """What ``to_json`` gave.

        Raises:
            ValueError: shapes or numbers do not fit.
        """
        try:
            mean, deviation = _array(data["mean"]), _array(data["deviation"])
            layers = tuple((_array(d["weights"]), _array(d["biases"])) for d in data["layers"])
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError("the scale is no network of numbers") from error
        plain, width = len(NOW) + len(AHEAD), len(NOW) + len(AHEAD) + len(KINDS)
        if mean.shape != (plain,) or deviation.shape != (plain,) or not (deviation > 0).all():
            raise ValueError("the scale's mean or deviation does not fit its inputs")
        for weights, biases in layers:
            if weights.ndim != 2 or weights.shape[0] != width or biases.shape != weights.shape[1:]:
                raise ValueError("a layer of the scale does not fit the one before it")
            width = weights.shape[1]
        if width != 1 or len(layers) < 2:
            raise ValueError("the scale's network must end in one number")
        return ScaleNetwork(mean=mean, deviation=deviation, layers=layers)


def _rounded(values: Floats) -> Any:
    return np.round(values, 5).tolist()


def _array(values: Any) -> Floats:
    found = np.array(values, dtype=np.float64)
    if not np.isfinite(found).all():
        raise ValueError("the scale's network holds a number that is not finite")
    return found


class LearnedScale:
    """The scale of forecasts of one predictor.

    Args:
        network: see ``ScaleNetwork``.
        skeleton: of the forecasts.
        rate_hz: steps per second.
        horizon_steps: H.
    """

    def __init__(
        self, network: ScaleNetwork, skeleton: Skeleton, rate_hz: float, horizon_steps: int
    ) -> None:
        self._skeleton, self._rate_hz = skeleton, rate_hz
        self._knots = knots_within(horizon_steps)
        steps = np.arange(1, horizon_steps + 1)
        self._above = np.minimum(self._knots.searchsorted(steps), len(self._knots) - 1)
        self._below = np.maximum(self._above - 1, 0)
        gap = np.maximum(self._knots[self._above] - self._knots[self._below], 1)
        self._part = ((steps - self._knots[self._below]) / gap)[:, None]
        self._mean, self._deviation = network.mean, network.deviation
        kinds, now = kind_of(skeleton), len(NOW)
        (weights, biases), *rest = network.layers
        self._now, self._ahead = weights[:now], weights[now : now + len(AHEAD)]
        of_kind = np.concatenate([weights[now + len(AHEAD) :], np.zeros((1, weights.shape[1]))])
        self._first = of_kind[kinds] + biases  # (J, hidden)
        self._rest = rest
        self._other: Bools = kinds < 0

    def __call__(self, evidence: Evidence) -> Floats:
        """(P, H, J) metres; never shrinks with the horizon; infinite for joints of no kind."""
        now = self._normal(inputs_now(evidence, self._rate_hz, self._skeleton), slice(0, len(NOW)))
        ahead = self._normal(
            inputs_ahead(evidence, self._knots, self._rate_hz), slice(len(NOW), None)
        )
        hidden = (now @ self._now + self._first)[:, None] + ahead @ self._ahead
        for weights, biases in self._rest:
            hidden = np.maximum(hidden, 0.0) @ weights + biases
        knots = np.maximum.accumulate(hidden[..., 0], axis=1)  # (P, K, J)
        lower = knots[:, self._below]
        log = lower + self._part * (knots[:, self._above] - lower)
        scale = np.exp(np.clip(log, np.log(LEAST_M), np.log(MOST_M)))
        return np.where(self._other | ~np.isfinite(scale), np.inf, scale)

    def _normal(self, values: Floats, own: slice) -> Floats:
        values = (values - self._mean[own]) / self._deviation[own]
        return np.minimum(np.maximum(values, -BEYOND), BEYOND)
