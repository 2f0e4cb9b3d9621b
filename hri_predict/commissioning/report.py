"""The report of a validation: a model that is checked when read, and a hash of its whole content.

The hash contains no secret. It reveals damage and careless editing, but anyone can recompute it:
only signatures on paper, or a copy kept by others, reveal deliberate changes.
"""

import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import Field, JsonValue, ValidationError

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write, read_text
from hri_predict.base.settings import Settings
from hri_predict.commissioning.identity import Identity
from hri_predict.operation.evidence.chain import hash_of

REPORT = "report.json"
PAGE = "report.html"
FORMAT: Literal[1] = 1
MAX_CELLS = 40_000

Outcome = Literal["passed", "failed", "open", "skipped"]
"""``open``: done, but some checks have no result."""
Text = Annotated[str, Field(max_length=2000)]
Lines = Annotated[list[Text], Field(max_length=1000)]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9._-]*$", max_length=100)]
"""A file in the report's folder."""
Amount = Annotated[float, Field(ge=0, le=1e6)]
R = TypeVar("R")


class TouchedPoint(Settings):
    """A point touched by a hand: its position and the joint as seen; metres, room frame.

    ``error_m`` uses the configured pose of the sensor, ``residual_m`` the best-fitting pose.
    """

    point: list[float]
    seen: list[float]
    spread_m: Amount
    error_m: Amount
    residual_m: Amount


class Registration(Settings):
    """Fit of the sensor's pose to the touched points."""

    joint: str
    tolerance_m: Amount
    points: list[TouchedPoint]
    scale: Amount
    written: bool


class Times(Settings):
    """A distribution of times in milliseconds; ``bins`` holds counts per millisecond from 0."""

    count: int = Field(ge=0)
    p50_ms: Amount
    p99_ms: Amount
    max_ms: Amount
    bins: Annotated[list[int], Field(max_length=5000)] = []


class LinkEcho(Settings):
    """One link: the time a RobotState waited in the node, and the time until its echo returned.

    Attributes:
        link: its name.
        states, echoes: number of RobotStates received, and of different counters echoed.
        in_node: from the receipt of a RobotState until an advice with its echo was written.
        round_trip: from the sending of a RobotState until the advice with its echo, at the
            controller.
        measured_by: the party that measured the round trip.
        both_ways_ms: longest time on the link, both directions together; ``None``: not measured.
        allowed_ms: twice the delay of the link in the delay budget.
    """

    link: str
    states: int = Field(ge=0)
    echoes: int = Field(ge=0)
    in_node: Times | None
    round_trip: Times | None
    measured_by: Literal["controller", "integrator"] | None
    both_ways_ms: Amount | None
    allowed_ms: Amount


class Echo(Settings):
    """Reaction time through the echo of each link."""

    seconds: Amount
    links: list[LinkEcho]


class Stop(Settings):
    """One stop of one robot.

    Attributes:
        robot: its name.
        stated_m_s: the speed set for the test.
        speed_m_s: highest speed of the robot's fastest point after the command.
        total_s, total_m: from the command to standstill; ``None``: measured by the integrator, from
            the onset of braking.
        braking_s, braking_m: from the onset of braking to standstill.
        table_s, table_m: values of the stopping table at ``speed_m_s``.
        allowed_s, allowed_m: sum of the link, the controller's reaction and the table.
        resolution_s: longest time between two RobotStates during the stop.
        measured_by: the node, from RobotState, or the integrator.
        stood: whether the robot came to a standstill.
        passed: whether it stopped within the allowed time and distance, and braked as the table
            says.
    """

    robot: str
    stated_m_s: Amount
    speed_m_s: Amount
    total_s: Amount | None
    total_m: Amount | None
    braking_s: Amount
    braking_m: Amount
    table_s: Amount
    table_m: Amount
    allowed_s: Amount
    allowed_m: Amount
    resolution_s: Amount
    measured_by: Literal["node", "integrator"]
    stood: bool
    passed: bool


class Curve(Settings):
    """A robot's stopping table up to its highest speed, for the plot."""

    robot: str
    speed_m_s: list[Amount]
    time_s: list[Amount]
    distance_m: list[Amount]


class Stopping(Settings):
    """The stopping test."""

    stops: list[Stop]
    curves: list[Curve]


class GridResult(Settings):
    """Places on the floor where people were seen.

    Attributes:
        cell_m: side of a cell.
        origin: x, y of the lower left corner of cell 0, 0, metres, room.
        columns, rows: number of cells along x and y.
        area: cells to be covered, as ``row * columns + column``; ``outside``: those out of view.
        seen: cell -> number of ticks; ``lost``: cell -> number of people who vanished there.
    """

    cell_m: float = Field(gt=0, le=10)
    origin: Annotated[list[float], Field(min_length=2, max_length=2)]
    columns: int = Field(ge=1, le=MAX_CELLS)
    rows: int = Field(ge=1, le=MAX_CELLS)
    area: list[int]
    outside: list[int]
    seen: dict[int, int]
    lost: dict[int, int]

    @property
    def coverage(self) -> float:
        """Share of the area in which a person was seen; 0 for no area."""
        return len(set(self.area) & self.seen.keys()) / len(self.area) if self.area else 0.0


class RobotAdvice(Settings):
    """Advice to one robot during the walk, over all ticks."""

    robot: str
    ticks_at: dict[str, int]
    stops: int = Field(ge=0)
    first_stop_s: Amount | None
    least_separation_m: float | None
    least_limit_m_s: Amount
    mean_limit_m_s: Amount


class Walk(Settings):
    """Results of the walk test, from playing its recording."""

    recording: FileName
    recording_sha256: str
    advices: FileName
    advices_sha256: str
    seconds: Amount
    least_coverage: Amount
    exclude: list[JsonValue]
    grid: GridResult
    robots: list[RobotAdvice]
    people_lost: int = Field(ge=0)


