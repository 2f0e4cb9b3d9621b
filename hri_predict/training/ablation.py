"""What each augmentation brings: the same short training, one augmentation left out at a time.

``python -m hri_predict.training.ablation configs/training/trajectorycnn_real.yaml --data DIR --out
FOLDER`` trains a small TrajectoryCNN once with all augmentations, once with none, and once without
each, with the same seed and steps, and judges each by the Real judgement on the validation
recordings, undisturbed and disturbed. Runs that are there already are not run again. The table is
Markdown, the overall mean of ``RealResult.overall_mm`` in millimetres.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hri_predict import registry
from hri_predict.errors import ConfigError, HriPredictError
from hri_predict.predictors.body import BODY
from hri_predict.predictors.neural import NeuralSettings
from hri_predict.settings import validated
from hri_predict.training.augment import AugmentSettings
from hri_predict.training.building import build_network, open_samples
from hri_predict.training.config import TrainingConfig, load_training_config
from hri_predict.training.corruption import Corruption
from hri_predict.training.loop import train
from hri_predict.training.motion import DataSettings
from hri_predict.training.real import judge_real
from hri_predict.training.real_windows import RATE_HZ, read_motions
from hri_predict.training.stopping import told_to_stop
from hri_predict.training.view import training_view
from hri_predict.whole_file import write_whole

PREDICTOR = "trajectorycnn"
SMALL = ["options.channels=32", "train.epochs=12"]
LEFT_OUT: Mapping[str, dict[str, Any]] = {
    "all": {},
    "without mirroring": {"mirror": 0.0},
    "without yaw rotation": {"yaw": False},
    "without body scale": {"scale": 0.0},
    "without time warp": {"warp": 0.0},
    "without slow motion": {"slow": 0.0},
    "without reversal": {"reverse": 0.0},
    "without late starts": {"truncate": 0.0},
    "without sensor noise": {"noise": 0.0, "outliers": 0.0},
    "without dropped joints": {
        "missing": 0.0, "limb": 0.0, "frames": 0.0, "sparse": 0.0, "arms": 0.0
    },
}  # fmt: skip
"""Of each run what differs from the configuration's own augmentations."""
CONDITIONS: tuple[Corruption | None, ...] = (
    None,
    Corruption("missing", 0.3),
    Corruption("limb", 1.0),
    Corruption("noise", 0.3, 0.03),
)


def runs(config: TrainingConfig) -> dict[str, TrainingConfig]:
    """By name the runs to make, each in a folder of its own below ``config.out``."""
    augment = config.data.get("augment", {})
    given = validated(AugmentSettings, augment, "training configuration: data.augment")
    changes = dict(LEFT_OUT)
    changes["none"] = {k: v for change in LEFT_OUT.values() for k, v in change.items()}
    made = {}
    for name, change in changes.items():
        augment = given.model_copy(update=change).model_dump()
        data = config.data | {"augment": augment}
        out = config.out / name.replace(" ", "_")
        made[name] = config.model_copy(update={"data": data, "out": out})
    return made


def trained(config: TrainingConfig, stop: Callable[[], bool] = lambda: False) -> Path:
    """Weights of a finished run, made now if they are not there.

    Raises:
        KeyboardInterrupt: ``stop`` said so; the run is saved.
    """
    source = open_samples(config)
    resume = os.path.exists(config.out / "last.pt")  # bears a name that is too long
    with training_view(config) as view:
        network = build_network(config, source)
        result = train(config, source, network, view, resume=resume, stop=stop)
    if result.ending == "interrupted":
        raise KeyboardInterrupt
    return result.weights


def judged(config: TrainingConfig, weights: Path) -> list[float]:
    """Mean error in millimetres on the validation recordings, one of each of ``CONDITIONS``."""
    made = registry.load("predictors", config.predictor)
    settings = NeuralSettings(name=config.predictor, weights=str(weights), horizon_s=1.0)
    predictor = made(settings, BODY)
    data = validated(DataSettings, config.data, "training configuration: data")
    motions = list(read_motions(data.files("validation")))
    return [judge_real(predictor, motions, condition).overall_mm() for condition in CONDITIONS]


def table(rows: Mapping[str, Sequence[float]]) -> str:
    """Markdown, one row of each run."""
    names = ["undisturbed" if c is None else c.name for c in CONDITIONS]
    lines = [f"| augmentation | {' | '.join(names)} |", "|---|" + "---:|" * len(names)]
    lines += [f"| {name} | {' | '.join(f'{v:.1f}' for v in row)} |" for name, row in rows.items()]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, judge and print all of them."""
    parser = argparse.ArgumentParser(prog="python -m hri_predict.training.ablation")
    parser.add_argument("config", type=Path, help="training configuration, Real judgement")
    parser.add_argument("--data", required=True, help="folder of the recordings")
    parser.add_argument("--out", required=True, help="folder of the runs and the table")
    parser.add_argument("--set", action="append", default=[], dest="changes", help="as of train")
    given = parser.parse_args(arguments)
    try:
        config = _configuration(given)
        rows = {}
        for name, run in runs(config).items():
            with told_to_stop() as stop:
                weights = trained(run, stop)
            rows[name] = judged(run, weights)
        _write(config.out / "ablation.md", table(rows))
    except HriPredictError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("saved; go on with the same command", file=sys.stderr)
        return 130
    print(table(rows), end="")
    return 0


def _configuration(given: argparse.Namespace) -> TrainingConfig:
    """What all runs are made from; whatever the last of them would fail for is refused now."""
    own = [f"data.root={json.dumps(given.data)}", f"out={json.dumps(given.out)}"]
    config = load_training_config(given.config, [*SMALL, *given.changes, *own])
    if config.judgement != "real":
        raise ConfigError(f"{given.config}: augmentations are of the Real judgement alone")
    if config.predictor != PREDICTOR:
        raise ConfigError(
            f"{given.config}: is of '{config.predictor}', and a small {PREDICTOR} is trained; give "
            f"configs/training/{PREDICTOR}_real.yaml"
        )
    if config.shape.rate_hz != RATE_HZ:
        raise ConfigError(
            f"{given.config}: shape.rate_hz {config.shape.rate_hz:g}: the Real judgement is at "
            f"{RATE_HZ:g}; leave it out"
        )
    return config


def _write(path: Path, text: str) -> None:
    try:
        write_whole(path, text.encode())
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be written: {error.strerror}; mend that and go on with the same "
            f"command"
        ) from error


if __name__ == "__main__":
    sys.exit(main())
