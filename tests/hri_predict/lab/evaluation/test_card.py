"""The card of shipped weights: what it says, of which file, and what is left out of both."""

import json
from functools import partial

import numpy as np
import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.lab.datasets.cmu_benchmark import MEAN_OVER
from hri_predict.lab.datasets.corruption import standard
from hri_predict.lab.evaluation import benchmark_report, report
from hri_predict.lab.evaluation.benchmark import Protocol, Score
from hri_predict.lab.evaluation.benchmark_result import BenchmarkResult
from hri_predict.lab.evaluation.card import ATTRIBUTION, SOURCES, card_of, publish, ship
from hri_predict.lab.evaluation.recordings import Errors, RecordingResult
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import Shape
from hri_predict.predictors.neural.weights import load_weights, read_header, save_weights
from hri_predict.predictors.trajectorycnn import TrajectoryCNN, TrajectoryCNNOptions
from tests.commands import status_of

CONFIG = {
    "predictor": "trajectorycnn",
    "data": {"root": "/somebody/s/data", "weights": {"jumping": 1.4}},
    "train": {"seed": 7},
    "initial_weights": None,
    "out": "/somebody/s/runs",
}


@pytest.fixture
def weights(tmp_path):
    torch.manual_seed(2)
    options = TrajectoryCNNOptions(channels=8, blocks=1)
    network = TrajectoryCNN(
        Shape(skeleton=BODY, history_steps=15, horizon_steps=25, rate_hz=25.0), options
    )
    card = {"config": CONFIG, "commit": "abc123", "epoch": 3, "validation": {"mpjpe_mm": 81.25}}
    path = tmp_path / "run" / "trajectorycnn.safetensors"
    save_weights(path, "trajectorycnn", network, card)
    return path


def errors(metres: float, windows: int) -> Errors:
    count = np.full((25, 28), float(windows))
    return Errors(windows, metres * count, count)


@pytest.fixture
def real():
    own = {"walking": errors(0.05, 12), "jumping": errors(0.07, 8)}
    disturbed = {"walking": errors(0.06, 12), "jumping": errors(0.084, 8)}
    results = [
        RecordingResult("trajectorycnn", None, own),
        RecordingResult("zero_velocity", None, {a: errors(0.3, e.windows) for a, e in own.items()}),
        RecordingResult("trajectorycnn", standard()[0], disturbed),
    ]
    return report.as_json(results)


@pytest.fixture
def benchmark():
    scores = {a: Score(5, np.linspace(1.0, 25.0, 25), None) for a in MEAN_OVER}
    protocol = Protocol("cmu", "all", 25)
    return benchmark_report.as_json(
        BenchmarkResult(protocol, {"trajectorycnn": scores}, ("trajectorycnn",), {})
    )


def test_says_all_that_it_must(weights, real, benchmark):
    text = card_of(weights, real, benchmark)
    for said in (
        "# trajectorycnn",
        "| skeleton | body28, 28 joints",
        "| rate | 25 Hz |",
        "| history | 15 steps, 0.60 s |",
        "| horizon | 25 steps, 1.00 s |",
        "| commit | abc123 |",
        "| validation | 81.2 mm",
        ATTRIBUTION,
        SOURCES,
        "seed: 7",
        "| mean: trajectorycnn | 60 | 60 | 60 | 60 | 60 | 60 |",
        "| mean: zero_velocity | 300 |",
        "| walking (12 windows) | 50 |",
        "+20.0 %",
        "| mean: trajectorycnn | 2.0 | 4.0 | 8.0 | 10.0 | 14.0 | 25.0 |",  # frames 1, 3, ... 24
        "not these",
    ):
        assert said in text


def test_paths_of_the_machine_are_left_out(weights, tmp_path):
    folder = tmp_path / "shipped"
    publish(weights, None, None, folder)
    shipped = folder / "trajectorycnn.safetensors"
    assert b"/somebody" in weights.read_bytes()
    assert b"/somebody" not in shipped.read_bytes()
    assert "/somebody" not in (folder / "trajectorycnn.md").read_text(encoding="utf-8")
    assert read_header(shipped).card["config"]["data"] == {"weights": {"jumping": 1.4}}


def test_shipping_changes_no_weight(weights, tmp_path):
    ship(weights, tmp_path / "shipped.safetensors")
    before = load_weights(weights).network.state_dict()
    after = load_weights(tmp_path / "shipped.safetensors").network.state_dict()
    for name, tensor in before.items():
        torch.testing.assert_close(after[name], tensor, rtol=0, atol=0)


def test_judgements_not_done_are_said_to_be(weights):
    assert card_of(weights, None, None).count("Not done.") == 2


def test_a_judgement_of_another_predictor_is_refused(weights, real):
    real["results"] = [r for r in real["results"] if r["predictor"] != "trajectorycnn"]
    with pytest.raises(ConfigError, match="the evaluation on recordings has no result for it"):
        card_of(weights, real, None)


def test_a_validation_that_is_no_number_is_none(weights, tmp_path):
    loaded = load_weights(weights)
    card = loaded.card | {"validation": {"mpjpe_mm": "x"}}
    save_weights(tmp_path / "odd.safetensors", "trajectorycnn", loaded.network, card)
    assert "| validation | none |" in card_of(tmp_path / "odd.safetensors", None, None)


@pytest.mark.parametrize("option", ["--real", "--benchmark"])
@pytest.mark.parametrize(
    "text", ["[1, 2]", "{}", "null", '{"results": [3]}', '{"results": {"a": 1}}', "7"]
)
def test_what_is_no_judgement_changes_nothing_shipped(weights, tmp_path, option, text):
    odd = tmp_path / "odd.json"
    odd.write_text(text, encoding="utf-8")
    folder = tmp_path / "shipped"
    folder.mkdir()
    for ending in ("safetensors", "md"):
        (folder / f"trajectorycnn.{ending}").write_text("as it was", encoding="utf-8")
    real, benchmark = (odd, None) if option == "--real" else (None, odd)
    with pytest.raises(ConfigError, match=f"^card of trajectorycnn: {option} is not a result"):
        publish(weights, real, benchmark, folder)
    assert {path.read_text(encoding="utf-8") for path in folder.iterdir()} == {"as it was"}


def test_the_command_writes_both_files_and_tells_mistakes_in_one_line(weights, tmp_path, capsys):
    card = partial(status_of, "card")
    shipped = tmp_path / "trajectorycnn.safetensors"
    assert card(weights, "--out", tmp_path) == 0
    assert capsys.readouterr().out == f"written: {shipped}, {shipped.with_suffix('.md')}\n"
    (tmp_path / "real.json").write_text(json.dumps({})[:1], encoding="utf-8")
    assert card(weights, "--out", tmp_path, "--real", tmp_path / "real.json") == 2
    assert card(tmp_path / "none.safetensors") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("error: ") for line in lines)
    assert "real.json: cannot be read" in lines[0]
    assert "the file does not exist" in lines[1]


def test_a_card_says_where_training_began(tmp_path, weights):
    assert "earlier weights" not in card_of(weights, None, None)
    loaded = load_weights(weights)
    card = loaded.card | {"config": CONFIG | {"initial_weights": "/somebody/s/runs/old"}}
    save_weights(weights, loaded.method, loaded.network, card)
    text = card_of(weights, None, None)
    assert "Training started from earlier weights of this predictor." in text
    assert "somebody" not in text
