import pytest

from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.loop import Epoch
from hri_predict.lab.training.runs import TrainingView


@pytest.mark.parametrize(("limit", "left"), [(None, "30.0"), (15.0, "5.0"), (60.0, "30.0")])
def test_the_time_left_is_that_of_the_epochs_or_of_the_limit(tmp_path, capsys, limit, left):
    config = TrainingConfig.model_validate(
        {
            "predictor": "sinn",
            "judgement": "real",
            "out": tmp_path,
            "shape": {"history_steps": 4, "horizon_steps": 3},
            "train": {"max_minutes": limit},
        }
    )
    view = TrainingView(config, None)
    view.started(0, 16)
    view.ended_epoch(
        Epoch(
            number=1,
            step=4,
            losses={"loss": 1.0},
            validation=None,
            best=True,
            learning_rate=0.1,
            minutes=10.0,
        )
    )
    view.close()
    assert f"10.0 min, {left} min left" in capsys.readouterr().err
