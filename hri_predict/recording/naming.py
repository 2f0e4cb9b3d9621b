"""Maps the joint names of a file to the canonical skeleton.

Names alone decide, with and without what a tracker writes before or after them all
(``shared_affix``). All joints of one of the shipped maps, as the map writes them or in another
spelling (``rig.sided``); or only canonical names; or the names of any rig (``rig.map_of_rig``). Of
several readings, the one that gives the most canonical joints holds, and another one adds what only
it understands: no person's legs are lost for the lack of a head. Other names stay unchanged: the
file can be converted, but not replayed, unless the user gives a map.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap, load_joint_map, map_names
from hri_predict.recording.recording import Recording, noted
from hri_predict.recording.rig import lacking, map_of_rig, plain, rig_weights, sided
from hri_predict.recording.shared_affix import without_shared

UNKNOWN = "unknown"
_WORDS = ("left", "right")


def map_of_names(names: Sequence[str]) -> JointMap:
    """The map of a file's joints, for metres, x forward, y left, z up; see ``JointMap`` for others.

    All weights are zero if the names are not known; ``check_known`` refuses such a map.
    """
    bare = without_shared(names)
    readings = [_reading(names)] if bare == list(names) else [_reading(names), _reading(bare)]
    best = max(readings, key=lambda m: int(m.mapped.sum()))  # the first of equals
    own = dict(zip(best.source_joints, names, strict=True))
    rigid = {joint: each.renamed(own) for joint, each in best.rigid.items()}
    return replace(best, source_joints=tuple(names), rigid=rigid)


def _reading(names: Sequence[str]) -> JointMap:
    columns = {name: k for k, name in enumerate(names)}
    for shipped in _shipped():
        if sorted(columns) == sorted(shipped.source_joints):
            return _by_name(shipped, columns, names)
    if all(name in JOINTS for name in names):
        return _by_name(load_joint_map("canonical"), columns, names)
    shipped, named = _largest(names)
    rig = _map("bvh", names, rig_weights(names))
    known, whole = bool(shipped.mapped.any()), not lacking(rig.weights)
    readings = [_completed(shipped, rig.weights, named)] if known else []
    if whole:
        readings.append(_completed(rig, shipped.weights, np.asarray(rig.weights.any(axis=0))))
        if lacking(shipped.weights):  # arms only: any rig may call a collar bone LeftShoulder
            readings.reverse()
    readings.append(unknown_map(names))
    return max(readings, key=lambda m: int(m.mapped.sum()))  # the first of equals


def unknown_map(names: Sequence[str]) -> JointMap:
    """Return a map without any canonical joint."""
    return _map(UNKNOWN, names, np.zeros((len(JOINTS), len(names))))


def check_known(joint_map: JointMap) -> None:
    """Reject a map from ``unknown_map``.

    Raises:
        ConfigError: the names give no canonical joint; the error lists the missing ones.
    """
    if not joint_map.mapped.any():
        map_of_rig(joint_map.source_joints)


def with_map(recording: Recording, own: JointMap) -> Recording:
    """The recording with a map of the user's own, by the names of the joints.

    The file's units and axes stay; the recording's note says so where the map has others.

    Raises:
        ConfigError: a joint that the map uses is not in the recording.
    """
    names = recording.joint_map.source_joints
    columns = {name: k for k, name in enumerate(names)}
    for joint in (own.source_joints[k] for k in np.flatnonzero(own.used)):
        if joint not in columns:
            raise ConfigError(
                f"joint map {own.name}: uses '{joint}', which is not among the recording's joints"
                f"{nearest(joint, names)}; correct the map"
            )
    made = _by_name(own, columns, names)
    theirs = recording.joint_map
    other = theirs.scale_to_m != own.scale_to_m or not np.array_equal(theirs.rotation, own.rotation)
    note = f"of joint map {own.name} the names are used; units and axes are the file's own"
    made = replace(made, scale_to_m=theirs.scale_to_m, rotation=theirs.rotation)
    return noted(replace(recording, joint_map=made), note if other else "")


def _by_name(joint_map: JointMap, columns: Mapping[str, int], names: Sequence[str]) -> JointMap:
    """Return a map for a file's own joints; joints missing in the file are ignored."""
    there = [k for k, joint in enumerate(joint_map.source_joints) if joint in columns]
    weights = np.zeros((len(JOINTS), len(names)))
    places = [columns[joint_map.source_joints[k]] for k in there]
    weights[:, places] = joint_map.weights[:, there]
    same = tuple(names) == joint_map.source_joints or joint_map.name == "canonical"
    made = _map(joint_map.name if same else f"{joint_map.name} by name", names, weights)
    rigid = {
        joint: each.renamed({name: names[k] for name, k in columns.items()})
        for joint, each in joint_map.rigid.items()
        if each.sources <= set(columns)
    }
    return replace(made, rigid=rigid)


def _completed(best: JointMap, other: Floats, taken: Bools) -> JointMap:
    """Return a map extended by the joints that only another map gives, from unused columns."""
    free = ~best.mapped & ~(other[:, taken] > 0).any(axis=1)
    return replace(best, weights=np.where(free[:, np.newaxis], other, best.weights))


def _largest(names: Sequence[str]) -> tuple[JointMap, Bools]:
    """Return the largest shipped map all of whose joints are there, and the columns that it names.

    The map with the most canonical joints wins; of equals, the one with the most joints.
    """
    best, named = unknown_map(names), np.zeros(len(names), dtype=np.bool_)
    for shipped in _shipped():
        columns = _columns(shipped, names)
        if shipped.mapped.sum() > best.mapped.sum() and len(columns) == len(shipped.source_joints):
            best = _by_name(shipped, columns, names)
            named = np.isin(np.arange(len(names)), list(columns.values()))
    return best, named


def _columns(shipped: JointMap, names: Sequence[str]) -> dict[str, int]:
    """Return the indices of a shipped map's joints among the names, in any spelling."""
    columns = {name: k for k, name in enumerate(names)}
    if all(joint in columns for joint in shipped.source_joints):
        return {joint: columns[joint] for joint in shipped.source_joints}
    own = {joint: _explicit(joint) for joint in shipped.source_joints}
    stems = {stem for _, stem in own.values()}
    spelled = {sided(name, stems): k for k, name in reversed(list(enumerate(names)))}
    return {joint: spelled[key] for joint, key in own.items() if key in spelled}


def _explicit(joint: str) -> tuple[str, str]:
    """Side and rest of a shipped map's joint: a word, or a letter that stands apart."""
    whole = plain(joint)
    for word in _WORDS:
        for rest in (whole.removeprefix(word), whole.removesuffix(word)):
            if rest != whole:
                return word[0], rest
    first, second = joint[:1], joint[1:2]
    apart = second in ("_", ".") or (second.isupper() and not joint.isupper())
    if first.lower() in ("l", "r") and apart:
        return first.lower(), whole[1:]
    return "", whole


def _map(name: str, names: Sequence[str], weights: Floats) -> JointMap:
    return JointMap(
        name=name, source_joints=tuple(names), scale_to_m=1.0, rotation=np.eye(3), weights=weights
    )


@cache
def _shipped() -> list[JointMap]:
    """The shipped maps, the largest first."""
    maps = [load_joint_map(name) for name in map_names() if name != "bvh"]
    return sorted(maps, key=lambda m: -len(m.source_joints))
