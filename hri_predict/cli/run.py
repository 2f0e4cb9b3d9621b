"""``demo``, ``run`` and ``replay``: run the node."""

import faulthandler
import json
import math
import sys
import threading
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.commissioned import (
    commissioning_facts,
    commissioning_lines,
    is_as_commissioned,
)
from hri_predict.cli.check.notes import delay_notes
from hri_predict.cli.common import JointMapOption, TopicOption, map_path
from hri_predict.cli.screens.options import (
    Host,
    Operator,
    OperatorUrl,
    Viewer,
    addresses,
    how_to_see,
    screens,
)
from hri_predict.cli.screens.together import Together
from hri_predict.cli.terminal.view import TerminalView
from hri_predict.contracts.source import SourceSettings
from hri_predict.operation.monitoring.summary import Summary
from hri_predict.operation.service import logs
from hri_predict.operation.service.notify import Notifier, has_terminal
from hri_predict.recording.format_table import ANY_ENDING
from hri_predict.recording.ros.about import is_in_room
from hri_predict.recording.ros.bag import BAG_ENDING, file_of, is_ros_mcap
from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import with_predictor
from hri_predict.run.config import Config
from hri_predict.run.coverage import unused_coverage
from hri_predict.run.session import Options
from hri_predict.run.session import run as run_session
from hri_predict.viewing.feed import Feed, has_viser
from hri_predict.viewing.screen import LOOPBACK

Json = Annotated[bool, typer.Option("--json", help="Print only the summary, as JSON.")]
Record = Annotated[
    Path | None, typer.Option(help="Record into this MCAP file, or into this folder.")
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace the file of --record if it exists.")
]
Duration = Annotated[float | None, typer.Option(help="Stop after this many seconds.")]
Speed = Annotated[str, typer.Option(help="1 = real time, 2 = twice as fast, max = no waiting.")]
Predictor = Annotated[
    str | None, typer.Option(help="Use this predictor instead: NAME or NAME=WEIGHTS.")
]
Shadow = Annotated[
    bool,
    typer.Option("--shadow", help="Compute and show everything, but send 'unknown' on the links."),
]
State = Annotated[
    Path | None,
    typer.Option(
        help="Keep latches and lost people in this file; default for run: the "
        "configuration's 'state'."
    ),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        help="Inject a fault: kind[@start[+seconds]][:key=value]. Without a time, it lasts from "
        "the first to the last scene. Repeatable.",
    ),
]

DEMO_S = 24.0  # the person comes, reaches out and leaves
MAX_SECONDS = 1e9  # 31 years: far beyond it a float cannot count nanoseconds


class LogFormat(StrEnum):
    """See ``LogSettings.format``."""

    TEXT = "text"
    JSON = "json"


def demo(
    *,
    speed: Speed = "1",
    record: Record = None,
    overwrite: Overwrite = False,
    fault: Faults = None,
    viewer: Viewer = None,
    operator: Operator = None,
    viewer_host: Host = LOOPBACK,
    as_json: Json = False,
) -> None:
    """Run a demo without hardware: a person approaches a robot, and two controllers obey.

    In a terminal, it also shows the 3D view if that is installed.

    Example: hri-predict demo
    """
    if viewer is None and has_viser() and _in_terminal(as_json, _factor(speed)):
        viewer = 0
    config = _with_faults(configuration.load(configuration.shipped("demo.yaml")), fault)
    options = Options(factor=_factor(speed), duration_s=DEMO_S, record=record, overwrite=overwrite)
    go(config, options, as_json, screens(viewer, operator, viewer_host))
    if not as_json:
        print(how_to_see(), file=sys.stderr)


