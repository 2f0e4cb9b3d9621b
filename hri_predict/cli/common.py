"""Helpers for several commands: options for recordings, report files, tables on the screen."""

import contextlib
import hashlib
import importlib
import importlib.util
import json
import shlex
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console, JustifyMethod
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table as ScreenTable

from hri_predict.base.errors import ConfigError, RecordingError, nearest
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.base.installed import for_this_installation
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.lab.datasets.splits import in_pack, is_pack, split
from hri_predict.recording.format_table import ENDINGS, counts_in_folder
from hri_predict.recording.formats.openpose import frames_in

if TYPE_CHECKING:
    from hri_predict.contracts.predictor import PredictorSettings
    from hri_predict.lab.evaluation.table import Table

JointMapOption = Annotated[
    str | None,
    typer.Option(
        "--joint-map",
        help="Joint map for the recordings' joints: a YAML file of your own, or a shipped name. "
        "Default: chosen by the joints' names.",
    ),
]
TopicOption = Annotated[
    str | None,
    typer.Option(
        "--topic",
        help="Topic of the people in a ROS bag ('hri-predict topics' lists them). Default: the "
        "only one.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print only JSON.")]
JobsOption = Annotated[
    int | None,
    typer.Option("--jobs", min=1, max=256, help="Number of processes on this machine."),
]
ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        help="Use the workers of this Dask scheduler, such as tcp://127.0.0.1:8786. "
        "Connect only to a scheduler of your own: any program that reaches it can run code.",
    ),
]
CalibrationsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--calibration",
        help="Calibration of a predictor, used for the predictor that it was made for. Repeatable.",
        show_default="the shipped ones",
    ),
]


def without_effect(flags: Mapping[str, Any], where: str) -> None:
    """Reject flags that would be ignored, because the user expects an effect."""
    given = [flag for flag, value in flags.items() if value is not None]
    if len(given) == 1:
        raise ConfigError(f"{given[0]}: has no effect {where}; leave it out")
    if given:
        raise ConfigError(f"{', '.join(given)}: have no effect {where}; leave them out")


def processes(jobs: int | None, cluster: str | None, default: int = 1) -> int:
    """Number of worker processes on this machine; with a cluster, its workers are used instead."""
    if cluster is not None:
        without_effect({"--jobs": jobs}, "with --cluster")
    return default if jobs is None else jobs


def predictor_settings(
    name: str,
    weights: Path | None,
    rate_hz: float,
    horizon_s: float,
    *,
    changes: Mapping[str, Any] | None = None,
) -> "PredictorSettings":
    """Return a predictor's settings from ``--predictor``, ``--weights`` and other ``changes``.

    Raises:
        ConfigError: the predictor does not exist, it has no weights, or its horizon is too short.
    """
    model = registry.predictor_settings(name)
    asked: dict[str, Any] = {"name": name, "rate_hz": rate_hz, "horizon_s": horizon_s}
    asked |= changes or {}
    if weights is not None:
        if "weights" not in model.model_fields:
            raise ConfigError(f"--weights: {name} does not use weights; leave it out")
        asked["weights"] = str(weights)
    return validated(model, asked, f"--predictor {name}")


def own_map(joint_map: str | None) -> JointMap | None:
    """The map of ``--joint-map``.

    Raises:
        ConfigError: the map does not exist, or its file is wrong.
    """
    return None if joint_map is None else load_joint_map(joint_map)


def map_path(joint_map: str) -> str:
    """Return a joint map's name, or its file's absolute path, for a configuration."""
    own_map(joint_map)  # tell a mistake in the flag's own words
    return str(Path(joint_map).absolute()) if joint_map.endswith(YAML_ENDINGS) else joint_map


def check_writable(out: Path) -> None:
    """Fail now rather than after minutes of evaluation."""
    with writing(f"--out {out}", "name another folder"):
        out.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=out).close()


@contextlib.contextmanager
def writing(what: str, remedy: str) -> Iterator[None]:
    """Report in one line that a file or folder named by the user cannot be written.

    Raises:
        ConfigError: the body raised ``OSError``.
    """
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{what}: cannot be written: {error.strerror}; {remedy}") from error


def check_out(out: Path) -> None:
    """Fail before a long calculation if ``--out`` is not writable; say if plots will be missing."""
    check_writable(out)
    try:
        need_plots()
    except ConfigError as error:
        warn(f"--out {out}: gets tables but no plots: {error}")


