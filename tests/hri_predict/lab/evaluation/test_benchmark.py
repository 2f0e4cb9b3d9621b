"""The papers' judgement: no future reaches a forecaster; networks see their own units."""

import numpy as np
import pytest
import torch

from hri_predict.base.errors import ConfigError, PredictorError, RecordingError
from hri_predict.base.skeleton import make_skeleton
from hri_predict.contracts import registry
from hri_predict.lab.evaluation.benchmark import (
    ActionTests,
    Protocol,
    average_of,
    constant_velocity,
    judge,
    mean_over,
    network_forecaster,
    open_tests,
    score,
    zero_velocity,
)
from hri_predict.lab.evaluation.benchmark_report import tables
from hri_predict.lab.evaluation.benchmark_result import BenchmarkResult
from hri_predict.lab.evaluation.benchmarks import Cmu
from hri_predict.predictors.neural.cmu_skeleton import CMU25, CMU38
from hri_predict.predictors.neural.network import Network, Shape, last_pose
from tests.shared import DATA, needs_data

FRAMES = 200  # of the made recordings; every second is used


class Mean(Network):
    """Everything goes to the mean of the window: depends on all that it is shown."""

    def forward(self, window):
        self.window = window
        mean = window.positions.mean(1, keepdim=True)
        return mean.expand(-1, self.shape.horizon_steps, -1, -1)


class Forward(Network):
    """Everything moves forward by 0.1 m a frame, with a deviation of 50 mm."""

    def forward(self, window):
        ahead = torch.arange(1.0, self.shape.horizon_steps + 1)
        moved = torch.zeros(self.shape.horizon_steps, 1, 3)
        moved[:, 0, 0] = 0.1 * ahead
        return torch.nn.functional.pad(last_pose(window) + moved, (0, 1), value=-3.0)


def pack(folder, expmap):
    (folder / "test").mkdir(parents=True)
    np.savez(folder / "test" / "walking_1.npz", expmap=expmap.astype(np.float32))
    return folder


def test_an_average_is_the_mean_of_its_members_forecasts(rng):
    history = rng.normal(size=(4, 10, 38, 3))
    members = zero_velocity(25), constant_velocity(25)
    standing, moving = (member(history) for member in members)
    np.testing.assert_array_equal(average_of(members)(history), (standing + moving) / 2)


