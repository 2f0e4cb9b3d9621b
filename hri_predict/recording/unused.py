"""Reports a file's joints that the node does not use, and a body's joints that the file lacks.

Said once for each set of joint names: a folder of recordings of one tracker is one line. Nothing is
said of a shipped map's own joints: ``hri-predict check`` and ``bench joint-maps`` say what it
costs.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap, load_joint_map, map_names

log = logging.getLogger(__name__)

_SHOWN = 12
_said: set[tuple[str, ...]] = set()


def tell_unused(path: Path, joint_map: JointMap) -> None:
    """Log the line of a recording's joints, unless it was said of the same joints before."""
    line = unused(joint_map)
    if line and joint_map.source_joints not in _said:
        _said.add(joint_map.source_joints)
        log.warning("recording %s: %s", path, line)


def unused(joint_map: JointMap) -> str:
    """One line for the user; "" if there is nothing to say."""
    if not joint_map.mapped.any() or _is_shipped(joint_map):
        return ""
    names = joint_map.source_joints
    idle = [names[k] for k in np.flatnonzero(~joint_map.weights.any(axis=0))]
    missing = [JOINTS[k] for k in np.flatnonzero(~joint_map.mapped)]
    parts = [f"joints not used: {_listed(idle)}"] if idle else []
    if missing:
        parts.append(f"joints of a body that are missing: {_listed(missing)}")
    return "; ".join(parts)


def _is_shipped(joint_map: JointMap) -> bool:
    """Whether these are a shipped map's own joints, all of them; or canonical ones, any of them."""
    name = joint_map.name
    if name == "canonical":
        return True
    if name == "bvh" or name not in map_names():
        return False
    return set(joint_map.source_joints) == set(load_joint_map(name).source_joints)


def _listed(names: Sequence[str]) -> str:
    more = f", and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
