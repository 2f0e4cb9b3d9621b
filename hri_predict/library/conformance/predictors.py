"""Requirements of the contract on a predictor; see ``hri_predict.contracts.predictor``.

A predictor receives swaying bodies with bones of 25 cm, each at its own position. They do not
resemble people, because a predictor must not rely on a person's shape; ``hri-predict evaluate``
measures the quality of forecasts.
"""

import time
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import PredictorError
from hri_predict.base.settings import MAX_COORDINATE_M
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import (
    AnyPredictorClass,
    Forecast,
    Predictor,
    PredictorSettings,
    checked,
    refuse_unsound,
)
from hri_predict.library.conformance.checks import (
    Broken,
    CheckResult,
    demand,
    refuses_nonsense,
    run_checks,
)
from hri_predict.people.ring_buffer import RingBuffer

SAME_M = 1e-5  # of another batch size, as the contract has it
BONE_M = 0.25
SWAY_M = 0.1
TIMED_CALLS = 20
START_NS = 10_000_000_000


@dataclass(frozen=True)
class PredictorPart:
    """A predictor to check, its settings, and its input."""

    cls: AnyPredictorClass
    settings: PredictorSettings
    predictor: Predictor

    def people(self, count: int, seed: int = 0, seen: float = 1.0) -> tuple[Floats, Bools]:
        """Histories (P, T, J, 3), and (P, T, J) of which a share ``seen`` is observed."""
        rng = np.random.default_rng(seed)
        steps, joints = self.predictor.history_steps, len(self.predictor.skeleton.joints)
        body = _body(self.predictor.skeleton, rng)
        t = np.arange(steps)[:, np.newaxis, np.newaxis] / self.predictor.rate_hz
        phase = rng.uniform(0.0, 2 * np.pi, (count, 1, joints, 3))
        sway = SWAY_M * np.sin(2 * np.pi * 0.7 * t + phase)
        place = rng.uniform(-3.0, 3.0, (count, 1, 1, 3))
        return place + body + sway, rng.random((count, steps, joints)) < seen

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Return its forecast, with the right shape and finite values."""
        return checked(self.predictor.predict(history, observed), len(history), self.predictor)


def check_predictor(name: str, settings: PredictorSettings) -> list[CheckResult]:
    """Run all checks on the predictor registered as ``name``.

    Raises:
        HriPredictError: it cannot be made.
    """
    cls = registry.load("predictors", name)
    with registry.building(f"predictor '{name}'"):
        predictor = cls(settings)
    part = PredictorPart(cls, settings, predictor)
    try:
        refuse_unsound(predictor)
    except PredictorError:  # the second check says so; the others would be sized by it
        return run_checks(CHECKS[:2], part)
    return run_checks(CHECKS, part)


def refuses_settings_that_make_no_sense(part: PredictorPart) -> str:
    """Unknown keys and impossible rates are refused by a ``ConfigError`` of one line."""
    wrong = ({"rate_hz": 0}, {"rate_hz": "fast"}, {"horizon_s": -1.0}, {"horizon_s": float("nan")})
    data = part.settings.model_dump(exclude_unset=True)
    return refuses_nonsense(part.cls.settings_model, data, wrong)


def says_what_it_works_on(part: PredictorPart) -> str:
    """Skeleton, history, horizon and rate are attributes, and the rate is the configured one."""
    p = part.predictor
    try:
        refuse_unsound(p)
    except PredictorError as error:
        raise Broken(str(error)) from error
    demand(
        p.rate_hz == part.settings.rate_hz,
        f"rate_hz is {p.rate_hz:g}, configured are {part.settings.rate_hz:g}",
    )
    return (
        f"{len(p.skeleton.joints)} joints ({p.skeleton.name}), {p.history_steps} steps of history, "
        f"{p.horizon_steps} of horizon at {p.rate_hz:g} Hz"
    )


def gives_the_right_shapes(part: PredictorPart) -> str:
    """(P, H, J, 3) positions, and (P, H, J) deviations not below 0 or ``None``, for any P."""
    for count in (0, 1, 3):
        part.predict(*part.people(count))
    return "for 0, 1 and 3 people"


def gives_metres(part: PredictorPart) -> str:
    """Forecasts of people a few metres from the origin lie within the cell."""
    far = float(np.abs(part.predict(*part.people(3)).positions).max())
    demand(far <= MAX_COORDINATE_M, f"a joint is {far:.3g} m from the origin; which units?")
    return f"at most {far:.1f} m from the origin"


def is_finite_whatever_is_unobserved(part: PredictorPart) -> str:
    """Joints, steps, whole people that were not observed never make a forecast NaN or infinite."""
    rng = np.random.default_rng(1)
    for what in _UNOBSERVED:
        history, observed = part.people(3)
        _UNOBSERVED[what](observed, rng)
        try:
            part.predict(history, observed)
        except Exception as error:
            raise type(error)(f"with {what} unobserved: {error}") from error
    history, observed = part.people(2)
    part.predict(np.zeros_like(history), observed)
    return f"{', '.join(_UNOBSERVED)}; all joints in one point"


def ignores_what_is_not_observed(part: PredictorPart) -> str:
    """The history's value is ignored where ``observed`` is false."""
    history, observed = part.people(4, seen=0.5)
    elsewhere = np.where(observed[..., np.newaxis], history, 1e6)
    _demand_same(
        part.predict(history, observed),
        part.predict(elsewhere, observed),
        "values that were not observed change the forecast",
    )
    return "half of all values replaced by 1000 km: the same bytes"


