"""From the joint names of a file to the canonical skeleton, where the format has no skeleton.

Names alone decide: all joints of one of the shipped maps (the largest map whose joints are all
there); or only canonical names; or names in the alias table for BVH files. Other names stay
unchanged: the file can be converted, but not replayed.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import ConfigError
from hri_predict.joint_map import JointMap, load_joint_map, map_names, resolve_bvh_map
from hri_predict.skeleton import JOINTS

UNKNOWN = "unknown"


def map_of_names(names: Sequence[str]) -> JointMap:
    """The map of a file's joints, for metres, x forward, y left, z up; see ``JointMap`` for others.

    All weights are zero if the names are not known; ``check_known`` refuses such a map.
    """
    columns = {name: k for k, name in enumerate(names)}
    for shipped in _shipped():
        if all(joint in columns for joint in shipped.source_joints):
            weights = np.zeros((len(JOINTS), len(names)))
            weights[:, [columns[joint] for joint in shipped.source_joints]] = shipped.weights
            same = tuple(names) == shipped.source_joints
            return _map(shipped.name if same else f"{shipped.name} by name", names, weights)
    if all(name in JOINTS for name in names):
        weights = np.zeros((len(JOINTS), len(names)))
        for name, k in columns.items():
            weights[JOINTS.index(name), k] = 1.0
        return _map("canonical", names, weights)
    try:
        return _map("bvh", names, resolve_bvh_map(names).weights)
    except ConfigError:
        return unknown_map(names)


def unknown_map(names: Sequence[str]) -> JointMap:
    """A map that gives no canonical joint."""
    return _map(UNKNOWN, names, np.zeros((len(JOINTS), len(names))))


def check_known(joint_map: JointMap) -> None:
    """Refuse a map of ``unknown_map``.

    Raises:
        ConfigError: the names give no canonical joint; the error lists the missing ones.
    """
    if not joint_map.mapped.any():
        resolve_bvh_map(joint_map.source_joints)


def _map(name: str, names: Sequence[str], weights: Floats) -> JointMap:
    return JointMap(
        name=name, source_joints=tuple(names), scale_to_m=1.0, rotation=np.eye(3), weights=weights
    )


@cache
def _shipped() -> list[JointMap]:
    """The shipped maps, the largest first."""
    maps = [load_joint_map(name) for name in map_names() if name != "bvh"]
    return sorted(maps, key=lambda m: -len(m.source_joints))