def need_plots() -> None:
    """Fail if plots, which are the whole purpose, could not be drawn.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    importlib.import_module("hri_predict.base.figures")


def need_extra(package: str, extra: str) -> None:
    """Fail if a command's optional package is not installed.

    Raises:
        ConfigError: names the extra that brings the package.
    """
    if importlib.util.find_spec(package) is None:
        raise ConfigError(
            f"this needs a package that is not installed: {package}; "
            f"install it with: pip install 'hri-predict[{extra}]'"
        )


def recordings(entry: Path, use: str | None, default: str = "test") -> list[Path]:
    """The recordings that ``--data`` names: a file, a split of the data pack, or a whole folder.

    With a split, a folder inside the pack gives the recordings of the split in that folder.

    Raises:
        ConfigError: the file does not exist, or the folder has no recording.
    """
    if not entry.exists():
        raise ConfigError(f"--data {entry}: no such file or folder; check the path")
    if entry.is_file() or frames_in(entry):
        return [entry]
    if is_pack(entry):
        return [in_pack(entry, name) for name in split(use or default)]
    pack = _pack_around(entry)
    if use is not None and pack is not None:
        return _below(entry, pack, use)
    named = sorted(p for p in entry.rglob("*") if p.suffix.lower() in ENDINGS)
    found = [path for path in named if _is_recording(path)]
    if not found:
        raise ConfigError(
            f"--data {entry}: holds no recording ({', '.join(ENDINGS)}); give another folder"
        )
    return found


def _is_recording(path: Path) -> bool:
    """Whether a file in a folder is a recording; the content of .csv and .pkl files decides."""
    try:
        return counts_in_folder(path)
    except RecordingError as error:
        warn(f"{error}; left out")
    except OSError as error:
        warn(f"recording {path}: cannot be read: {error.strerror}; left out")
    return False


def _below(entry: Path, pack: Path, use: str) -> list[Path]:
    found = [pack / f"{name}.npz" for name in split(use)]
    found = [path for path in found if entry.resolve() in path.parents]
    if not found:
        raise ConfigError(f"--data {entry}: no recording of the split {use}; name another")
    return found


def _pack_around(entry: Path) -> Path | None:
    """Return the data pack that contains a folder."""
    around = entry.resolve().parents
    return next((folder for folder in around if (folder / "cmu_mocap" / "test").is_dir()), None)


def files(data: Sequence[Path], use: str | None, default: str = "test") -> list[Path]:
    """Return all recordings that the user named, each once; from a data pack, those of a split.

    Raises:
        ConfigError: see ``recordings``; one is named twice, or no ``--data`` has splits.
    """
    found = [path for entry in data for path in recordings(entry, use, default)]
    known: set[Path] = set()
    for path in found:
        if path.resolve() in known:
            raise ConfigError(f"--data: {path} is named twice and would count double; name it once")
        known.add(path.resolve())
    _refuse_copies(found)
    if use is not None and not any(_has_splits(entry) for entry in data):
        raise ConfigError(
            f"--split {use}: has no effect on {data[0]}: only the data pack has splits; leave it "
            f"out"
        )
    return found


def _has_splits(entry: Path) -> bool:
    return entry.is_dir() and (is_pack(entry) or _pack_around(entry) is not None)


def _refuse_copies(found: Sequence[Path]) -> None:
    """Reject a copy of a recording, which must not count as a second one."""
    seen: dict[str, Path] = {}
    for path in found:
        digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else str(path)
        if digest in seen:
            raise ConfigError(f"--data: {path} is a copy of {seen[digest]}; leave one of them out")
        seen[digest] = path


def progress() -> Progress:
    """A progress bar on standard error; nothing if that is not a terminal."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def stage(bar: Progress, task: TaskID, what: str) -> None:
    """Name the stage of a long command, on the bar or, without a terminal, in a line."""
    bar.update(task, description=what)
    if bar.disable:
        print(what, file=sys.stderr, flush=True)


def result(
    as_json: bool, data: Mapping[str, Any], tables: "Sequence[Table]", notes: Sequence[str] = ()
) -> None:
    """Print a result: JSON alone, or tables and notes."""
    if as_json:
        print(json.dumps(data))
    else:
        show(tables, notes)


def show(tables: "Sequence[Table]", notes: Sequence[str]) -> None:
    """Print tables, then notes."""
    console = Console()
    for table in tables:
        console.print(_fitting(table, console))
    for note in notes:
        console.print(f"- {note}", markup=False, highlight=False, soft_wrap=True)  # to be pasted


def _fitting(table: "Table", console: Console) -> ScreenTable:
    """Return the table in the best form for the width: unchanged, transposed or wrapped."""
    rows = (table.columns, *table.rows)
    for turned in (rows, tuple(zip(*rows, strict=True))):
        needed = [max(map(len, column)) for column in zip(*turned, strict=True)]
        if sum(needed) <= _room(console, len(needed)):
            return _screen_table(table.title, turned, needed)
    widths = wrapped_widths(rows, _room(console, len(table.columns)))
    return _screen_table(table.title, rows, widths)


def _room(console: Console, columns: int) -> int:
    """Width left for text: padding and borders take two characters per column, plus one."""
    return console.width - 2 * columns - 1


def wrapped_widths(rows: Sequence[Sequence[str]], room: int) -> list[int | None]:
    """Return a width for each column, at most ``room`` in total (``None``: left to rich).

    No word is broken if every column's longest word fits; spare width goes to the longest texts.
    """
    columns = list(zip(*rows, strict=True))
    least = [max(len(word) for cell in c for word in cell.split() or [""]) for c in columns]
    more = [max(map(len, c)) - n for c, n in zip(columns, least, strict=True)]
    spare = room - sum(least)
    if spare < 0:
        return [None] * len(columns)  # rich folds words as it must
    spare = min(spare, sum(more))
    return [n + spare * m // max(1, sum(more)) for n, m in zip(least, more, strict=True)]


def _screen_table(
    title: str, rows: Sequence[Sequence[str]], widths: Sequence[int | None]
) -> ScreenTable:
    shown = ScreenTable(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for k, (heading, width) in enumerate(zip(rows[0], widths, strict=True)):
        justify: JustifyMethod = "right" if k else "left"
        shown.add_column(heading, justify=justify, width=width, overflow="fold")
    for row in rows[1:]:
        shown.add_row(*row)
    return shown


def tell(files: Sequence[Path]) -> None:
    """Report the files written."""
    print("written: " + ", ".join(map(str, files)), file=sys.stderr)


def warn(line: str) -> None:
    """Print a note for the user on standard error, and continue."""
    print(f"warning: {for_this_installation(line)}", file=sys.stderr)


def command() -> str:
    """Return the command line as given by the user, for the report."""
    return shlex.join(["hri-predict", *sys.argv[1:]])


def one_of(flag: str, value: str, known: Sequence[str]) -> Any:
    """Return ``value`` if it is known; otherwise fail with the list of known values."""
    if value not in known:
        raise ConfigError(f"{flag} {value}: unknown{nearest(value, known)} ({', '.join(known)})")
    return value
