"""The state file of a run, and what tells its cell from others."""

import hashlib
import json
from pathlib import Path

from hri_predict.node.memory import Memory, StateSettings
from hri_predict.node.node import Node
from hri_predict.protocol.reasons import Reason
from hri_predict.run.config import Config


def memory_of(
    config: Config, node: Node, instead: Path | None, keep: bool, threaded: bool
) -> Memory | None:
    """The state file of ``node``, not yet open; ``None`` if this run has none.

    Args:
        config: its ``state`` is used if ``keep`` is set.
        node: it says so in Status while the file cannot be written.
        instead: use this file.
        keep: use the configured file, if one is configured.
        threaded: see ``Memory``.
    """
    settings = config.node.state if keep else None
    if instead is not None:
        settings = StateSettings(path=str(instead.absolute()))
    if settings is None:
        return None
    memory = Memory(
        settings, config.base_dir, node.remembering, cell=cell_of(config), threaded=threaded
    )
    node.conditions = lambda: (Reason.STATE_UNTRUSTED,) if memory.failing else ()
    return memory


def cell_of(config: Config) -> str:
    """What tells this cell from others: its configuration's path, and where its parts are.

    Where a robot or the source has been moved, the places of lost people mean others.
    """
    node = config.node
    robots = [
        (robot.name, robot.model_dump(mode="json", include={"model", "room_from_robot"}))
        for robot in node.robots
    ]
    source = config.source.model_dump(mode="json", include={"kind", "room_from_source"})
    told = [str(config.path.absolute()), source, robots]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]