def run(
    *,
    config: Annotated[Path, typer.Argument(help="The node's YAML configuration.")],
    record: Record = None,
    overwrite: Overwrite = False,
    duration: Duration = None,
    shadow: Shadow = False,
    state: State = None,
    log_format: Annotated[
        LogFormat | None, typer.Option(help="Format of the log; default: the configuration's.")
    ] = None,
    viewer: Viewer = None,
    operator: Operator = None,
    operator_url: OperatorUrl = None,
    viewer_host: Host = LOOPBACK,
    as_json: Json = False,
) -> None:
    """Run the node until SIGINT or SIGTERM; it then announces its shutdown to the controllers.

    As a service, or without a terminal, SIGHUP reads the configuration again.

    Example: hri-predict run cell.yaml --shadow
    """
    _positive(duration, "--duration")
    notifier = Notifier.from_environ()
    if notifier is not None:  # the watchdog's SIGABRT then says where each thread hangs
        faulthandler.enable()

    def read() -> Config:
        loaded = configuration.load(config)
        return loaded if log_format is None else loaded.with_log_format(log_format.value)

    options = Options(
        duration_s=duration,
        record=record,
        overwrite=overwrite,
        shadow=shadow,
        keep_state=True,
        state=state,
        notifier=notifier,
        reread=read if notifier is not None or not has_terminal() else None,
    )
    loaded = read()
    facts = commissioning_facts(loaded)
    if not is_as_commissioned(facts):
        print(f"warning: {commissioning_lines(facts)[0]}; see hri-predict check", file=sys.stderr)
    go(loaded, options, as_json, screens(viewer, operator, viewer_host, operator_url))


def replay(
    *,
    recording: Annotated[Path, typer.Argument(help=f"{ANY_ENDING}.")],
    config: Annotated[Path, typer.Option(help="The node's YAML configuration.")] = Path(
        "configs/demo.yaml"
    ),
    speed: Speed = "1",
    place: Annotated[
        str | None, typer.Option(help="x,y,yaw: where the recording starts (m, m, rad).")
    ] = None,
    joint_map: JointMapOption = None,
    topic: TopicOption = None,
    predictor: Predictor = None,
    record: Record = None,
    overwrite: Overwrite = False,
    alerts: Annotated[
        bool,
        typer.Option(
            "--alerts",
            help="Write the configuration's alert file and run its command, as the live cell does.",
        ),
    ] = False,
    shadow: Shadow = False,
    no_links: Annotated[
        bool,
        typer.Option(
            "--no-links", help="Open no links; take RobotState from the recording (MCAP)."
        ),
    ] = False,
    state: State = None,
    fault: Faults = None,
    viewer: Viewer = None,
    operator: Operator = None,
    viewer_host: Host = LOOPBACK,
    as_json: Json = False,
) -> None:
    """Replay a recording through the node and its links.

    The live cell's alert log, commands, recordings, state and evidence stay as they are.

    Example: hri-predict replay walk.bvh --config configs/demo.yaml --place 2,0,3.14 --speed max
    """
    live = configuration.load(config)
    loaded = live.aside().with_alerts_of(live) if alerts else live.aside()
    source = played(loaded.source, recording)
    if place is not None:
        source["place"] = _place(place)
    if joint_map is not None:
        source["joint_map"] = map_path(joint_map)
    if topic is not None:
        source["topic"] = topic
    loaded = _with_faults(loaded.with_source(source), fault)
    if predictor is not None:
        if "=" in predictor:
            loaded = with_predictor(loaded, predictor)
        else:  # with its own defaults, the horizon included
            loaded = loaded.with_predictor(predictor)
    if no_links:
        loaded = loaded.without_links()
    real = [link.name for link in loaded.opened_links if link.simulate is None]
    if real and speed != "max":
        print(
            f"replay: sends to {', '.join(real)}, like a live cell; --no-links sends nothing",
            file=sys.stderr,
        )
    options = Options(
        factor=_factor(speed),
        until_exhausted=True,
        record=record,
        overwrite=overwrite,
        shadow=shadow,
        state=state,
    )
    go(loaded, options, as_json, screens(viewer, operator, viewer_host))


