"""Plays a recorded walk test through the node on the virtual clock, so results are repeatable.

The recording holds every scene as received and every RobotState. No link is opened.
"""

import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.files import atomic_write
from hri_predict.base.geometry import in_polygon
from hri_predict.base.settings import Region
from hri_predict.commissioning.bench import quiet
from hri_predict.commissioning.report import MAX_CELLS, GridResult
from hri_predict.contracts.source import SourceSettings
from hri_predict.node.listeners import Tick
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Advice, Level
from hri_predict.risk.robot_constants import worst_distance
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.session import Options, View
from hri_predict.run.session import run as run_session

# -- the floor in cells: where people were seen, where they vanished, and where no person was ------

BASE_M = 0.4
"""Minimum distance at which a person can stand from a robot's base."""


class Grid:
    """Floor cells around the robots: within reach plus protective separation distance of a robot.

    Args:
        cell_m: side of a cell.
        circles: (R, 3) x, y and radius of each robot's circle, metres, room frame.
        view: space that the sensor sees; cells beyond it count as ``outside``. ``None``:
            everything.
        exclude: polygons (N, 2) where no person can stand, such as machines and walls.

    Raises:
        ConfigError: there would be more than ``MAX_CELLS`` cells, or none.
    """

    def __init__(
        self,
        cell_m: float,
        circles: Floats,
        *,
        view: Region | None = None,
        exclude: Sequence[Floats] = (),
    ) -> None:
        self.cell_m = cell_m
        low = np.floor((circles[:, :2] - circles[:, 2:]).min(axis=0) / cell_m) * cell_m
        high = (circles[:, :2] + circles[:, 2:]).max(axis=0)
        columns, rows = (max(1, math.ceil(v)) for v in (high - low) / cell_m)
        if columns * rows > MAX_CELLS:
            raise ConfigError(
                f"walk.cell_m {cell_m:g}: {columns * rows} cells; at most {MAX_CELLS}: increase it"
            )
        self.origin, self.columns, self.rows = low, columns, rows
        middles = self._middles()
        away = np.linalg.norm(middles[:, None] - circles[:, :2], axis=-1)
        inside = (away <= circles[:, 2]).any(axis=1) & (away >= BASE_M).all(axis=1)
        for polygon in exclude:
            inside &= ~in_polygon(middles, polygon)
        seen = np.ones(len(middles), np.bool_)
        if view is not None:
            seen = in_polygon(middles, np.asarray(view.polygon, np.float64))
        self._area = np.flatnonzero(inside & seen)
        self._outside = np.flatnonzero(inside & ~seen)
        if not len(self._area):
            raise ConfigError(
                "walk: no cell is left around the robots; check source.field_of_view and "
                "walk.exclude"
            )
        self._seen: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()

    def see(self, positions: Floats, observed: Bools) -> None:
        """Note a person in view: joints (J, 3) in the room frame, and (J,) whether observed."""
        for cell in set(self._cells(positions[observed, :2])):
            self._seen[cell] += 1

    def lose(self, positions: Floats) -> None:
        """Note a person who vanished, last seen with joints (J, 3); NaN where never seen."""
        known = positions[np.isfinite(positions).all(axis=1), :2]
        if len(known):
            for cell in self._cells(known.mean(axis=0)[None]):
                self._lost[cell] += 1

    def result(self) -> GridResult:
        """Return the cells seen so far."""
        return GridResult(
            cell_m=self.cell_m,
            origin=[round(float(v), 4) for v in self.origin],
            columns=self.columns,
            rows=self.rows,
            area=self._area.tolist(),
            outside=self._outside.tolist(),
            seen=dict(sorted(self._seen.items())),
            lost=dict(sorted(self._lost.items())),
        )

    def _middles(self) -> Floats:
        """(columns * rows, 2) centre of each cell."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        middles: Floats = (
            self.origin + (np.column_stack([x.ravel(), y.ravel()]) + 0.5) * self.cell_m
        )
        return middles

    def _cells(self, points: Floats) -> list[int]:
        """Return the cells of (N, 2) points; points outside the grid have none."""
        finite = points[np.isfinite(points).all(axis=1)]
        place = np.floor((finite - self.origin) / self.cell_m)
        there = ((place >= 0) & (place < [self.columns, self.rows])).all(axis=1)
        place = place[there].astype(int)
        found: list[int] = (place[:, 1] * self.columns + place[:, 0]).tolist()
        return found


# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AdviceRow:
    """Advice to one robot at one tick; metres and m/s, rounded as on the wire or finer.

    ``time_s`` counts from the first tick.
    """

    time_s: float
    robot: str
    level: str
    reason: str
    separation_m: float | None
    predicted_m: float | None
    limit_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """Result of a recording: every advice, the grid, and the number of people who vanished."""

    rows: list[AdviceRow]
    grid: GridResult
    people_lost: int
    seconds: float


class _Watch(View):
    """Records the advice of a run and where people were seen."""

    def __init__(self, robots: Sequence[str], grid: Grid) -> None:
        self._robots, self._grid = robots, grid
        self._first_ns: int | None = None
        self._lost: set[tuple[int, int]] = set()
        self.rows: list[AdviceRow] = []
        self.last_s = 0.0

    @property
    def people_lost(self) -> int:
        """Number of people who vanished."""
        return len(self._lost)

    def on_tick(self, tick: Tick) -> None:
        """Record one tick; skip messages at start and end, which have no snapshot."""
        if tick.snapshot is None:
            return
        if self._first_ns is None:
            self._first_ns = tick.now_ns
        self.last_s = round((tick.now_ns - self._first_ns) * 1e-9, 6)
        self.rows += [_row(self.last_s, self._robots, advice) for advice in tick.advices]
        self._look(tick.snapshot)

    def _look(self, snapshot: PeopleSnapshot) -> None:
        if not snapshot.reasons:  # a scene that cannot be trusted shows nobody
            for p in range(len(snapshot.ids)):
                self._grid.see(snapshot.history[p, -1], snapshot.measured[p, -1])
        for person in snapshot.lost:
            who = person.id, person.last_seen_ns
            if who not in self._lost:
                self._lost.add(who)
                self._grid.lose(person.positions)


def _row(time_s: float, robots: Sequence[str], advice: Advice) -> AdviceRow:
    return AdviceRow(
        time_s=time_s,
        robot=robots[advice.robot],
        level=advice.level.name.lower(),
        reason=advice.reason.name.lower(),
        separation_m=_rounded(advice.separation_m),
        predicted_m=_rounded(advice.predicted_separation_m),
        limit_m_s=_rounded(advice.speed_limit_m_s) or 0.0,
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else round(float(value), 4)


def circles_of(config: Config) -> Floats:
    """(R, 3) x, y and radius of each robot's reach plus its protective separation distance.

    Includes the largest margin of any body region, which the advice adds for that region.

    Raises:
        ConfigError: the base of a robot moves.
    """
    budget = assemble.build_budget(config, assemble.build_source(config))
    margin_m = max(config.node.risk.region_margins_m.values(), default=0.0)
    circles = []
    for settings, model in zip(config.node.robots, assemble.build_robots(config), strict=True):
        needed_m = worst_distance(config.node.risk, settings, model, budget).total
        if model.base is None:
            raise ConfigError(
                f"the walk test needs the place of each robot, but the base of {model.name} moves; "
                f"skip the step (--skip walk=WHY), and test its area manually"
            )
        circles.append([*model.base[:2], model.reach_m + needed_m + margin_m])
    return np.array(circles)


def grid_of(config: Config, cell_m: float, exclude: Sequence[JsonValue]) -> Grid:
    """Return the floor around the robots of a cell; see ``Grid``.

    Raises:
        ConfigError: too many cells, or none.
    """
    return Grid(
        cell_m,
        circles_of(config),
        view=config.source.field_of_view,
        exclude=[np.array(polygon, np.float64) for polygon in exclude],
    )


def play(config: Config, recording: Path, grid: Grid) -> Played:
    """Play a recording through the node with this configuration.

    Raises:
        HriPredictError: the recording cannot be played; one line with the remedy.
    """
    watch = _Watch([robot.name for robot in config.node.robots], grid)
    run_session(_playing(config, recording), Options(factor=None, until_exhausted=True, view=watch))
    return Played(
        rows=watch.rows, grid=grid.result(), people_lost=watch.people_lost, seconds=watch.last_s
    )


REPLAYED = SourceSettings.model_fields.keys() - {"kind", "faults", "room_from_source"}
"""Keys of ``source`` that also take effect when a recording is played; its scenes are in the room
frame, so the pose of the sensor has none.
"""


def _playing(config: Config, recording: Path) -> Config:
    """Return the configuration with the recording as its source, and without outputs and links."""
    source = config.source.model_dump(include={*REPLAYED, "room_from_source"})
    # what the source said by itself, the recording cannot: its rate is the recorded one
    if source["stale_s"] is None:
        rate_hz = assemble.build_source(config, with_faults=False).rate_hz
        source["stale_s"] = config.source.stale_after_s(rate_hz)
    source |= {"kind": "recording", "path": str(recording.absolute())}
    silent = quiet(config)
    links = tuple(link.model_copy(update={"faults": []}) for link in silent.links)
    return replace(silent, links=links).with_source(source).without_links()


def write_rows(path: Path, rows: Sequence[AdviceRow]) -> None:
    """Write advice as JSON lines.

    Raises:
        OSError: the file cannot be written.
    """
    lines = (json.dumps(asdict(row), separators=(",", ":")) for row in rows)
    atomic_write(path, "".join(f"{line}\n" for line in lines).encode())


def read_rows(path: Path) -> list[AdviceRow]:
    """Read what ``write_rows`` wrote.

    Raises:
        RecordingError: the file cannot be read.
    """
    try:
        return list(_parsed(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise RecordingError(f"advices {path}: cannot be read ({error}); walk again") from error


def _parsed(text: str) -> Iterator[AdviceRow]:
    for line in text.splitlines():
        row = AdviceRow(**json.loads(line))
        if row.level.upper() not in Level.__members__:
            raise ValueError(f"no level {row.level}")
        yield row
