"""``evaluate --benchmark``: predictors by the papers' protocols."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import command, one_of, progress, result, tell, warn

if TYPE_CHECKING:  # torch takes seconds to import, which the other commands need not wait for
    from hri_predict.lab.evaluation.benchmark import Forecaster, Protocol
    from hri_predict.predictors.neural.weights import LoadedWeights
    from hri_predict.run.compared_predictors import ComparedPredictor

AVERAGE = "average"
"""The mean forecast of all other trained predictors of the command."""


def by_benchmark(
    *,
    data: list[Path],
    asked: "Mapping[str, ComparedPredictor]",
    options: tuple[str, str, int, int | None, str | None],
    out: Path | None,
    as_json: bool,
) -> None:
    """Evaluate and show the result; ``options`` are benchmark, windows, n_out, n_in and error.

    Raises:
        ConfigError: an option or the weights do not fit the benchmark.
        HriPredictError: a recording or the weights cannot be read.
    """
    from hri_predict.lab.evaluation import benchmark_report
    from hri_predict.lab.evaluation.benchmark import Protocol, judge
    from hri_predict.lab.evaluation.benchmark_result import BenchmarkResult

    benchmark, windows, n_out, n_in, error = options
    if len(data) != 1:
        raise ConfigError("--data: a benchmark reads one folder; give it once")
    if n_out not in (10, 25):
        raise ConfigError(f"--n-out {n_out}: the benchmark predicts 10 or 25 frames")
    if n_in is not None and not 2 <= n_in <= 50:  # one frame has no velocity
        raise ConfigError(f"--n-in {n_in}: the benchmark's windows have 2 to 50 observed frames")
    loaded = {label: _load(each.name, each.weights) for label, each in asked.items()}
    protocol = Protocol(
        benchmark=benchmark,
        windows=windows,
        n_out=n_out,
        error=one_of("--error", error or _own_error(benchmark, loaded), ("mpjpe", "euler")),
        observed_frames=n_in,
    )
    forecasters = _forecasters(protocol, loaded)
    _warn_of_longer_histories(protocol, loaded)
    with progress() as bar:
        task = bar.add_task("judging", total=None)
        scores = judge(protocol, data[0], forecasters, lambda a: bar.update(task, description=a))
    cards = {name: found.card for name, found in loaded.items() if found is not None}
    found = BenchmarkResult(protocol, scores, tuple(asked), cards)
    if out is not None:
        tell(benchmark_report.write_report(found, out, command()))
    tables, notes = benchmark_report.tables(found), benchmark_report.notes(found)
    result(as_json, benchmark_report.as_json(found), tables, notes)


def _warn_of_longer_histories(
    protocol: "Protocol", loaded: "Mapping[str, LoadedWeights | None]"
) -> None:
    for label, found in loaded.items():
        steps = 0 if found is None else found.network.shape.history_steps
        if steps > protocol.n_in:
            warn(
                f"{label} observes {steps} frames, of which {steps - protocol.n_in} are missing in "
                f"windows of {protocol.n_in}; give --n-in {steps}"
            )


def _load(predictor: str, weights: Path | None) -> "LoadedWeights | None":
    """Return the network of a trained predictor.

    ``None`` for one of the benchmark's baselines, and for the average of the other predictors.
    """
    from hri_predict.predictors.neural.network import network_class_of
    from hri_predict.predictors.neural.weights import load_weights

    if predictor in ("zero_velocity", "constant_velocity", AVERAGE):
        if weights is not None:
            raise ConfigError(
                f"--weights: {predictor} does not use weights; leave it out, and write --predictor "
                f"NAME=WEIGHTS for others"
            )
        return None
    if network_class_of(predictor) is None:
        raise ConfigError(
            f"--predictor {predictor}: the benchmark evaluates zero_velocity, constant_velocity, "
            f"trained predictors and their {AVERAGE}; leave out --benchmark to evaluate it on "
            f"recordings"
        )
    if weights is None:
        raise ConfigError(
            f"--predictor {predictor}: give --weights FILE, trained for the benchmark with "
            f"hri-predict train (shipped weights are for real recordings)"
        )
    loaded = load_weights(weights)
    if loaded.method != predictor:
        raise ConfigError(
            f"--weights {weights}: made for '{loaded.method}', not for '{predictor}'; give weights "
            f"made for it"
        )
    return loaded


def _own_error(benchmark: str, loaded: "Mapping[str, LoadedWeights | None]") -> str:
    """Return the error that the weights are trained for: euler if a network predicts rotations."""
    from hri_predict.lab.evaluation.benchmarks import benchmark_of

    euler = benchmark_of(benchmark).skeletons.get("euler")
    errors = {
        name: "euler" if euler and found.network.shape.skeleton.name == euler.name else "mpjpe"
        for name, found in loaded.items()
        if found is not None
    }
    if len(set(errors.values())) > 1:
        what = ", ".join(f"{name} {error}" for name, error in errors.items())
        raise ConfigError(f"--predictor: errors differ ({what}); evaluate them separately")
    return next(iter(errors.values()), "mpjpe")


def _forecasters(
    protocol: "Protocol", loaded: "Mapping[str, LoadedWeights | None]"
) -> "dict[str, Forecaster]":
    """Return the requested predictors, then the baselines."""
    from hri_predict.lab.evaluation.benchmark import (
        average_of,
        constant_velocity,
        network_forecaster,
        zero_velocity,
    )

    baselines = {"zero_velocity": zero_velocity(protocol.n_out)}
    if protocol.error == "mpjpe":  # rotation vectors do not add up, so they have no velocity
        baselines["constant_velocity"] = constant_velocity(protocol.n_out)
    networks = {
        name: network_forecaster(protocol, found.network, f"--predictor {name}")
        for name, found in loaded.items()
        if found is not None
    }
    asked = {}
    for name in loaded:
        if name in networks:
            asked[name] = networks[name]
        elif name == AVERAGE:
            asked[name] = average_of(_members(protocol, networks))
        elif name in baselines:
            asked[name] = baselines[name]
        else:
            raise ConfigError(
                f"--predictor {name}: has no --error {protocol.error}; use zero_velocity"
            )
    return {**asked, **baselines}


def _members(
    protocol: "Protocol", networks: "Mapping[str, Forecaster]"
) -> "tuple[Forecaster, ...]":
    if protocol.error == "euler":
        raise ConfigError(f"--predictor {AVERAGE}: rotations cannot be averaged; leave it out")
    if len(networks) < 2:
        raise ConfigError(
            f"--predictor {AVERAGE}: averages the other trained predictors; give two or more, such "
            f"as --predictor mixer=a.safetensors --predictor stb=b.safetensors"
        )
    return tuple(networks.values())
