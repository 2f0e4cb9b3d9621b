"""Fits the distribution of postures: ``people/body/body_model.py``.

The mean and the covariance maximise the likelihood of poses with unknown joints, by expectation
maximisation (A. Dempster et al., "Maximum likelihood from incomplete data via the EM algorithm",
JRSS B 39 (1977) 1). Each pose is also used mirrored. A recording is weighted by the square root of
its length, because its poses resemble each other.

The factors come from recordings that were not fitted: for each joint without its side, the ``HELD``
quantile of error over scale, with equal weights for recordings. The largest over all sets of seen
joints (``HIDDEN`` and ``SEEN``) is used, so no set is held less often.

``hri-predict bench joint-maps --fit ../shared/data --postures body_model.json`` makes the file.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.inferred import CROWN_M
from hri_predict.lab.calibration.quantiles import of_equals
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.people.body.body_model import BodyModel, HeadingFrame
from hri_predict.recording.opening import opened

HELD = 0.99
ODD = 0.999
"""Share of the poses that are completed; the rest are rejected as odd."""
ROUNDS = 30
UNKNOWN = 6.0
"""Factor of joints that no set hides."""
RIDGE_M = 0.01
"""Minimum standard deviation of each coordinate: skeletons place joints differently."""

FITTED = ("fit",)
JUDGED = ("calibration", "validation")
"""Lists of recordings for the distribution, and for its factors."""
EVERY_S = 0.12
_SHORTEST_M = 0.05
_FEET = [JOINTS.index(name) for name in ("l_ankle", "r_ankle")]

_LEGS = ("knee", "ankle", "foot")
HIDDEN: Mapping[str, Sequence[str]] = {
    "feet": ("ankle", "foot"),
    "legs below the hips": _LEGS,
    "all below the waist": (*_LEGS, "hip", "waist"),
    "hands": ("wrist", "hand"),
    "forearms": ("elbow", "wrist", "hand"),
    "hands and legs": ("wrist", "hand", *_LEGS),
    "all that COCO-17 lacks": ("foot", "hand", "torso", "head_top", "waist", "neck"),
    "left leg": ("l_knee", "l_ankle", "l_foot"),
    "left arm": ("l_elbow", "l_wrist", "l_hand"),
    "right arm": ("r_elbow", "r_wrist", "r_hand"),
}
"""Joints that a tracker does not see: whole names, or without their side for both."""
_ARMS = ("shoulder", "elbow", "wrist")
SEEN: Mapping[str, Sequence[str]] = {
    "upper arms": ("shoulder", "elbow"),
    "upper arms and chest": ("shoulder", "elbow", "torso"),
    "upper arms and head": ("shoulder", "elbow", "head"),
    "arms": _ARMS,
    "arms, head and crown": (*_ARMS, "head", "head_top"),
    "left arm and head": ("shoulder", "l_elbow", "l_wrist", "head"),
    "thighs": ("hip", "knee"),
    "legs": ("hip", "knee", "ankle"),
    "all from the waist down": ("waist", "hip", *_LEGS),
    "shoulders and hips": ("shoulder", "hip"),
    "shoulders, hips and head": ("shoulder", "hip", "head"),
}
"""Joints seen without any others, in recordings that have all of them."""


def hidden_joints(names: Sequence[str]) -> Bools:
    """(J,) the joints of an entry of ``HIDDEN``."""
    found = [j in names or j.removeprefix("l_").removeprefix("r_") in names for j in JOINTS]
    return np.array(found)


def read_postures(data: Path, uses: Sequence[str]) -> dict[str, Floats]:
    """(N, J, 3) poses by recording and person, as the node maps them; NaN where not known.

    Recordings of arms and of marker clusters are left out: their floor is not known. A crown that
    is not recorded is placed ``CROWN_M`` above the head, along the neck.

    Args:
        data: the folder of the data pack.
        uses: lists of ``configs/training/splits.yaml``.

    Raises:
        ConfigError: it lacks recordings.
        RecordingError: one is damaged.
    """
    found: dict[str, list[Floats]] = {}
    for name in (name for use in uses for name in split(use)):
        recording = opened(in_pack(data, name))
        if not recording.joint_map.mapped[_FEET].any():
            continue
        for scene in recording.scenes[:: max(1, round(EVERY_S * recording.rate_hz))]:
            for person in scene.people:
                place, seen = recording.joint_map.map(person.positions, person.observed)
                pose = np.where(seen[:, None], place, np.nan)
                found.setdefault(f"{name} {person.id}", []).append(pose)
    return {name: _crowned(np.array(poses)) for name, poses in found.items()}


def _crowned(poses: Floats) -> Floats:
    head, neck, crown = (poses[:, JOINTS.index(name)] for name in ("head", "neck", "head_top"))
    along = head - neck
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), _SHORTEST_M)
    missing = ~_known(crown)[:, None]
    poses[:, JOINTS.index("head_top")] = np.where(missing, head + CROWN_M * along / length, crown)
    return poses


def fit_body_model(
    poses: Mapping[str, Floats], others: Mapping[str, Floats]
) -> tuple[BodyModel, dict[str, dict[str, float]]]:
    """Fit the model, and judge it by other recordings.

    Args:
        poses: (N, J, 3) metres by recording, z up, floor at 0; NaN where not known.
        others: the same, of recordings that give the factors.

    Returns:
        The model; and, by set of seen joints and joint, the metres that hold ``HELD`` of
        ``others``.
    """
    mean, covariance = _likeliest(list(poses.values()))
    plain = BodyModel(mean, covariance, np.ones(len(JOINTS)))
    odd = [plain.oddness(np.nan_to_num(p), _known(p)) for p in others.values()]
    factors: dict[str, float] = {}
    errors = {}
    for title, seen in _sets().items():
        ratios, off_m = _errors(plain, others, seen)
        for kind, own in ratios.items():
            factors[kind] = max(factors.get(kind, 0.0), of_equals(own, HELD))
        errors[title] = {kind: round(of_equals(own, HELD), 3) for kind, own in off_m.items()}
    factor = np.array([factors.get(_kind(joint), UNKNOWN) for joint in JOINTS])
    return BodyModel(mean, covariance, factor, of_equals(odd, ODD)), errors


def _sets() -> dict[str, Bools]:
    """(J,) the seen joints by the name of the set."""
    hidden = {f"without {title}": ~hidden_joints(names) for title, names in HIDDEN.items()}
    return hidden | {f"{title} alone": hidden_joints(names) for title, names in SEEN.items()}


_ByKind = dict[str, list[Floats]]


def _errors(model: BodyModel, others: Mapping[str, Floats], seen: Bools) -> tuple[_ByKind, _ByKind]:
    """Errors in scales and in metres, by joint without its side, of each recording."""
    ratios: _ByKind = {}
    errors: _ByKind = {}
    few = seen.sum() < len(JOINTS) // 2
    for pose in others.values():
        known = _known(pose)
        rows = known[:, seen].all(1) if few else known.any(1)
        pose, known = np.nan_to_num(pose[rows]), known[rows]
        found = model.complete(pose, known & seen)
        off = np.linalg.norm(found.positions - pose, axis=-1)
        for joint in np.flatnonzero(~seen):
            shown = found.usable & known[:, joint]
            if shown.any():
                kind = _kind(JOINTS[joint])
                own = off[shown, joint]
                ratios.setdefault(kind, []).append(own / found.within_m[shown, joint])
                errors.setdefault(kind, []).append(own)
    return ratios, errors


def _likeliest(poses: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Mean (J, 3) and covariance (3 J, 3 J) by expectation maximisation."""
    rows, seen, weights = [], [], []
    swap = np.arange(len(JOINTS))
    for left, right in CANONICAL.left_right_pairs:
        swap[[left, right]] = right, left
    for pose in poses:
        known = _known(pose)
        frame = HeadingFrame.of(np.nan_to_num(pose), known)
        own = frame.into(np.nan_to_num(pose))[frame.exists]
        known = known[frame.exists]
        rows += [own, own[:, swap] * [1.0, -1.0, 1.0]]
        seen += [known, known[:, swap]]
        weights += [np.full(len(own), len(own) ** -0.5 if len(own) else 0.0)] * 2
    points, known = np.concatenate(rows), np.concatenate(seen)
    weight = np.concatenate(weights)
    return _maximised(np.where(known[..., None], points, 0.0), known, weight / weight.sum())


