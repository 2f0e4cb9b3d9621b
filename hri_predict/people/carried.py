"""Carries briefly unseen shoulders and hips along with the rest of the body.

Without both shoulders or both hips a body has no heading, and hidden joints cannot be inferred. A
tracker loses a shoulder for a few captures at a time, so the last seen pair is used instead, moved
as the head, or all seen joints, have moved since. If little else of the body is seen, no pair is
carried.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.body.body_model import LEAST_JOINTS

PER_S = 1.5
"""Growth of a carried joint's error in metres per second: holds for 99 % of shoulders and hips up
to 0.5 s, carried by the head or the arms, in the recordings of the data pack (fit and test,
including people who run, dance and jump)."""
LONGEST_S = 0.3
"""Maximum time for which a pair is carried."""
_PAIRS = tuple(
    np.array([JOINTS.index(f"{side}_{joint}") for side in ("l", "r")])
    for joint in ("shoulder", "hip")
)
_HEAD = np.array([JOINTS.index(name) for name in ("head", "head_top")])


class Carried(NamedTuple):
    """Bodies with carried joints: positions (P, T, J, 3), whether joints are seen or carried (P, T,
    J), and (P, T, J) maximum error of a carried joint in metres; 0 for all others."""

    positions: Floats
    observed: Bools
    within_m: Floats


def carry(positions: Floats, measured: Bools, rate_hz: float) -> Carried:
    """Carry the last seen pair through steps without a complete pair.

    Args:
        positions: (P, T, J, 3) metres, finite, in the room; any value where not measured.
        measured: (P, T, J).
        rate_hz: steps per second.
    """
    found = Carried(positions.copy(), measured.copy(), np.zeros(measured.shape))
    whole = np.stack([measured[..., pair].all(-1) for pair in _PAIRS], axis=-1)  # (P, T, 2)
    step = np.arange(measured.shape[1])[:, None]
    last = np.maximum.accumulate(np.where(whole, step, -1), axis=1)
    age_s = (step - last) / rate_hz
    due = ~whole.any(-1) & (measured.sum(-1) >= LEAST_JOINTS)
    newest = last.argmax(-1)  # the shoulders, if both were seen then
    for number, pair in enumerate(_PAIRS):
        carries = due & (newest == number) & (last[..., number] >= 0)
        carries &= age_s[..., number] <= LONGEST_S + 1e-9
        turned = _turned(positions, whole[..., number], pair)
        for person, at in np.argwhere(carries):
            since = last[person, at, number]
            if turned[person, since]:
                continue
            shift = _shift(positions[person], measured[person], since, at)
            if shift is None:
                continue
            missing = pair[~measured[person, at, pair]]
            found.positions[person, at, missing] = positions[person, since, missing] + shift
            found.observed[person, at, missing] = True
            found.within_m[person, at, missing] = PER_S * age_s[person, at, number]
    return found


def _turned(positions: Floats, whole: Bools, pair: NDArray[np.intp]) -> Bools:
    """Return (P, T) whether a pair points in the opposite direction of one or two steps before:
    left and right were swapped in one of them, and the body would be completed back to front."""
    across = positions[:, :, pair[0]] - positions[:, :, pair[1]]
    found = np.zeros_like(whole)
    for lag in (1, 2):
        against = np.einsum("pti,pti->pt", across[:, lag:], across[:, :-lag]) < 0
        found[:, lag:] |= whole[:, lag:] & whole[:, :-lag] & against
    return found


def _shift(positions: Floats, measured: Bools, since: int, at: int) -> Floats | None:
    """Return (3,) motion of a body (T, J, 3) between two steps; ``None``: no common joint."""
    both = measured[since] & measured[at]
    head = both[_HEAD]
    of = _HEAD[head] if head.any() else np.flatnonzero(both)
    if not of.size:
        return None
    moved: Floats = (positions[at, of] - positions[since, of]).mean(0)
    return moved
