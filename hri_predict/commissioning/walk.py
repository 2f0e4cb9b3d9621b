"""The walk test: a person walks through the cell while the node records.

The grid and the advice come from playing the recording, not from the live run, so a later version
or configuration can be compared on exactly the same input.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import JsonValue

from hri_predict.base.errors import ConfigError, OsErrorAs, RecordingError
from hri_predict.commissioning.bench import quiet
from hri_predict.commissioning.playback import AdviceRow, Played, grid_of, play, write_rows
from hri_predict.commissioning.report import RobotAdvice, Walk
from hri_predict.operation.evidence.chain import file_hash
from hri_predict.run.config import Config
from hri_predict.run.session import Options
from hri_predict.run.session import run as run_session

RECORDING = "walk.mcap"
ADVICES = "walk-advices.jsonl"
LEAST_COVERAGE = 0.9
"""Default of the share of the floor where people have to be seen."""
MOST_UNKNOWN = 0.5
"""Maximum share of a walk with *unknown* advice; with more, too little was tested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkPlan:
    """Plan of a walk: duration in seconds, side of a grid cell in metres, minimum coverage as a
    share, and polygons where no person can stand.

    ``shadow``: links send *unknown*, so that no robot moves. ``virtual``: run with simulated people
    and controllers, as fast as possible.
    """

    seconds: float
    cell_m: float
    least_coverage: float
    exclude: Sequence[JsonValue] = ()
    shadow: bool = True
    virtual: bool = False


def walk(config: Config, live: Config, plan: WalkPlan, folder: Path) -> Walk:
    """Record the walk of ``live`` and judge it with ``config``.

    Args:
        config: the cell.
        live: the cell to record, with simulated people and controllers if requested.
        plan: see ``WalkPlan``.
        folder: receives the recording and the advice; those of an earlier walk are replaced.

    Raises:
        HriPredictError: the run cannot start, or the recording is incomplete.
    """
    grid = grid_of(config, plan.cell_m, plan.exclude)  # a mistake shows before anybody walks
    recording, advices = folder / RECORDING, folder / ADVICES
    begun = folder / f"new-{RECORDING}"  # an earlier walk stays until this one is whole
    silent = quiet(live)
    silent = replace(silent, path=config.path, text=config.text)
    options = Options(
        factor=None if plan.virtual else 1.0,
        duration_s=plan.seconds,
        record=begun,
        overwrite=True,
        shadow=plan.shadow,
    )
    summary = run_session(silent, options)
    told = summary.recording or {}
    if told.get("error") or told.get("dropped"):
        raise RecordingError(
            f"recording {begun}: incomplete ({told.get('error') or 'the disk was too slow'}); "
            f"free some room and walk again"
        )
    played = play(config, begun, grid)
    with OsErrorAs(ConfigError, f"--out {folder}: cannot be written"):
        write_rows(advices, played.rows)
        begun.replace(recording)
    return Walk(
        recording=RECORDING,
        recording_sha256=file_hash(recording),
        advices=ADVICES,
        advices_sha256=file_hash(advices),
        seconds=played.seconds,
        least_coverage=plan.least_coverage,
        exclude=list(plan.exclude),
        grid=played.grid,
        robots=advice_by_robot(played),
        people_lost=played.people_lost,
    )


def judge_walk(result: Walk) -> tuple[list[str], list[str]]:
    """Return failures and checks without a result, one line each."""
    failed, missing = [], []
    coverage = result.grid.coverage
    if coverage < result.least_coverage:
        failed.append(
            f"people were seen in {100 * coverage:.0f} % of the floor around the robots; "
            f"the minimum is {100 * result.least_coverage:.0f} %: walk where the grid is white, "
            f"or check the sensor if you walked there"
        )
    if result.people_lost:
        failed.append(
            f"people vanished in view {result.people_lost} times; see the crosses in the grid"
        )
    if not result.robots or any(not robot.ticks_at for robot in result.robots):
        missing.append("the recording gave no advice; walk for longer")
    for robot in result.robots:
        blind = sum(robot.ticks_at.get(level, 0) for level in ("unknown", "fault"))
        share = blind / max(1, sum(robot.ticks_at.values()))
        if share > MOST_UNKNOWN:
            missing.append(
                f"robot {robot.robot}: advice was unknown {100 * share:.0f} % of the time, so "
                f"little was tested; check that its controller is on and scenes arrive in time"
            )
    return failed, missing


def less_safe_walk(result: Walk) -> list[str]:
    """Return one line if less of the floor was required than by default."""
    if result.least_coverage >= LEAST_COVERAGE:
        return []
    return [
        f"walk.least_coverage: {result.least_coverage:g} (default {LEAST_COVERAGE:g}): the walk "
        f"test passes although no person was seen in up to "
        f"{100 * (1 - result.least_coverage):.0f} % of the floor around the robots"
    ]


def advice_by_robot(played: Played) -> list[RobotAdvice]:
    """Return levels, stops and extremes of each robot's advice."""
    by_robot: dict[str, list[AdviceRow]] = {}
    for row in played.rows:
        by_robot.setdefault(row.robot, []).append(row)
    return [_of_robot(robot, rows) for robot, rows in by_robot.items()]


def _of_robot(robot: str, rows: Sequence[AdviceRow]) -> RobotAdvice:
    at: dict[str, int] = {}
    for row in rows:
        at[row.level] = at.get(row.level, 0) + 1
    levels = ["", *(row.level for row in rows)]
    stops = [row for was, row in zip(levels, rows, strict=False) if row.level == "stop" != was]
    near = [row.separation_m for row in rows if row.separation_m is not None]
    limits = [row.limit_m_s for row in rows]
    return RobotAdvice(
        robot=robot,
        ticks_at=at,
        stops=len(stops),
        first_stop_s=stops[0].time_s if stops else None,
        least_separation_m=min(near, default=None),
        least_limit_m_s=min(limits),
        mean_limit_m_s=round(sum(limits) / len(limits), 4),
    )