def gives_the_same_bytes_again(part: PredictorPart) -> str:
    """The same batch gives the same bytes, regardless of predictions in between."""
    history, observed = part.people(4, seen=0.8)
    first = part.predict(history, observed)
    part.predict(*part.people(2, seed=7))
    again = part.predict(history, observed)
    _demand_same(first, again, "the same batch gives another forecast the second time")
    other = part.cls(part.settings).predict(history, observed)
    _demand_same(first, other, "made a second time, it gives another forecast")
    return "after another batch, and in a new object"


def does_not_depend_on_the_batch(part: PredictorPart) -> str:
    """A person's forecast is the same alone and among others, to 1e-5 m."""
    history, observed = part.people(5, seen=0.9)
    together = part.predict(history, observed).positions
    alone = [part.predict(history[i : i + 1], observed[i : i + 1]).positions for i in range(5)]
    apart_m = float(np.abs(np.concatenate(alone) - together).max())
    demand(apart_m <= SAME_M, f"alone and among five people {apart_m:.2g} m apart")
    return f"largest difference {apart_m:.2g} m"


def leaves_its_input_alone(part: PredictorPart) -> str:
    """History and mask are not changed; both may be read-only."""
    history, observed = part.people(3, seen=0.7)
    before = history.tobytes(), observed.tobytes()
    part.predict(history, observed)
    demand((history.tobytes(), observed.tobytes()) == before, "it changes its input")
    history.flags.writeable = observed.flags.writeable = False
    part.predict(history, observed)
    return "as it was; may be read-only"


def knows_nothing_of_the_future(part: PredictorPart) -> str:
    """A forecast depends on nothing captured after its window's end, nor interpolated across it.

    Captures lie between the model's steps, so that the window is resampled. Then the same number of
    captures follows in a different direction.
    """
    p = part.predictor
    joints, gap_ns = len(p.skeleton.joints), round(0.7e9 / p.rate_hz)
    count = 2 * p.history_steps + 2
    track = _body(p.skeleton, np.random.default_rng(2)) + np.linspace(0, 1, count)[:, None, None]
    seen = np.random.default_rng(3).random((count, joints)) < 0.8
    buffer = RingBuffer(joints=joints, capacity=2 * count, max_gap_ns=4 * gap_ns)
    for k in range(count):
        buffer.push(START_NS + k * gap_ns, track[k], seen[k], START_NS + k * gap_ns)
    end_ns = START_NS + (count - 1) * gap_ns
    before = _window(part, buffer, end_ns)
    for k in range(count, 2 * count):
        stamp_ns = START_NS + k * gap_ns
        buffer.push(stamp_ns, track[-1] + 0.05 * (k - count + 1), ~seen[k - count], stamp_ns)
    _demand_same(before, _window(part, buffer, end_ns), "captures after the window's end change it")
    history, observed = part.people(2)
    longer = np.concatenate([history, history + 5.0], axis=1)  # in memory, the future lies behind
    view = longer[:, : p.history_steps]
    _demand_same(part.predict(history, observed), part.predict(view, observed), "it reads ahead")
    return f"{count} captures after the window's end: the same bytes"


