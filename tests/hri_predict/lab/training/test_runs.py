from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Settings
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.loop import Epoch
from hri_predict.lab.training.parts import DATA_SETS
from hri_predict.lab.training.runs import TrainingView, build_network, open_samples, state
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import Shape
from hri_predict.predictors.neural.weights import load_weights, save_weights
from hri_predict.predictors.sinn.model import SINN, SINNOptions
from tests.hri_predict.lab.training.small_run import make_config, run
from tests.hri_predict.lab.training.test_train_cli import write_walk


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


def test_weights_without_an_added_part_start_a_network_with_it(tmp_path):
    shape = Shape(skeleton=BODY, history_steps=8, horizon_steps=5, rate_hz=25.0)
    small = {"hidden": 8, "critic_steps": 5}
    given = tmp_path / "sinn.safetensors"
    save_weights(given, "sinn", SINN(shape, SINNOptions.model_validate(small)), {})
    write_walk(tmp_path, "walk_9", 300)
    write_walk(tmp_path, "check_1", 300)

    def built(**options):
        config = TrainingConfig.model_validate({
            "predictor": "sinn", "judgement": "real", "out": tmp_path / "run",
            "shape": {"history_steps": 8, "horizon_steps": 5}, "options": small | options,
            "data": {"root": tmp_path, "fit": ["walk_9.npz"], "validation": ["check_1.npz"]},
            "initial_weights": given,
        })  # fmt: skip
        return build_network(config, open_samples(config)).state_dict()

    def grows(**options):
        """Train with an added part, and take the result as what is given next."""
        old, new = load_weights(given).network.state_dict(), built(**options)
        assert new.keys() > old.keys()
        for name, value in old.items():
            if not name.startswith("critic"):
                torch.testing.assert_close(new[name], value)
        network = SINN(shape, SINNOptions.model_validate(small | options))
        network.load_state_dict(new)
        save_weights(given, "sinn", network, {})

    grows(start_frames=7, gate=True, pretraining=0.0)
    grows(start_frames=7, gate=True, spread=True, pretraining=0.0)
    with pytest.raises(ConfigError, match="have another network, shape or options"):
        built(pose="none")
