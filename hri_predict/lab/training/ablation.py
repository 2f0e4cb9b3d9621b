"""Benefit of each augmentation: the same short training, one augmentation left out at a time.

``hri-predict ablate configs/training/trajectorycnn_real.yaml --data DIR --out FOLDER`` trains a
small TrajectoryCNN with all augmentations, with none, and without each, with the same seed and
steps. Each is evaluated on the validation recordings, undisturbed and disturbed. Finished runs are
not run again. The table is Markdown; it holds ``RecordingResult.overall_mm``, the mean error over
actions and horizons in millimetres.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write
from hri_predict.base.settings import Settings, validated
from hri_predict.contracts import registry
from hri_predict.lab.datasets.corruption import Corruption
from hri_predict.lab.evaluation.recordings import judge_one
from hri_predict.lab.evaluation.windows import RATE_HZ, read_motions
from hri_predict.lab.training import runs as runs_of
from hri_predict.lab.training.checkpoint import check_writable
from hri_predict.lab.training.config import TrainingConfig, load_training_config
from hri_predict.lab.training.stopping import told_to_stop
from hri_predict.lab.training.windows.augment import AugmentSettings
from hri_predict.lab.training.windows.bodies import BodySettings
from hri_predict.lab.training.windows.motion import DataSettings
from hri_predict.lab.training.windows.trackers import TrackerSettings
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.settings import NeuralSettings

PREDICTOR = "trajectorycnn"
SMALL = ["options.channels=32", "train.epochs=12"]
_DROPPED = ("missing", "limb", "frames", "sparse", "arms")
_OF_TRACKERS = ("rate", "dropped", "noise", "convention")
_SECTIONS: Mapping[str, type[Settings]] = {
    "augment": AugmentSettings,
    "bodies": BodySettings,
    "trackers": TrackerSettings,
}
LEFT_OUT: Mapping[str, dict[str, dict[str, Any]]] = {
    "all": {},
    "without mirroring": {"augment": {"mirror": 0.0}},
    "without yaw rotation": {"augment": {"yaw": False}},
    "without body scale": {"augment": {"scale": 0.0}},
    "without time warp": {"augment": {"warp": 0.0}},
    "without slow motion": {"augment": {"slow": 0.0}},
    "without reversal": {"augment": {"reverse": 0.0}},
    "without late starts": {"augment": {"truncate": 0.0}},
    "without sensor noise": {"augment": {"noise": 0.0, "outliers": 0.0}},
    "without dropped joints": {"augment": dict.fromkeys(_DROPPED, 0.0)},
    "without other bodies": {"bodies": {"share": 0.0}},
    "without other trackers": {"trackers": dict.fromkeys(_OF_TRACKERS, 0.0)},
}
"""Run -> section of ``data`` -> what differs there from the configuration's own."""
CONDITIONS: tuple[Corruption | None, ...] = (
    None,
    Corruption("missing", 0.3),
    Corruption("limb", 1.0),
    Corruption("noise", 0.3, 0.03),
)


def runs(config: TrainingConfig) -> dict[str, TrainingConfig]:
    """The runs to make by name, each in its own folder below ``config.out``."""
    given = {
        section: validated(
            settings, config.data.get(section, {}), f"training configuration: data.{section}"
        ).model_dump()
        for section, settings in _SECTIONS.items()
    }
    none = {
        section: {k: v for change in LEFT_OUT.values() for k, v in change.get(section, {}).items()}
        for section in _SECTIONS
    }
    made = {}
    for name, change in {**LEFT_OUT, "none": none}.items():
        changed = {s: values | change.get(s, {}) for s, values in given.items()}
        out = config.out / name.replace(" ", "_")
        made[name] = config.model_copy(update={"data": config.data | changed, "out": out})
    return made


def trained(config: TrainingConfig, stop: Callable[[], bool] = lambda: False) -> Path:
    """Return the weights of a finished run; train them now if they are missing.

    Raises:
        KeyboardInterrupt: ``stop`` returned true; the run is saved.
    """
    result = runs_of.trained(config, resume=runs_of.begun(config), stop=stop)
    if result.ending == "interrupted" or stop():  # asked to stop in its last step: it is finished
        raise KeyboardInterrupt
    return result.weights