def go(
    config: Config,
    options: Options,
    as_json: bool,
    screens: AbstractContextManager[Feed | None],
    *,
    stop: threading.Event | None = None,
) -> None:
    """Run the node with its screens, including the terminal's view; print the summary.

    ``stop`` ends the run when it is set.

    Raises:
        typer.Exit: status 1: a person was touched, or the recording is not complete.
    """
    logs.use(config.node.log)
    if options.factor is None:  # two runs of one configuration give the same bytes
        options = replace(options, last_latch_id=0)
    if unused := unused_coverage(config):
        print(f"warning: {unused}", file=sys.stderr)
    real_time = options.factor is not None
    for note in delay_notes(config) if real_time else ():
        print(f"warning: {note}", file=sys.stderr)
    in_terminal = _in_terminal(as_json, options.factor)
    with (
        config.naming_lines(),
        logs.unhurried() if real_time else nullcontext(),
        screens as feed,
        TerminalView(footer=partial(addresses, feed)) if in_terminal else nullcontext() as terminal,
    ):
        views = [each for each in (feed, terminal) if each is not None]
        run_config = config.quiet() if in_terminal else config
        summary = run_session(run_config, replace(options, view=Together(views)), stop)
    if feed is not None:
        summary.counted["pictures_dropped"] = feed.dropped
    try:
        _show(summary, as_json)
    finally:  # even if the summary cannot be printed
        broken = summary.recording is not None and summary.recording["error"] is not None
        if broken:
            print(f"error: {_broken(summary.recording or {})}", file=sys.stderr)
        if summary.contacts or broken:
            raise typer.Exit(1)


def _in_terminal(as_json: bool, factor: float | None) -> bool:
    return not as_json and factor is not None and sys.stderr.isatty()


def _broken(report: dict[str, Any]) -> str:
    return (
        f"recording {report['path']}: incomplete: {report['error']}; {report['dropped']} messages "
        f"are lost; free some room, or name another place"
    )


def _show(summary: Summary, as_json: bool) -> None:
    if as_json:
        print(json.dumps(summary.as_dict()))
    else:
        summary.print(Console())


def _factor(speed: str) -> float | None:
    if speed == "max":
        return None
    try:
        factor = float(speed)
    except ValueError:
        factor = math.nan
    if not (0.01 <= factor <= 100.0):
        raise ConfigError(f"--speed {speed}: give 'max' or a factor from 0.01 to 100")
    return factor


def _positive(value: float | None, name: str) -> None:
    if value is not None and not 0 < value <= MAX_SECONDS:
        raise ConfigError(f"{name} {value}: give a number above 0, up to {MAX_SECONDS:.0f}")


def _place(text: str) -> list[float]:
    try:
        x, y, yaw = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--place {text}: give three numbers: x,y,yaw (m, m, rad)") from None
    if not all(math.isfinite(v) for v in (x, y, yaw)):
        raise ConfigError(f"--place {text}: the numbers must be finite")
    return [x, y, yaw]


def _with_faults(config: Config, faults: list[str] | None) -> Config:
    return config.with_faults(faults) if faults else config


# -- the source that replays a recording in a cell -------------------------------------------------

BESIDE_THE_ROBOT = [-1.9, 2.0, 0.0]  # default place where a recording starts


def played(cell: SourceSettings, recording: Path) -> dict[str, Any]:
    """Return the ``source:`` for a recording, which replaces the cell's own.

    A motion file starts near the robot. This node's own recording, or a bag made from one, is
    already in the room's frame. A bag with the cell's own topic is read as the cell reads the
    topic.

    Args:
        cell: the configuration's source.
        recording: the file.
    """
    path = str(recording.absolute())
    if cell.kind == "recording":
        return cell.model_dump() | {"path": path}
    view = cell.field_of_view
    source: dict[str, Any] = {
        "kind": "recording",
        "path": path,
        "room_from_source": cell.room_from_source.model_dump(),
        "min_latency_s": cell.min_latency_s,
        "clock_wander_s": cell.clock_wander_s,
        "stale_s": cell.stale_s,
        "field_of_view": None if view is None else view.model_dump(),
    }
    is_bag = _is_bag(recording)
    in_room = is_in_room(file_of(recording)) if is_bag else recording.suffix == ".mcap"
    # the same judgement of ids and free space as live; a motion file has none of the cell's
    seen = cell.model_dump(include=set(SourceSettings.model_fields.keys() - {"kind", "faults"}))
    if cell.kind == "ros2" and is_bag and not in_room:
        own = cell.model_dump(include={"joint_map", "axes", "frame"})
        topics: list[str] = getattr(cell, "topics", [])
        return seen | source | own | ({"topic": topics[0]} if len(topics) == 1 else {})
    if not in_room:
        return source | {"place": BESIDE_THE_ROBOT}
    return seen | source


def _is_bag(recording: Path) -> bool:
    file = file_of(recording)
    if file.suffix in (BAG_ENDING, ".db3"):
        return True
    return file.suffix == ".mcap" and file.is_file() and is_ros_mcap(file)
