from types import SimpleNamespace
from typing import Any, cast

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Settings
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.loop import Epoch
from hri_predict.lab.training.parts import DATA_SETS
from hri_predict.lab.training.runs import TrainingView, build_network, state
from tests.hri_predict.lab.training.small_run import make_config, run


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


@pytest.mark.parametrize(
    ("ended", "longer"),
    [
        ({"max_minutes": 1e-9}, {"max_minutes": 9.0}),
        ({"stop_after": 1}, {"stop_after": 2}),
        ({"patience": 1, "learning_rate": 1e-30, "ema_decay": 0}, {}),
    ],
)
def test_a_run_that_takes_no_more_steps_is_done(tmp_path, ended, longer):
    assert state(make_config(tmp_path, **ended)) == "new"
    run(tmp_path, **ended)
    assert state(make_config(tmp_path, **ended)) == "done"
    assert state(make_config(tmp_path, **longer)).endswith(" %")


@pytest.mark.parametrize("flag", ["--data", "--joint-map"])
def test_a_flag_of_recordings_is_refused_for_a_data_set_without_any(
    tmp_path, monkeypatch, cli, flag
):
    monkeypatch.setitem(DATA_SETS, "waves", SimpleNamespace(settings_model=Settings))
    path = tmp_path / "waves.yaml"
    path.write_text(
        "{predictor: mixer, judgement: waves, shape: {history_steps: 4, horizon_steps: 3}, "
        f"out: {tmp_path / 'out'}}}"
    )
    status, _, err = cli("train", path, flag, "coco17")
    key = {"--data": "root", "--joint-map": "joint_map"}[flag]
    assert (status, err) == (
        2,
        f"error: {flag}: data set 'waves' has no key data.{key}; leave {flag} out\n",
    )


@pytest.mark.parametrize(
    ("predictor", "options", "says"),
    [
        ("mixer", {}, "options.mirrored needs positions, .*; set options.mirrored=false"),
        ("trajectorycnn", {"bone_weight": 0.5}, "set options.bone_weight=0"),
        ("kdformer", {}, "options.space is positions and data.space rotations; set both alike"),
    ],
)
def test_rotations_are_never_taken_for_positions(predictor, options, says):
    config = TrainingConfig.model_validate({
        "predictor": predictor, "judgement": "benchmark", "out": "none", "options": options,
        "shape": {"history_steps": 8, "horizon_steps": 5}, "data": {"space": "rotations"},
    })  # fmt: skip
    with pytest.raises(ConfigError, match=says):
        build_network(config, cast(Any, None))
