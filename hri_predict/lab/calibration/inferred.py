"""Fits the rules by which never-delivered joints are inferred: ``people/body/inferred.py``.

A rule's place and radius are shares of the person's own bone. The radius holds ``HELD`` of the true
joints in every set of recordings, and the place is the one with the smallest such radius. So no set
is held less often, however few recordings it has, and a joint that data sets place differently gets
a radius that spans them.

A rule's hand and foot are the points that the recordings mark, at the knuckles and the ball: the
radius of their capsules covers the fingers and toes beyond (``base.skeleton``). Some recorded bones
are unrealistic (the hand of cmu38 is 0.4 to 0.6 forearms long). So each set is used a second time
with the recorded direction, but with the surveyed length from wrist to knuckles, or from ankle to
ball. No recording marks the crown: it is placed along the skull, at the surveyed distance from the
ears.

``hri-predict bench joint-maps --fit ../shared/data`` prints them. It reads the lists *fit* and
*calibration* of ``configs/training/splits.yaml``, and all recordings of ``motion/`` whose people
are in no test.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import read_text
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.lab.datasets.splits import split
from hri_predict.people.body.inferred import SHAPES, Rule, frame_of

HELD = 0.999
EVERY_S = 0.1
"""Interval between the poses used; closer ones are nearly identical."""
PALM_PER_FOREARM = 140.0 / 328.0
"""palmlength over radialestylionlength, the survey's maxima."""
BALL_PER_SHANK = float(np.hypot(0.75 * 323.0 - 78.0, 93.0)) / 524.0
"""Ankle to ball over knee to ankle: the longest foot, less footlength - balloffootlength."""
CROWN_M = 0.150
"""tragiontopofhead, the survey's maximum: a low crown is inside the head's capsule as well."""

_SETS = ("cmu_subjects", "cmu_tools", "cmu_misc", "cmu_dance")
_DAZ23 = {
    "torso": "chest", "l_shoulder": "lShldr", "l_elbow": "lForeArm", "l_wrist": "lHand",
    "r_shoulder": "rShldr", "r_elbow": "rForeArm", "r_wrist": "rHand", "l_hip": "lThigh",
    "l_knee": "lShin", "l_ankle": "lFoot", "l_foot": "lFoot_End", "r_hip": "rThigh",
    "r_knee": "rShin", "r_ankle": "rFoot", "r_foot": "rFoot_End",
}  # fmt: skip
_Y_UP = [2, 0, 1]


def read_poses(path: Path) -> Floats:
    """(N, J, 3) canonical joints of one recording, z up, metres; NaN where not known.

    The crown is ``CROWN_M`` above ``head``, along the recorded skull, where that is recorded.

    Args:
        path: an ``npz`` of ``cmu_mocap`` or ``motion``.
    """
    with np.load(path) as data:
        if "positions_world" in data:
            points = data["positions_world"][..., _Y_UP].astype(float)
            points[~data["world_ok"]] = np.nan
            names: Sequence[str] = ()
        else:
            points, names = data["positions"].astype(float), list(data["joint_names"])
            for key, good in (("valid", True), ("jump", False)):
                if key in data:
                    points[data[key] != good] = np.nan
        points = points[:: max(1, round(EVERY_S * float(data["fps"])))]
    cmu38 = load_joint_map("cmu38")
    if points.shape[1] == len(cmu38.source_joints):
        return _of_cmu38(points, cmu38)
    found = np.full((len(points), len(JOINTS), 3), np.nan)
    for joint, name in _DAZ23.items():
        found[:, JOINTS.index(joint)] = points[:, names.index(name)]
    for middle, pair in (("waist", "hip"), ("neck", "shoulder")):
        ends = [JOINTS.index(side + pair) for side in ("l_", "r_")]
        found[:, JOINTS.index(middle)] = found[:, ends].mean(1)
    return found


def _of_cmu38(points: Floats, cmu38: JointMap) -> Floats:
    joints, seen = cmu38.map(points, np.asarray(np.isfinite(points).all(-1)))
    found = np.where(seen[..., None], joints, np.nan)
    skull, end = (points[:, cmu38.source_joints.index(n)] for n in ("Head", "Head_End"))
    upward = (end - skull) / np.linalg.norm(end - skull, axis=-1, keepdims=True)
    found[:, JOINTS.index("head_top")] = end + CROWN_M * upward
    return found


