"""``evaluate --benchmark``: weights of another task are one line that says how to train."""

import pytest

from hri_predict.base.errors import PredictorError
from hri_predict.cli.evaluate_benchmark import by_benchmark
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import Shape
from hri_predict.predictors.neural.weights import save_weights
from hri_predict.predictors.trajectorycnn import TrajectoryCNN, TrajectoryCNNOptions
from hri_predict.run.compared_predictors import asked_predictors


@pytest.mark.parametrize(
    ("error", "training"),
    [
        ("mpjpe", "judgement: benchmark"),
        ("euler", "judgement: benchmark and data: {space: rotations}"),
    ],
)
def test_weights_for_recordings_are_told_how_to_train(tmp_path, capsys, error, training):
    shape = Shape(skeleton=BODY, history_steps=15, horizon_steps=25, rate_hz=25.0)
    path = tmp_path / "w.safetensors"
    network = TrajectoryCNN(shape, TrajectoryCNNOptions(channels=4, blocks=1))
    save_weights(path, "trajectorycnn", network, {})
    (asked,) = asked_predictors([f"trajectorycnn={path}"])
    with pytest.raises(PredictorError) as raised:
        by_benchmark(
            data=[tmp_path],
            asked={"mine": asked},
            options=("cmu", "all", 25, None, error),
            out=None,
            as_json=False,
        )
    said = str(raised.value)
    assert said.startswith("--predictor mine: predicts skeleton body28; this benchmark needs cmu")
    assert said.endswith(f"; give weights that were trained for it, with {training}")
    assert capsys.readouterr().err == ""  # no advice on windows that these weights never see
