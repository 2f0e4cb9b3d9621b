"""Shipping a predictor: its weights, without the paths of one machine, and their card.

``hri-predict card RUN/sinn.safetensors --real real.json --benchmark cmu.json`` copies the weights
of a run to the folder where the node looks for them, and writes ``sinn.md`` next to them.
``hri-predict evaluate`` writes both JSON files.
"""

import json
import math
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write
from hri_predict.contracts import registry
from hri_predict.lab.datasets.splits import VERSION
from hri_predict.lab.evaluation.benchmark import nominal_ms
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.predictor import NeuralPredictor
from hri_predict.predictors.neural.settings import shipped_weights
from hri_predict.predictors.neural.weights import Header, load_weights, read_header, save_weights

ATTRIBUTION = (
    "The data used in this project was obtained from mocap.cs.cmu.edu. "
    "The database was created with funding from NSF EIA-0196217."
)
SOURCES = (
    "Other sources: motion/beside_robot from JakobThumm/human-robot-animations (MIT, copyright "
    "2023 Jakob Thumm); motion/cmu_dance by way of papagina/Auto_Conditioned_RNN_motion (MIT, "
    "copyright 2018 the authors of Auto-Conditioned Recurrent Networks for Extended Complex Human "
    "Motion Synthesis); assembly from Human_Assembly_Data (MIT, copyright 2020 Intelligent Control "
    "Lab)."
)
_OF_ONE_MACHINE = {"out", "initial_weights", "root"}  # keys of a training configuration
_LATENCY_CALLS = 50


def publish(
    weights: Path, real: Path | None, benchmark: Path | None, folder: Path | None
) -> tuple[Path, Path]:
    """Ship the weights of a finished run with their card.

    Args:
        weights: the run's weights.
        real, benchmark: JSON files of ``hri-predict evaluate`` for the card.
        folder: folder to write to; ``None``: that of the shipped weights.

    Returns:
        The two files written: weights and card.

    Raises:
        HriPredictError: see ``ship`` and ``card_of``; nothing is written if a file given is wrong.
    """
    shipped = shipped_weights(read_header(weights).method)
    destination = shipped if folder is None else folder / shipped.name
    text = card_of(weights, _judgement(real), _judgement(benchmark))
    ship(weights, destination)
    _write(destination.with_suffix(".md"), text)
    return destination, destination.with_suffix(".md")


def ship(weights: Path, destination: Path) -> None:
    """Copy weights without the paths of the machine that trained them.

    Raises:
        HriPredictError: the weights are broken, or the destination cannot be written.
    """
    loaded = load_weights(weights)
    card = dict(loaded.card)
    if isinstance(card.get("config"), dict):
        card["config"] = _portable(card["config"])
    if isinstance(card.get("command"), str):  # its paths of one machine without their folders
        card["command"] = re.sub(r"(?<![\w.])(/[^\s/'\"]+)*/", "", card["command"])
    save_weights(destination, loaded.method, loaded.network, card)


def card_of(
    weights: Path, real: Mapping[str, Any] | None, benchmark: Mapping[str, Any] | None
) -> str:
    """Return the Markdown card of weights for the node.

    Args:
        weights: the file; its predictor's latency is measured on this machine.
        real: evaluation of these weights on recordings, as ``report.as_json`` gives it.
        benchmark: the benchmark's results of the method, from ``benchmark_report.as_json``.

    Raises:
        HriPredictError: the weights are broken or not for the node, or a result is damaged or of
            another method.
    """
    header = read_header(weights)
    judged = []
    for option, tell, found in (("--real", _real, real), ("--benchmark", _benchmark, benchmark)):
        try:
            judged.append(tell(header.method, found))
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
            raise ConfigError(
                f"card of {header.method}: {option} is not a result of hri-predict evaluate; "
                f"evaluate again, and give its JSON file"
            ) from error
    return "\n".join([_head(header, weights), _origin(header), *judged])


def latency_ms(predictor: NeuralPredictor, people: int) -> float:
    """Median CPU time in milliseconds of a forecast for this number of people, all joints observed.

    CPU time of one thread, because training may run at the same time.
    """
    shape = (people, predictor.history_steps, len(predictor.skeleton.joints))
    history = np.random.default_rng(0).normal(0.0, 0.3, (*shape, 3))
    observed = np.ones(shape, dtype=bool)
    taken = []
    for _ in range(_LATENCY_CALLS):
        start = time.thread_time()
        predictor.predict(history, observed)
        taken.append(time.thread_time() - start)
    return 1e3 * float(np.median(taken))


def _head(header: Header, weights: Path) -> str:
    made = registry.load("predictors", header.method)
    asked = {"name": header.method, "weights": str(weights), "rate_hz": header.shape.rate_hz}
    predictor = made(made.settings_model.model_validate(asked))
    assert isinstance(predictor, NeuralPredictor)
    shape, rate_hz = header.shape, header.shape.rate_hz
    parameters = sum(p.numel() for p in predictor.network.model_parameters())
    times = ", ".join(f"{latency_ms(predictor, n):.1f} ms for {n}" for n in (1, 4))
    rows = {
        "skeleton": f"{shape.skeleton}, {len(shape.joints)} joints; serves the {BODY.name} and "
        "canonical skeletons",
        "rate": f"{rate_hz:g} Hz",
        "history": f"{shape.history_steps} steps, {shape.history_steps / rate_hz:.2f} s",
        "horizon": f"{shape.horizon_steps} steps, {shape.horizon_steps / rate_hz:.2f} s",
        "size": f"{parameters / 1e6:.2f} million parameters; {weights.stat().st_size / 1e6:.1f} MB",
        "latency": f"{times} people: CPU time of one thread where this card was written",
        "commit": str(header.card.get("commit") or "not known"),
        "command": f"`{header.card['command']}`" if header.card.get("command") else "not known",
        "seed": str(_of_config(header, "train").get("seed", "not known")),
        "time": f"{header.card.get('minutes', '?')} minutes",
        "data's digest": str(header.card.get("data_fingerprint") or "not known"),
        "trained for": f"epoch {header.card.get('epoch', '?')}, {header.card.get('steps', '?')} "
        "steps in all",
        "validation": _validation(header.card.get("validation")),
    }
    about = (made.__doc__ or "").strip().partition("\n")[0]
    lines = [f"# {header.method}", "", about, "", "| | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {key} | {value} |" for key, value in rows.items()), ""])