def recordings(data: Path) -> dict[str, list[Path]]:
    """The recordings to fit on, by set.

    Raises:
        ConfigError: ``data`` lacks the manifest of ``motion``, or it is another file.
    """
    names = [name for part in ("fit", "calibration") for name in split(part)]
    found = {"cmu_mocap": [data / f"{name}.npz" for name in names if name.startswith("cmu_mocap/")]}
    manifest = data / "motion" / "manifest.csv"
    if not manifest.exists():
        raise ConfigError(f"{manifest}: not there; give the folder of the recordings")
    try:
        rows = list(csv.DictReader(read_text(manifest, "manifest").splitlines(), strict=True))
        taken = [r for r in rows if r["set"] in _SETS and not r["person_in_test"]]
        for row in taken:
            name = f"{row['set']} {row['joints']}"  # joints are placed by the skeleton
            path = data / "motion" / row["set"] / f"{row['name']}.npz"
            found.setdefault(name, []).append(path)
    except (KeyError, csv.Error) as error:
        raise ConfigError(
            f"{manifest}: not the manifest of recordings ({error}); copy it again"
        ) from None
    return found


def shares(rule: Rule, poses: Floats) -> Floats:
    """(N, 3) place of the true joint in the rule's frame, in bones, for N poses that have it."""
    known: Bools = np.asarray(np.isfinite(poses).all(-1))
    frame = frame_of(rule, np.where(known[..., None], poses, 0.0), known)
    exists = frame.exists & known[:, JOINTS.index(rule.joint)]
    apart = (poses[:, JOINTS.index(rule.joint)] - frame.origin)[exists]
    found: Floats = np.einsum("nki,ni->nk", frame.directions[exists], apart)
    rest = apart - np.einsum("nki,nk->ni", frame.directions[exists], found)
    found[:, 2] += np.linalg.norm(rest, axis=1) * (rule.side is None)  # off the axis, any way
    return found / frame.bone[exists][:, None]


def fit(rule: Rule, samples: Iterable[Floats]) -> tuple[tuple[float, float, float], float]:
    """The place and the radius of a rule, both in bones; see the module's docstring.

    Args:
        rule: the rule to fit.
        samples: (N, 3) ``shares`` of each set.
    """
    sets = [each for each in samples if len(each)]

    def radius(place: Floats) -> float:
        return max(float(np.quantile(np.linalg.norm(s - place, axis=1), HELD)) for s in sets)

    place = np.mean([each.mean(0) for each in sets], axis=0)
    free = range(1 if rule.side is None else 3)
    place[len(free) :] = 0.0
    step, best = 0.2, radius(place)
    while step > 0.002:  # a pattern search: three numbers, and a function without derivatives
        tried = [place + sign * step * np.eye(3)[axis] for axis in free for sign in (-1, 1)]
        radii = [radius(each) for each in tried]
        if min(radii) < best:
            place, best = tried[int(np.argmin(radii))], min(radii)
        else:
            step /= 2
    along, forward, outward = (round(float(value), 3) + 0.0 for value in place)
    return (along, forward, outward), float(np.ceil(best * 1000) / 1000)


def samples_of(name: str, poses: Mapping[str, Floats]) -> list[Floats]:
    """``shares`` of each set for a named rule; hands and feet also with the surveyed length."""
    rule = SHAPES[name]
    found = []
    for each in poses.values():
        sides = [shares(rule, each)]
        if rule.joint.startswith("l_"):
            sides.append(shares(rule.mirrored(), each))
        else:  # a joint in the middle is as often on one side as on the other
            sides.append(sides[0] * [1.0, 1.0, -1.0])
        found.append(np.concatenate(sides))
    length = {"hand": PALM_PER_FOREARM, "foot": BALL_PER_SHANK}.get(name)
    if length is not None:
        found += [s * length / np.linalg.norm(s, axis=1, keepdims=True) for s in found]
    return found


def fitted(data: Path) -> dict[str, tuple[tuple[float, float, float], float]]:
    """Fit all rules: place and radius by the rule's name, both in bones.

    Args:
        data: the folder of the data pack.

    Raises:
        ConfigError: it lacks recordings.
    """
    found = recordings(data)
    for path in (path for paths in found.values() for path in paths):
        if not path.is_file():
            raise ConfigError(f"{path}: not there; give the folder of the recordings")
    poses = {
        name: np.concatenate([read_poses(path) for path in paths]) for name, paths in found.items()
    }
    return {name: fit(rule, samples_of(name, poses)) for name, rule in SHAPES.items()}