def predicts_in_time(part: PredictorPart) -> str:
    """Inference should take at most half a cycle; it is measured but not judged, because machines
    differ.
    """
    said = []
    for count in (1, 4):
        history, observed = part.people(count)
        taken = []
        for _ in range(TIMED_CALLS):
            began = time.perf_counter()
            part.predictor.predict(history, observed)
            taken.append(1e3 * (time.perf_counter() - began))
        p50, p99 = np.percentile(taken, [50, 99])
        said.append(f"{p50:.1f} / {p99:.1f} ms for {count}")
    return f"p50 / p99 {', '.join(said)}; half a cycle at 25 Hz is 20 ms; not judged"


CHECKS = (
    refuses_settings_that_make_no_sense,
    says_what_it_works_on,
    gives_the_right_shapes,
    gives_metres,
    is_finite_whatever_is_unobserved,
    ignores_what_is_not_observed,
    gives_the_same_bytes_again,
    does_not_depend_on_the_batch,
    leaves_its_input_alone,
    knows_nothing_of_the_future,
    predicts_in_time,
)


def _nothing(observed: Bools, rng: np.random.Generator) -> None:
    observed[:] = False


def _one_person(observed: Bools, rng: np.random.Generator) -> None:
    observed[0] = False


def _one_joint(observed: Bools, rng: np.random.Generator) -> None:
    observed[:, :, 0] = False


def _all_but_one_joint(observed: Bools, rng: np.random.Generator) -> None:
    observed[:, :, 1:] = False


def _all_but_the_oldest_step(observed: Bools, rng: np.random.Generator) -> None:
    observed[:, 1:] = False


def _the_newest_step(observed: Bools, rng: np.random.Generator) -> None:
    observed[:, -1] = False


def _half_at_random(observed: Bools, rng: np.random.Generator) -> None:
    observed &= rng.random(observed.shape) < 0.5


_UNOBSERVED = {
    "everything": _nothing,
    "one person": _one_person,
    "one joint": _one_joint,
    "all but one joint": _all_but_one_joint,
    "all but the oldest step": _all_but_the_oldest_step,
    "the newest step": _the_newest_step,
    "half at random": _half_at_random,
}


def _body(skeleton: Skeleton, rng: np.random.Generator) -> Floats:
    """Return a body (J, 3) with this tree: bones of equal length, each in its own direction."""
    bones = rng.normal(size=(len(skeleton.joints), 3))
    bones *= BONE_M / np.linalg.norm(bones, axis=1, keepdims=True)
    body: Floats = np.zeros_like(bones)
    placed = {-1}
    while len(placed) <= len(skeleton.joints):  # parents first, in whatever order they are listed
        for joint, parent in enumerate(skeleton.parents):
            if parent in placed and joint not in placed:
                body[joint] = (body[parent] if parent >= 0 else 0.0) + bones[joint]
                placed.add(joint)
    return body


def _window(part: PredictorPart, buffer: RingBuffer, end_ns: int) -> Forecast:
    window = buffer.window(end_ns, part.predictor.history_steps, part.predictor.rate_hz)
    return part.predict(window.positions[np.newaxis], window.observed[np.newaxis])


def _demand_same(first: Forecast, second: Forecast, otherwise: str) -> None:
    same = first.positions.tobytes() == second.positions.tobytes()
    if first.std is None or second.std is None:
        same = same and first.std is second.std
    else:
        same = same and first.std.tobytes() == second.std.tobytes()
    demand(same, otherwise)
