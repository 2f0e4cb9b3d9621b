"""Side and joint of any rig's joint names, determined by one rule and one table.

A name is compared without case, separators and namespace. Its side is ``left``, ``right``, ``l`` or
``r`` before or after the rest, with any separator or none: ``LeftFoot``, ``lFoot``, ``foot.L``,
``Foot_left``, ``mixamorig:LeftFoot``, ``L Foot``. A single letter counts as a side only if the rest
is a name in the table (``heel`` is not a left ``hee``). The table is
``configs/skeletons/bvh.yaml``.
"""

import re
from collections.abc import Collection, Sequence
from functools import cache

import numpy as np
from pydantic import model_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path, read_yaml
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.joint_map import JointMap, SourceFrame

_SIDES = (("left", "l"), ("right", "r"), ("l", "l"), ("r", "r"))
_END = "end"
_PREFIX = re.compile(r"^(mixamorig\d*|bip\d+|valvebiped)[ _.]*(?=\w)")


class RigTable(SourceFrame):
    """The table of each canonical joint's names in different rigs; names of limbs are without side.

    Attributes:
        required: joints without which a rig is not understood.
        derived: canonical joint -> the joints or landmarks whose middle it is, where all are there.
        landmarks: points that are not canonical joints, without side -> their names.
        aliases: canonical joint, without ``l_`` or ``r_`` -> its names, the best first.
    """

    required: list[str]
    derived: dict[str, list[str]]
    landmarks: dict[str, list[str]]
    aliases: dict[str, list[str]]

    @model_validator(mode="after")
    def _known_joints(self) -> "RigTable":
        landmarks = [joint for name in self.landmarks for joint in self.joints_of(name)]
        sources = [joint for own in self.derived.values() for joint in own]
        named = [self.joints_of(name)[0] for name in self.aliases]
        known = [joint for joint in sources if joint not in landmarks]
        for joint in [*self.required, *self.derived, *known, *named]:
            if joint not in CANONICAL.joints:
                raise ValueError(f"no canonical joint '{joint}'")
        return self

    def joints_of(self, name: str) -> list[str]:
        """Canonical joints that a key of ``aliases`` stands for."""
        return [name] if name in CANONICAL.joints else [f"l_{name}", f"r_{name}"]


@cache
def rig_table() -> RigTable:
    """The shipped table.

    Raises:
        ConfigError: its file is wrong.
    """
    path = data_path("skeletons", "bvh.yaml")
    return validated(RigTable, read_yaml(path, "joint map"), f"joint map {path}")


def map_of_rig(joint_names: Sequence[str]) -> JointMap:
    """Build the map of a file from its joint names, for any rig.

    Units and axes are those of a BVH file, which states neither: centimetres and y up, see
    ``with_units`` and ``with_axes``. A joint of the file becomes one canonical joint at most: where
    a rig has an ankle and a foot, the foot is not an ankle.

    Args:
        joint_names: the file's joints in order; end sites may appear as ``<joint>_End``.

    Raises:
        ConfigError: a joint of the arms or legs is missing.
    """
    table = rig_table()
    weights = rig_weights(joint_names)
    if missing := lacking(weights):
        raise ConfigError(
            f"no joint matches {', '.join(missing)} (the file has: {_shortened(joint_names)}); "
            f"rename the joints, e.g. as Mixamo does (LeftArm, LeftLeg), or give a map of your own "
            f"(--joint-map FILE)"
        )
    return table.joint_map(joint_names, weights)


def rig_weights(joint_names: Sequence[str]) -> Floats:
    """(J, J_source) of all canonical joints that the table knows, however few; see ``JointMap``."""
    table = rig_table()
    found = _found(table, joint_names)
    for joint, sources in table.derived.items():
        if all(source in found for source in sources):
            found[joint] = [k for source in sources for k in found[source]]
    weights = np.zeros((len(CANONICAL.joints), len(joint_names)))
    for joint in CANONICAL.joints:
        places = found.get(joint, [])
        weights[CANONICAL.index(joint), places] = 1.0 / max(1, len(places))
    return weights


def lacking(weights: Floats) -> list[str]:
    """The required joints that ``rig_weights`` did not find."""
    return [joint for joint in rig_table().required if not weights[CANONICAL.index(joint)].any()]


def _found(table: RigTable, joint_names: Sequence[str]) -> dict[str, list[int]]:
    """Return the index of each canonical joint and landmark with a name in the table, each once."""
    named = {**table.aliases, **table.landmarks}
    stems = {plain(alias) for aliases in named.values() for alias in aliases}
    known = {sided(name, stems): k for k, name in reversed(list(enumerate(joint_names)))}
    found: dict[str, list[int]] = {}
    taken: set[int] = set()
    for key, aliases in named.items():
        for joint in table.joints_of(key):
            side = "" if joint == key else joint[0]
            places = (known.get((side, plain(alias))) for alias in aliases)
            free = (k for k in places if k is not None and k not in taken)
            if (place := next(free, None)) is not None:
                found[joint] = [place]
                taken.add(place)
    return found


def sided(name: str, stems: Collection[str]) -> tuple[str, str]:
    """``("l", "foot")`` of any spelling of the left foot, if ``foot`` is among the stems.

    The side is "" where the name has none. ``foot.L_End`` gives ``("l", "footend")``.
    """
    whole = plain(name)
    if whole in stems:
        return "", whole
    bodies = [(whole, "")]
    if whole.endswith(_END):
        bodies.append((whole.removesuffix(_END), _END))
    for word, side in _SIDES:
        for body, tail in bodies:
            for rest in (body.removeprefix(word), body.removesuffix(word)):
                if rest != body and rest + tail in stems:
                    return side, rest + tail
    return "", whole


def plain(name: str) -> str:
    """A joint's name without namespace, rig prefix, separators and case."""
    name = re.split(r"[:|]", name.lower())[-1]
    return re.sub(r"[^a-z0-9]", "", _PREFIX.sub("", name))


def _shortened(names: Sequence[str]) -> str:
    shown = ", ".join(names[:12])
    return shown if len(names) <= 12 else f"{shown}, and {len(names) - 12} more"
