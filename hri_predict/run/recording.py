"""Path of a run's recording, and the description of the run stored in it."""

import logging
import os
from pathlib import Path

from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.source import Source
from hri_predict.recording import RecordingInfo
from hri_predict.recording.folder.folder import Folder
from hri_predict.recording.folder.settings import RecordSettings
from hri_predict.recording.mcap.clocks import Clocks, SystemClocks, VirtualClocks
from hri_predict.recording.mcap.info import FullSpeed
from hri_predict.recording.mcap.places import OneFile, RecordingFiles, beside
from hri_predict.risk.robot_constants import worst_distance
from hri_predict.robots.stopping import StoppingCurve
from hri_predict.run.assemble import Assembly, build_budget
from hri_predict.run.config import Config
from hri_predict.run.coverage import zones_text

log = logging.getLogger(__name__)

_LONGEST_NAME = 200  # of a folder; longer ones are refused as files are


def where_to_record(
    config: Config, asked: Path | None, overwrite: bool
) -> tuple[RecordSettings | None, RecordingFiles | None]:
    """Return the recorder's settings and path, if anything is recorded.

    Raises:
        ConfigError: the path is the recording being played or the configuration; the folder cannot
            be used; there is no file to overwrite.
    """
    settings = _record_settings(config, asked)
    if overwrite and (settings is None or settings.file is None):
        what = "nothing is recorded" if settings is None else f"{settings.folder} is a folder"
        raise ConfigError(f"--overwrite: has no effect, because {what}; leave it out")
    return settings, None if settings is None else _place_of(config, settings, asked, overwrite)


def _record_settings(config: Config, asked: Path | None) -> RecordSettings | None:
    """Return the user's request: ``--record FILE``, ``--record FOLDER``, or the configuration.

    A new path without a suffix is a folder, which is created. If the configuration already records
    into a folder, ``--record FOLDER`` changes only the path.
    """
    configured = config.node.record
    if asked is None:
        return configured
    given = {} if configured is None else configured.model_dump(exclude_unset=True)
    # os.path takes names that are too long
    is_new = not os.path.exists(asked) and len(asked.name) <= _LONGEST_NAME
    if os.path.isdir(asked) or (is_new and not asked.suffix):
        given.pop("file", None)
        return RecordSettings.model_validate({**given, "folder": str(asked.absolute())})
    rates = {key: given[key] for key in ("zones_hz", "poses_hz", "view_hz", "sent") if key in given}
    return RecordSettings.model_validate({**rates, "file": str(asked.absolute())})


def _place_of(
    config: Config, settings: RecordSettings, asked: Path | None, overwrite: bool
) -> RecordingFiles:
    """Return the path of the recording.

    An existing file named in the configuration is kept, and the new one gets a number, because a
    restarting node has no user to ask. With ``--record`` an existing file is an error.

    Raises:
        ConfigError: the path is the recording being played or the configuration, or the folder
            cannot be used.
    """
    if settings.folder is not None:
        cell = settings.name or cell_of(config)
        return Folder(config.base_dir / settings.folder, cell, settings)
    assert settings.file is not None
    path = asked or config.base_dir / settings.file
    _refuse_input(config, path)
    if asked is None and not overwrite and (free := beside(path)) != path:
        log.warning("recording %s: already exists, and is kept; recording %s", path, free)
        path = free
    return OneFile(path, overwrite)


def cell_of(config: Config) -> str:
    """Return the cell name used in file names: the configuration's file name without its suffix."""
    stem = config.path.stem
    plain = "".join(c if c.isascii() and (c.isalnum() or c in "_.-") else "_" for c in stem)
    return plain.lstrip("._-")[:64] or "cell"


def clocks_of(clock: Clock, factor: float | None, start_ns: int) -> Clocks:
    """Return the clocks that give messages their UTC; with ``--speed max`` there is no UTC."""
    if factor is None:
        return VirtualClocks(start_ns)
    return SystemClocks(clock, is_true=factor == 1.0)


def info_of(config: Config, source: Source, assembly: Assembly) -> RecordingInfo:
    """Return the description of this run in its recording."""
    record = config.node.record
    bases = ((robot.name, robot.room_from_robot) for robot in config.node.robots)
    return RecordingInfo(
        joint_map=source.joint_map,
        rate_hz=source.rate_hz,
        declares_noise=source.declares_noise,
        config=config.text,
        cell=(record.name if record is not None else None) or cell_of(config),
        robots=tuple((robot.name, tuple(robot.capsule_names)) for robot in assembly.robots),
        frames=tuple((name, pose) for name, pose in bases if pose is not None),
        predictor=config.predictor.name,
        forecast_rate_hz=config.predictor.rate_hz,
        coverage=zones_text(config),
        last_latch_id=assembly.last_latch_id,
        full_speed=_full_speed(config, source, assembly),
    )


def _full_speed(config: Config, source: Source, assembly: Assembly) -> dict[str, FullSpeed]:
    """Return the distances that are enough for each robot's full speed, and for its start, by the
    standard.

    Modes ``fixed`` and ``reactive`` do not apply the standard's distance.
    """
    risk, budget = config.node.risk, build_budget(config, source)
    if risk.mode not in ("iso", "predictive", "hybrid"):
        return {}
    margins_m = risk.slow_margin_m + risk.band_m + max(risk.region_margins_m.values(), default=0.0)
    found = {}
    for settings, model in zip(config.node.robots, assembly.robots, strict=True):
        worst = worst_distance(risk, settings, model, budget)
        # limits are tabled speeds, and one below the minimum is advised as a stop
        tabled = StoppingCurve.of(model.stopping, settings.max_speed_m_s).speed_m_s
        slowest_m_s = float(tabled[tabled >= min(risk.min_speed_m_s, tabled[-1])][0])
        start = worst_distance(risk, settings, model, budget, speed_m_s=slowest_m_s)
        found[settings.name] = FullSpeed(
            worst.total + margins_m, worst.z_r, start.total + margins_m
        )
    return found


def _refuse_input(config: Config, path: Path) -> None:
    played = getattr(config.source, "path", None)
    if _same(path, config.path):
        raise ConfigError(f"record {path}: this is the configuration; name another file")
    if isinstance(played, str) and any(
        _same(path, there) for there in (config.base_dir / played, Path(played))
    ):  # a relative path may mean either place
        raise ConfigError(f"record {path}: this recording is being played; name another file")


def _same(a: Path, b: Path) -> bool:
    """Return whether both paths name the same existing file."""
    try:
        return a.samefile(b)
    except OSError:  # one does not exist, or its name is too long
        return False
