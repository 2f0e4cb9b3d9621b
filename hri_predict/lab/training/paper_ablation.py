"""The papers' ablations: each network with one of its paper's switches at a time.

``hri-predict ablate stb --data DIR --out FOLDER`` trains the paper's network
(``configs/training/papers``) once for each row at a small budget, and shows our validation errors
next to the paper's. The printed figures are for Human3.6M and complete trainings: compare the
direction of an effect, not its digits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.lab.training.ablation import check_table, refuse_refit, trained, write_table
from hri_predict.lab.training.config import TrainingConfig, load_training_config
from hri_predict.lab.training.stopping import told_to_stop
from hri_predict.predictors.neural.weights import read_header

SMALL = [
    "train.epochs=10", "train.windows_per_epoch=1024", "train.learning_rate=1.0e-3",
    "train.schedule=cosine", "train.warmup=0.05", "train.ema_decay=0.99", "data.balanced=true",
    "data.actions=[]",
]  # fmt: skip
"""The budget of a row, instead of the paper's schedule."""
_FRAMES = {80: 1, 320: 7, 400: 9}  # nominal milliseconds -> future frame


@dataclass(frozen=True, slots=True)
class Switches:
    """A paper's tables of ablation.

    Attributes:
        printed: the tables' names, and the meaning of the printed figures.
        rows: name -> options that differ, and the printed figure.
    """

    printed: str
    rows: Mapping[str, tuple[dict[str, Any], float]]


PAPERS: Mapping[str, Switches] = {
    "trajectorycnn": Switches(
        "Tables VI to VIII, 400 ms, mm",
        {
            "whole": ({}, 59.7),
            "w/o C-ST #1": ({"kernel": "1x1"}, 81.6),
            "w/o C-ST #2": ({"kernel": "1x3"}, 69.4),
            "w/o GTC": ({"layout": "pose"}, 60.7),
            "w/o DLG": ({"residual": False}, 79.8),
        },
    ),
    "stb": Switches(
        "Table 5, average of 80 to 400 ms, mm",
        {
            "whole": ({}, 28.96),
            "w/o distillation": ({"distillation": 0.0}, 29.58),
            "temporal branch": ({"branches": "temporal"}, 30.24),
            "spatial branch": ({"branches": "spatial"}, 29.68),
            "w/o increments": ({"inputs": "positions"}, 34.06),
        },
    ),
    "auxformer": Switches(
        "Tables 5 and 7, 400 ms, mm",
        {
            "whole": ({}, 54.1),
            "w/o mask": ({"masking": False}, 55.0),
            "w/o denoise": ({"denoising": False}, 54.8),
            "prediction alone": ({"masking": False, "denoising": False}, 57.0),
            "w/o OSTA": ({"observed_attention": False}, 57.3),
            "separate attention": ({"order": "separate"}, 55.1),
        },
    ),
    "kdformer": Switches(
        "Tables 3 to 5, 400 ms, rad of Euler angles",
        {
            "whole": ({}, 1.01),
            "K-Former": ({"inputs": "kinematic"}, 1.04),
            "D-Former": ({"inputs": "dynamic"}, 1.05),
            "absolute embedding": ({"position_embedding": "absolute"}, 1.05),
            "w/o QT": ({"quaternion_loss": False}, 1.10),
            "autoregressive": ({"decoding": "autoregressive"}, 1.08),
            "3 parts": ({"body_parts": 3}, 1.07),
            "7 parts": ({"body_parts": 7}, 1.05),
            "parallel fusion": ({"fusion": "parallel"}, 1.06),
            "flat fusion": ({"fusion": "flat"}, 1.05),
        },
    ),
    "sinn": Switches(
        "Table 4, eating at 400 ms, mm; without SRE: its substitute is not stated",
        {
            "whole": ({}, 23.7),
            "w/o SRE, displacements": ({"representation": "displacement"}, 55.3),
            "w/o SRE, positions": ({"representation": "position"}, 55.3),
            "w/o STA": ({"aggregation": False}, 45.2),
        },
    ),
}


def configurations(
    paper: str, data: str, out: Path, changes: list[str]
) -> dict[str, TrainingConfig]:
    """The runs of a paper by row, each in a folder of its own below ``out``.

    Raises:
        ConfigError: a change is wrong, or would leave nothing to compare.
    """
    path = data_path("training", "papers", f"{paper}.yaml")
    config = load_training_config(path, [*SMALL, *changes])
    refuse_refit(config)
    least = 1 + max(_FRAMES.values())
    if config.shape.horizon_steps < least:
        raise ConfigError(
            f"training configuration: shape.horizon_steps {config.shape.horizon_steps}: the table "
            f"shows {max(_FRAMES)} ms; give {least} or more"
        )
    config.data["root"] = data
    return {
        name: config.model_copy(
            update={
                "options": config.options | differs,
                "out": out / name.replace("/", "").replace(" ", "_"),
            }
        )
        for name, (differs, _) in PAPERS[paper].rows.items()
    }


def ablate(paper: str, data: str, out: Path, changes: list[str]) -> str:
    """Train all rows, write ``ablation.md`` into ``out``; returns its text.

    Raises:
        KeyboardInterrupt: the run is saved; the same call continues.
        HriPredictError: a recording cannot be read, or a file cannot be written.
    """
    asked = configurations(paper, data, out, changes)
    check_table(out)
    switches, (first, *_) = PAPERS[paper], asked.values()
    heads = [f"{ms} ms" for ms in _FRAMES]
    lines = [
        f"{first.train.epochs} epochs of {first.train.windows_per_epoch} windows, seed "
        f"{first.train.seed}; ours: {first.error_unit} on the validation recordings of CMU. "
        f"Printed: Human3.6M, {switches.printed}.\n",
        f"| {paper} | {' | '.join(heads)} | printed |",
        "|---|" + "---:|" * (len(heads) + 1),
    ]
    for name, config in asked.items():
        with told_to_stop() as stop:
            weights = trained(config, stop)
        found = read_header(weights).card["validation"]["horizon_mm"]
        printed = switches.rows[name][1]
        cells = [f"{found[frame]:.1f}" for frame in _FRAMES.values()]
        cells.append(f"{printed:g}")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    text = "\n".join(lines) + "\n"
    write_table(out, text)
    return text