def _maximised(points: Floats, known: Bools, weight: Floats) -> tuple[Floats, Floats]:
    values, there = points.reshape(len(points), -1), np.repeat(known, 3, axis=1)
    size = values.shape[1]
    masks, which = np.unique(there, axis=0, return_inverse=True)
    share = there * weight[:, None]
    mean = (values * share).sum(0) / np.maximum(share.sum(0), 1e-12)
    covariance = 0.2 * np.eye(size)
    for _ in range(ROUNDS):
        first, second = np.zeros(size), np.zeros((size, size))
        for m, mask in enumerate(masks):
            own = which.reshape(-1) == m
            filled, part = values[own].copy(), weight[own]
            gain = np.linalg.solve(covariance[np.ix_(mask, mask)], covariance[mask][:, ~mask]).T
            filled[:, ~mask] = mean[~mask] + (filled[:, mask] - mean[mask]) @ gain.T
            left = covariance[np.ix_(~mask, ~mask)] - gain @ covariance[mask][:, ~mask]
            first += part @ filled
            second += (filled * part[:, None]).T @ filled
            second[np.ix_(~mask, ~mask)] += left * part.sum()
        mean = first
        covariance = second - np.outer(mean, mean) + RIDGE_M**2 * np.eye(size)
    return mean.reshape(-1, 3), 0.5 * (covariance + covariance.T)


def _known(poses: Floats) -> Bools:
    return np.asarray(np.isfinite(poses).all(-1))


def _kind(joint: str) -> str:
    return joint.removeprefix("l_").removeprefix("r_")
