"""Fits the distribution of postures: ``people/body/body_model.py``.

The mean and the covariance are those of largest likelihood for poses of which some joints are not
known: expectation maximisation (A. Dempster et al., "Maximum likelihood from incomplete data via
the EM algorithm", JRSS B 39 (1977) 1). Each pose counts mirrored as well. A recording counts by the
square root of its length, because its poses resemble each other.

The factors come from recordings that were not fitted: the share ``HELD`` of the errors over the
standard deviation, of each joint without its side, over the ``HIDDEN`` sets of joints, recordings
with equal weights.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.quantiles import of_equals
from hri_predict.people.body.body_model import BodyModel, HeadingFrame

HELD = 0.99
ODD = 0.999
"""Share of the poses that are completed."""
ROUNDS = 30
UNKNOWN = 6.0
"""Factor of joints that no entry of ``HIDDEN`` hides."""
RIDGE_M = 0.01
"""Standard deviation that every coordinate has at least: skeletons place joints differently."""

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
}
"""Joints that a tracker does not see: whole names, or without their side for both."""


def hidden_joints(names: Sequence[str]) -> Bools:
    """(J,) the joints of an entry of ``HIDDEN``."""
    found = [j in names or j.removeprefix("l_").removeprefix("r_") in names for j in JOINTS]
    return np.array(found)


def fit_body_model(
    poses: Mapping[str, Floats], others: Mapping[str, Floats]
) -> tuple[BodyModel, dict[str, dict[str, float]]]:
    """Fit the model, and judge it by other recordings.

    Args:
        poses: (N, J, 3) metres by recording, z up, floor at 0; NaN where not known.
        others: the same, of recordings that give the factors.

    Returns:
        The model; and by entry of ``HIDDEN`` and joint, metres that hold ``HELD`` of ``others``.
    """
    mean, covariance = _likeliest(list(poses.values()))
    plain = BodyModel(mean, covariance, np.ones(len(JOINTS)))
    odd = [plain.oddness(np.nan_to_num(p), _known(p)) for p in others.values()]
    ratios, errors = _errors(plain, others)
    factor = np.array(
        [of_equals(ratios[_kind(j)], HELD) if ratios[_kind(j)] else 6.0 for j in JOINTS]
    )
    model = BodyModel(mean, covariance, factor, of_equals(odd, ODD))
    return model, errors


def _errors(
    model: BodyModel, others: Mapping[str, Floats]
) -> tuple[dict[str, list[Floats]], dict[str, dict[str, float]]]:
    ratios: dict[str, list[Floats]] = {_kind(j): [] for j in JOINTS}
    errors: dict[str, dict[str, float]] = {}
    for title, names in HIDDEN.items():
        hidden = hidden_joints(names)
        own: dict[str, list[Floats]] = {}
        for pose in others.values():
            known = _known(pose)
            found = model.complete(np.nan_to_num(pose), known & ~hidden)
            off = np.linalg.norm(found.positions - np.nan_to_num(pose), axis=-1)
            for joint in np.flatnonzero(hidden):
                rows = found.usable & known[:, joint]
                if rows.any():
                    kind = _kind(JOINTS[joint])
                    ratios[kind].append(off[rows, joint] / found.within_m[rows, joint])
                    own.setdefault(kind, []).append(off[rows, joint])
        errors[title] = {kind: round(of_equals(each, HELD), 3) for kind, each in own.items()}
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