def _validation(found: Any) -> str:
    error = found.get("mpjpe_mm") if isinstance(found, Mapping) else None
    if not isinstance(error, int | float) or not error:
        return "none"
    return f"{error:.1f} mm, mean over actions and horizons"


def _origin(header: Header) -> str:
    config = header.card.get("config")
    refit = _of_config(header, "data").get("refit")
    lists = "splits `fit` and `validation`" if refit else "split `fit`"
    text = yaml.safe_dump(_portable(config), sort_keys=False) if config else "not known\n"
    tuned = isinstance(config, Mapping) and config.get("initial_weights") is not None
    began = " Training started from earlier weights of this predictor." if tuned else ""
    return (
        f"## Data\n\nThe recordings of the {lists} (configs/training/splits.yaml, version "
        f"{VERSION}) of the data pack.{began} {ATTRIBUTION} {SOURCES}\n\n"
        f"## Configuration\n\n```yaml\n{text}```\n"
    )


def _of_config(header: Header, section: str) -> Mapping[str, Any]:
    config = header.card.get("config")
    found = config.get(section) if isinstance(config, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _portable(config: Any) -> Any:
    """A configuration without the paths of one machine."""
    if not isinstance(config, Mapping):
        return config
    return {k: _portable(v) for k, v in config.items() if k not in _OF_ONE_MACHINE}


def _real(method: str, real: Mapping[str, Any] | None) -> str:
    head = "## Evaluation on recordings\n"
    if real is None:
        return f"{head}\nNot done.\n"
    clean = [r for r in real["results"] if r["disturbance"] is None]
    own = _own(clean, "predictor", method, "evaluation on recordings")
    columns = [f"{ms} ms" for ms in real["horizons_ms"]]
    rows = [(f"mean: {r['predictor']}", r["mean_mm"]) for r in clean]
    rows += [(f"{a} ({e['windows']} windows)", e["mm"]) for a, e in own["actions"].items()]
    losses = [
        f"- {loss['disturbance']}: {100 * loss['overall']:+.1f} %"
        for loss in real.get("losses", ())
        if loss["predictor"] == method and loss["overall"] is not None
    ]
    disturbed = ["", "Growth of the error with disturbed input:", "", *losses] if losses else []
    said = (
        "Mean joint error in the room on test recordings, in true millimetres, travel included; "
        f"the mean is over {', '.join(own['mean_over'])}."
    )
    return "\n".join([head, said, "", *_table(columns, rows, 0), *disturbed, ""])


def _benchmark(method: str, benchmark: Mapping[str, Any] | None) -> str:
    head = "## Benchmark\n"
    if benchmark is None:
        return f"{head}\nNot done.\n"
    own = _own(benchmark["results"], "method", method, "benchmark")
    frames = benchmark["read_at_future_frames"][0]
    rows = [(f"mean: {r['method']}", r["mean"]) for r in benchmark["results"]]
    rows += [(a, score["errors"]) for a, score in own["actions"].items()]
    picked = [(name, [errors[f] for f in frames]) for name, errors in rows]
    said = (
        f"{benchmark['benchmark']}, windows: {benchmark['windows']}, {benchmark['n_in']} frames "
        f"to {benchmark['n_out']}, {benchmark['error']} in {benchmark['unit']}, nominal "
        "milliseconds; with weights of the same method trained for the benchmark, not these. "
        f"The mean is over {', '.join(benchmark['mean_over'])}."
    )
    digits = 2 if benchmark["unit"] == "rad" else 1
    columns = [f"{nominal_ms(f)} ms" for f in frames]
    return "\n".join([head, said, "", *_table(columns, picked, digits), ""])


def _own(results: Sequence[Mapping[str, Any]], key: str, method: str, what: str) -> Any:
    for result in results:
        if result[key] == method:
            return result
    raise ConfigError(f"card of {method}: the {what} has no result for it; give one that has")


def _table(
    columns: list[str], rows: list[tuple[str, list[float | None]]], digits: int
) -> list[str]:
    lines = ["| | " + " | ".join(columns) + " |", "|---|" + "---:|" * len(columns)]
    for name, values in rows:
        cells = ("–" if v is None or not math.isfinite(v) else f"{v:.{digits}f}" for v in values)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def _judgement(path: Path | None) -> Any:
    if path is None:
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8")) or {}  # null is no judgement either
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"results {path}: cannot be read ({error}); evaluate again") from error


def _write(path: Path, text: str) -> None:
    remedy = "its weights were written; fix that and ship again"
    with OsErrorAs(ConfigError, f"card {path}: cannot be written", remedy):
        atomic_write(path, text.encode())