@pytest.fixture
def expmap(rng):
    return rng.normal(size=(FRAMES, 117))


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.mark.parametrize(
    ("windows", "n_out", "error"),
    [("all", 25, "mpjpe"), ("all", 10, "mpjpe"), ("8-seeds", 25, "mpjpe"), ("all", 25, "euler")],
)
def test_no_forecast_depends_on_frames_after_its_window(
    tmp_path, rng, expmap, windows, n_out, error
):
    """Perturb the recording after one window's end: all windows up to it forecast the same."""
    protocol = Protocol("cmu", windows, n_out, error)
    shape = Shape(
        skeleton=protocol.skeleton,
        history_steps=protocol.n_in,
        horizon_steps=25,
        rate_hz=25.0,
        framed=True,
    )
    forecasters = [zero_velocity(n_out), network_forecaster(protocol, Mean(shape), "mean")]
    if error == "mpjpe":
        forecasters.append(constant_velocity(n_out))
    (before,) = open_tests(protocol, pack(tmp_path / "a", expmap))
    starts = {
        "all": np.arange(len(before.history)),
        "8-seeds": np.random.RandomState(1234567890).randint(0, FRAMES // 2 - 75, 8) + 40,
    }[windows]
    end = int(np.sort(starts)[len(starts) // 2]) + protocol.n_in  # of some window, exclusive
    changed = expmap.copy()
    changed[2 * (end - 1) + 1 :] = rng.normal(size=(FRAMES - 2 * end + 1, 117))
    (after,) = open_tests(protocol, pack(tmp_path / "b", changed))
    earlier = starts + protocol.n_in <= end
    assert earlier.any()
    assert not earlier.all()
    for forecaster in forecasters:
        same = (forecaster(before.history) == forecaster(after.history)).all((1, 2, 3))
        assert same[earlier].all()
        assert not same[~earlier].any()
    last = starts + protocol.n_in == end
    assert (before.future != after.future).any((2, 3))[last].all()


def test_windows_of_another_length_end_with_the_same_frames(tmp_path, expmap):
    root = pack(tmp_path, expmap)
    (ten,) = open_tests(Protocol("cmu", "8-seeds", 25), root)
    (more,) = open_tests(Protocol("cmu", "8-seeds", 25, observed_frames=25), root)
    assert more.history.shape[1] == 25
    assert (more.history[:, -10:] == ten.history).all()
    assert (more.future == ten.future).all()


def test_a_forecaster_is_given_a_copy_without_the_future():
    given = []
    tests = ActionTests("walking", np.ones((2, 10, 25, 3)), np.ones((2, 25, 25, 3)))

    def spoils(history):
        given.append(history.shape)
        history[:] = np.nan
        return np.zeros((2, 25, 25, 3))

    made = score(Protocol("cmu", "all", 25), spoils, tests)
    assert given == [(2, 10, 25, 3)]
    assert np.isfinite(tests.history).all()
    assert made.joints == pytest.approx(np.full((25, 25), np.sqrt(3)))
    assert made.errors == pytest.approx(np.full(25, np.sqrt(3) * 32 / 38))


def test_networks_work_in_metres_with_x_forward():
    protocol = Protocol("cmu", "all", 10)
    network = Forward(
        Shape(skeleton=CMU25, history_steps=10, horizon_steps=25, rate_hz=25.0, framed=True)
    )
    history = np.random.default_rng(0).normal(scale=500.0, size=(3, 10, 25, 3))
    predicted = network_forecaster(protocol, network, "x")(history)
    assert predicted.shape == (3, 10, 25, 3)  # of a network of 25 frames
    moved = predicted - history[:, -1:]
    for frame in (0, 9):  # z is forward in the benchmark
        expected = np.broadcast_to([0.0, 0.0, 100.0 * (frame + 1)], (3, 25, 3))
        np.testing.assert_allclose(moved[:, frame], expected, atol=0.01)


def test_a_longer_history_is_unobserved_where_the_window_has_none():
    network = Mean(
        Shape(skeleton=CMU25, history_steps=25, horizon_steps=25, rate_hz=25.0, framed=True)
    )
    history = np.random.default_rng(0).normal(size=(2, 10, 25, 3))
    network_forecaster(Protocol("cmu", "all", 25), network, "x")(history)
    assert not network.window.observed[:, :15].any()
    assert network.window.observed[:, 15:].all()
    short = Mean(
        Shape(skeleton=CMU25, history_steps=4, horizon_steps=25, rate_hz=25.0, framed=True)
    )
    network_forecaster(Protocol("cmu", "all", 25), short, "x")(history)
    newest = history[:, -4:][..., [2, 0, 1]] / 1000
    np.testing.assert_allclose(short.window.positions.numpy(), newest, atol=1e-6)


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        (
            Shape(skeleton=CMU25, history_steps=10, horizon_steps=10, rate_hz=25.0, framed=True),
            "fewer than --n-out 25",
        ),
        (
            Shape(skeleton=CMU25, history_steps=10, horizon_steps=25, rate_hz=25.0),
            "in its own frame",
        ),
        (
            Shape(skeleton=CMU38, history_steps=50, horizon_steps=25, rate_hz=25.0, framed=True),
            "needs cmu25",
        ),
        (
            Shape(
                skeleton=make_skeleton("s", ["a"], [-1]),
                history_steps=10,
                horizon_steps=25,
                rate_hz=25.0,
                framed=True,
            ),
            "needs cmu25",
        ),
    ],
)
def test_networks_that_cannot_be_judged_are_refused(shape, told):
    with pytest.raises(PredictorError, match=told):
        network_forecaster(Protocol("cmu", "all", 25), Mean(shape), "--predictor x")


def test_a_package_brings_a_benchmark_with_printed_numbers(tmp_path, expmap, monkeypatch):
    class Own(Cmu):
        title, mean_over, published = "Own", ("walking",), tmp_path / "printed.yaml"

    entry = "{method: M, paper: P, table: T, windows: all, n_out: 25, error: mpjpe, "
    entry += "columns: [1], errors: {walking: [7.5]}}"
    Own.published.write_text(f"[{entry}]", encoding="utf-8")
    monkeypatch.setattr(registry, "names", lambda kind: ["own"])
    monkeypatch.setattr(registry, "load", lambda kind, name: Own())
    protocol = Protocol("own", "all", 25)
    scores = judge(protocol, pack(tmp_path / "pack", expmap), {"zero": zero_velocity(25)})
    assert mean_over(protocol, scores["zero"]) == pytest.approx(scores["zero"]["walking"].errors)
    found = BenchmarkResult(protocol, scores, ("zero",), {})
    assert tables(found)[0].rows[1][:2] == ("M, printed", "7.50")
    with pytest.raises(ConfigError, match=r"unknown benchmark 'owl'.*cmu, human36m, own"):
        Protocol("owl", "all", 25)


class Broken(Cmu):
    """A package's benchmark with one fault."""

    def __init__(self, **faults):
        for name, value in faults.items():
            setattr(self, name, value)


def fail(*_):
    raise KeyError("walking")


TAKE = ("walking", "w.npz", [np.ones((99, 25, 3))])
BAD_TAKE = ("walking", "w.npz", [np.full((99, 25, 3), np.inf)])


@pytest.mark.parametrize(
    ("faults", "told"),
    [
        ({"skeletons": {"mpjpe": ("hip", "knee")}}, "TypeError: skeletons has a tuple"),
        ({"windows": None}, "TypeError: 'NoneType'"),
        ({"takes": fail}, "KeyError: 'walking'"),
        ({"takes": lambda *_: 7}, "TypeError: 'int' object is not iterable"),
        ({"takes": lambda *_: [("walking", "here")]}, "ValueError: not enough values"),
        ({"takes": lambda *_: [("walking", "w.npz", [np.ones((99, 3, 3))])]}, r"w.npz: .*99, 3, 3"),
        ({"starts": fail}, "KeyError"),
        ({"starts": lambda *_: [np.array([1_000_000])]}, "outside a take of"),
        ({"errors": lambda p, t: np.ones(3)}, r"errors have shape \(3,\)"),
        ({"windows": "all"}, "TypeError: 'all' is a text, not a list"),
        ({"takes": lambda *_: [None]}, "TypeError: cannot unpack"),
        ({"takes": lambda *_: []}, "takes gives no action for"),
        ({"takes": lambda *_: [("walking", "w.npz", [])]}, "w.npz: .*no recording of it"),
        ({"takes": lambda *_: [TAKE, TAKE]}, "w.npz: gives action walking twice"),
        ({"takes": lambda *_: [BAD_TAKE]}, "w.npz: has values that are not finite"),
        ({"starts": lambda *_: [np.array([0.5])]}, r"starts are float64 of shape \(1,\)"),
        ({"starts": lambda *_: [np.array([[0, 1]])]}, r"starts are int64 of shape \(1, 2\)"),
        ({"starts": lambda *_: [3]}, r"starts are int64 of shape \(\)"),
        ({"errors": lambda p, t: np.full(p.shape[:3], np.nan)}, "errors .*not finite"),
        ({"errors": lambda p, t: np.ones((*p.shape[:2], 0))}, "errors have no joint"),
    ],
)
def test_a_packages_broken_benchmark_is_one_line(tmp_path, expmap, monkeypatch, faults, told):
    monkeypatch.setattr(registry, "names", lambda kind: ["own"])
    monkeypatch.setattr(registry, "load", lambda kind, name: Broken(**faults))
    with pytest.raises(ConfigError, match=f"benchmark 'own': .*{told}.*; fix the package"):
        judge(Protocol("own", "all", 25), pack(tmp_path, expmap), {"zero": zero_velocity(25)})


def test_what_is_no_benchmark_is_one_line(monkeypatch):
    monkeypatch.setattr(registry, "names", lambda kind: ["own"])
    monkeypatch.setattr(registry, "load", lambda kind, name: 7)
    with pytest.raises(ConfigError, match="benchmark 'own': AttributeError: 'int' object has no"):
        Protocol("own", "all", 25)


def test_human36m_refuses_a_network_of_other_joints():
    network = Mean(
        Shape(skeleton=CMU25, history_steps=10, horizon_steps=25, rate_hz=25.0, framed=True)
    )
    with pytest.raises(PredictorError, match="needs human22 in its own frame"):
        network_forecaster(Protocol("human36m", "all", 25), network, "--predictor x")


def test_forecasts_that_are_not_finite_are_refused():
    tests = ActionTests("walking", np.ones((1, 10, 25, 3)), np.ones((1, 25, 25, 3)))
    with pytest.raises(PredictorError, match="not finite"):
        score(Protocol("cmu", "all", 25), lambda _: np.full((1, 25, 25, 3), np.nan), tests)


def test_a_forecast_that_is_not_finite_names_its_predictor(tmp_path, expmap):
    nan = {"lost": lambda h: np.full((len(h), 25, 25, 3), np.nan)}
    with pytest.raises(PredictorError, match=r"predictor lost: forecast of walking"):
        judge(Protocol("cmu", "all", 25), pack(tmp_path, expmap), nan)


@pytest.mark.parametrize("windows", ["all", "8-seeds"])
def test_a_recording_that_is_too_short_is_named(tmp_path, expmap, windows):
    root = pack(tmp_path, expmap[:60])
    with pytest.raises(RecordingError, match=r"recording .*walking_1\.npz: .*30 frames"):
        list(open_tests(Protocol("cmu", windows, 25), root))


def test_the_mean_needs_all_five_actions(tmp_path, expmap):
    protocol = Protocol("cmu", "all", 25)
    scores = judge(protocol, pack(tmp_path, expmap), {"zero": zero_velocity(25)})
    assert list(scores["zero"]) == ["walking"]
    assert np.isnan(mean_over(protocol, scores["zero"])).all()


@needs_data
def test_euler_error_of_zero_velocity_is_the_printed_one():
    protocol = Protocol("cmu", "80-seeds", 25, "euler")
    assert protocol.readings == ((1, 3, 7, 9, 13, 24), (0, 2, 6, 8, 12, 23))
    scores = judge(protocol, DATA, {"zero": zero_velocity(25)})["zero"]
    text = (DATA / "README.md").read_text(encoding="utf-8")
    lines = text[text.index("Euler error (radians) of zero velocity") :].splitlines()
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    table = {row[0]: row[7:] for row in rows[2:8]}
    assert set(table) == set(scores)
    for action, cells in table.items():
        shown = [f"{scores[action].errors[f]:.2f}" for f in protocol.readings[0]]
        assert shown == cells, action