def judged(config: TrainingConfig, weights: Path) -> list[float]:
    """Mean error in millimetres on the validation recordings, one for each of ``CONDITIONS``."""
    made = registry.load("predictors", config.predictor)
    settings = NeuralSettings(name=config.predictor, weights=str(weights), horizon_s=1.0)
    predictor = made(settings, BODY)
    data = validated(DataSettings, config.data, "training configuration: data")
    motions = list(read_motions(data.files("validation")))
    return [judge_one(predictor, motions, condition).overall_mm() for condition in CONDITIONS]


def table(rows: Mapping[str, Sequence[float]]) -> str:
    """Markdown, one row per run."""
    names = ["undisturbed" if c is None else c.name for c in CONDITIONS]
    lines = [f"| augmentation | {' | '.join(names)} |", "|---|" + "---:|" * len(names)]
    lines += [f"| {name} | {' | '.join(f'{v:.1f}' for v in row)} |" for name, row in rows.items()]
    return "\n".join(lines) + "\n"


def configuration(path: Path, data: str, out: str, changes: Sequence[str] = ()) -> TrainingConfig:
    """The configuration from which all runs are made.

    Args:
        path: a training configuration with ``judgement: real``.
        data: folder of the recordings.
        out: folder of the runs and of the table.
        changes: ``key.key=value``, as ``load_training_config`` takes them.

    Raises:
        ConfigError: one of the runs would fail with this configuration.
    """
    own = [f"data.root={json.dumps(data)}", f"out={json.dumps(out)}"]
    config = load_training_config(path, [*SMALL, *changes, *own])
    if config.judgement != "real":
        raise ConfigError(f"{path}: augmentations need judgement: real")
    if config.predictor != PREDICTOR:
        raise ConfigError(
            f"{path}: is for '{config.predictor}', but the ablation trains {PREDICTOR}; give "
            f"configs/training/{PREDICTOR}_real.yaml"
        )
    refuse_refit(config)
    if config.shape.rate_hz != RATE_HZ:
        raise ConfigError(
            f"{path}: shape.rate_hz {config.shape.rate_hz:g}: the evaluation on "
            f"recordings runs at {RATE_HZ:g} Hz; leave it out"
        )
    return config


def refuse_refit(config: TrainingConfig) -> None:
    """Refuse a run that also fits the validation recordings, on which runs are compared.

    Raises:
        ConfigError: ``data.refit`` is set.
    """
    if config.data.get("refit"):
        raise ConfigError(
            "training configuration: data.refit: also fits the validation recordings, on which an "
            "ablation compares; leave it out"
        )


def ablate(config: TrainingConfig) -> str:
    """Train and judge all runs, write ``ablation.md`` into ``config.out``; returns its text.

    Raises:
        KeyboardInterrupt: the run is saved; the same call continues.
        HriPredictError: a recording cannot be read, or a file cannot be written.
    """
    rows, asked = {}, runs(config)
    check_table(config.out)
    for name, run in asked.items():
        with told_to_stop() as stop:
            weights = trained(run, stop)
        rows[name] = judged(run, weights)
    text = table(rows)
    write_table(config.out, text)
    return text


def check_table(folder: Path) -> None:
    """Fail before hours of training if the runs and the table could not be written.

    Raises:
        ConfigError: they cannot be written.
    """
    check_writable(folder)
    path = folder / "ablation.md"
    if path.exists() and not path.is_file():
        raise ConfigError(f"{path}: cannot be written: not a file; remove it, or change --out")


def write_table(folder: Path, text: str) -> None:
    """Write ``ablation.md`` into ``folder``.

    Raises:
        ConfigError: it cannot be written.
    """
    path = folder / "ablation.md"
    remedy = "fix that and repeat the same command"
    with OsErrorAs(ConfigError, f"{path}: cannot be written", remedy):
        atomic_write(path, text.encode())