class Step(Settings, Generic[R]):
    """One step, done or skipped.

    ``identity`` is the hash of configuration, files and versions at that time; ``why`` lists
    failures and checks without a result.
    """

    outcome: Outcome
    at: datetime
    by: Text = ""
    note: Text = ""
    why: Lines = []
    simulated: bool = False
    identity: str
    result: R | None = None


class Steps(Settings):
    """The steps that were done or skipped."""

    registration: Step[Registration] | None = None
    echo: Step[Echo] | None = None
    stopping: Step[Stopping] | None = None
    walk: Step[Walk] | None = None

    def named(self) -> Iterator[tuple[str, Step[Any] | None]]:
        """Each step with its name, in order."""
        for name in STEPS:
            yield name, getattr(self, name)


STEPS = tuple(Steps.model_fields)


class Signature(Settings):
    """The person responsible for the validation."""

    role: Text
    name: Text = ""
    date: Text = ""


class Report(Settings):
    """The whole report, without its own hash.

    ``less_safe`` has a line to be signed for each setting that is less safe than its default.
    """

    format: Literal[1] = FORMAT
    cell: Text
    config_path: str
    made: datetime
    identity: Identity
    steps: Steps
    less_safe: Lines = []
    notes: Lines = []
    signatures: Annotated[list[Signature], Field(max_length=50)] = []

    @property
    def simulated(self) -> bool:
        """Whether any step used simulated people or controllers."""
        return any(step is not None and step.simulated for _, step in self.steps.named())

    @property
    def open(self) -> list[str]:
        """One line for each step that has not *passed*."""
        now, found = self.identity.hash, []
        for name, step in self.steps.named():
            if step is None:
                found.append(f"{name}: not done")
            elif step.outcome == "skipped":
                found.append(f"{name}: skipped: {step.note}")
            elif step.identity != now:
                found.append(f"{name}: done before the cell was changed; repeat it")
            elif step.outcome != "passed":
                found.append(f"{name}: {step.outcome}: {'; '.join(step.why)}")
        return found

    @property
    def outcome(self) -> Outcome:
        """``failed`` if a step failed, ``passed`` if all passed for this configuration."""
        if any(step is not None and step.outcome == "failed" for _, step in self.steps.named()):
            return "failed"
        return "open" if self.open else "passed"


def to_data(report: Report) -> dict[str, Any]:
    """Return the report as JSON data, with its hash."""
    data = report.model_dump(mode="json")
    data["hash"] = hash_of(data)
    return data


def write_report(report: Report, folder: Path) -> str:
    """Write ``report.json``; return its hash.

    Raises:
        OSError: the file cannot be written.
    """
    data = to_data(report)
    atomic_write(folder / REPORT, (json.dumps(data, indent=1) + "\n").encode())
    return str(data["hash"])


def read_report(path: Path) -> tuple[Report, str]:
    """Read a report; return it and its hash.

    Raises:
        ConfigError: the file cannot be read, is not a report, or was changed after it was written.
    """
    data = _intact(path)
    content = {key: value for key, value in data.items() if key != "hash"}
    try:
        return Report.model_validate(content), data["hash"]
    except ValidationError as error:
        first = error.errors()[0]
        at = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"report {path}: {at}: {first['msg']}; it may be from another version: commission again"
        ) from error


def _intact(path: Path) -> dict[str, Any]:
    """Return the content of a report of any version, with its hash.

    Raises:
        ConfigError: the file cannot be read, is not a report, or was changed after it was written.
    """
    try:
        data = json.loads(read_text(path, "report"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"report {path}: not JSON; restore it, or commission again") from error
    if not isinstance(data, dict) or not isinstance(data.get("hash"), str):
        raise ConfigError(f"report {path}: not a report of hri-predict commission")
    try:
        found = hash_of(data)
    except (ValueError, RecursionError):
        found = ""
    if found != data["hash"]:
        raise ConfigError(
            f"report {path}: was changed after it was written: its content does not match its hash "
            f"{data['hash'][:12]}; restore it, or commission again"
        )
    return data


def find_report(path: Path) -> Path:
    """Return the report at a path: the file, or the newest report in a folder and its subfolders.

    Raises:
        ConfigError: there is no report, or one in the folder is damaged and may be the newest.
    """
    if not path.is_dir():
        if not path.is_file():
            raise ConfigError(f"report {path}: no such file; correct commissioning.report")
        return path
    there = _reports(path)
    if not there:
        raise ConfigError(f"report {path}: no {REPORT} in this folder or the folders in it")
    return max(there, key=_made)


def _reports(path: Path) -> list[Path]:
    """Return the reports in a folder and its subfolders, readable or not."""
    try:
        folders = [path, *(each for each in path.iterdir() if each.is_dir())]
        return [each / REPORT for each in folders if REPORT in os.listdir(each)]
    except OSError as error:  # a glob would leave out what it may not look at
        raise ConfigError(
            f"report {error.filename}: cannot be read: {error.strerror}; correct its permissions"
        ) from error


def _made(path: Path) -> tuple[datetime, float]:
    """Return when a report was made, and when its file was written.

    Raises:
        ConfigError: the report is damaged, so it cannot be said whether it is the newest.
    """
    try:
        made = datetime.fromisoformat(_intact(path)["made"])
        return made.astimezone(UTC), path.stat().st_mtime
    except ConfigError as error:
        raise ConfigError(f"{error}; it may be the newest of its folder") from error
    except (ValueError, KeyError, TypeError, OverflowError, OSError) as error:
        raise ConfigError(f"report {path}: does not say when it was made; move it away") from error
