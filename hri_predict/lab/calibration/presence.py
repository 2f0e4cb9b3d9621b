"""Presences: the unbroken times that one person was seen in a recording.

**As other trackers would deliver them**: most recordings come from optical motion capture, with 120
captures a second and noise below a millimetre. Zones calibrated on these alone would be too small
for a camera's tracker, and all of its captures would seem unlike the calibration. So a calibration
also uses each recording once as simulated by ``as_tracked``: at a lower rate, noisier, with gaps,
and half of them with late stamps. The truth keeps the noise and the lateness, because the node
compares its zones with such captures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.errors import UnusableRecordingError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.recording.one_clock import timed
from hri_predict.recording.opening import opened
from hri_predict.recording.recording import Recording, names_of

Used = TypeVar("Used")

LEAST_RATE_HZ = 20.0

FASTEST_HZ = 35.0
"""Maximum number of captures per second; others are left out before noise is added."""
EVERY = (1, 1, 2, 3, 4)
"""The tracker delivers every n-th of those captures; n is drawn from these."""
WHITE_M, SLOW_M = (0.0, 0.02), (0.0, 0.02)
"""Ranges of the standard deviation per coordinate, of white noise and of correlated noise."""
WANDERS_S = 0.3
"""Correlation time of the correlated noise."""
LATE_S = 0.03
"""Largest lateness of stamps. Half of the trackers stamp each capture late, by a time that is
uniformly distributed up to the tracker's own maximum."""
LOST = 0.03
"""Share of captures that are not delivered, and of joints that are not observed in a capture."""


@dataclass(frozen=True, slots=True, eq=False)
class Presence:
    """One person's unbroken presence in a recording, on canonical joints.

    Attributes:
        stamps_ns: (F,) captures; see ``timed``.
        positions: (F, J, 3) metres; 0 where not observed.
        observed: (F, J).
        rate_hz: nominal captures per second.
    """

    stamps_ns: NDArray[np.int64]
    positions: Floats
    observed: Bools
    rate_hz: float

    def only(self, captures: Ints) -> "Presence":
        """Only the chosen captures, at their own mean rate."""
        stamps = self.stamps_ns[captures]
        span_s = float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0
        rate_hz = (len(stamps) - 1) / span_s if span_s > 0 else self.rate_hz
        return Presence(stamps, self.positions[captures], self.observed[captures], rate_hz)


def presences_of(recording: Recording) -> list[Presence]:
    """Every person of a recording, split at gaps that are not bridged.

    Raises:
        UnusableRecordingError: it has too few captures per second.
    """
    if recording.rate_hz < LEAST_RATE_HZ:
        raise UnusableRecordingError(
            f"recording {recording.path}: {recording.rate_hz:.3g} captures per second are too few "
            f"to show what happened between two steps; give one of {LEAST_RATE_HZ:g} or more"
        )
    people: dict[int, list[tuple[int, Floats, Bools]]] = {}
    for time_ns, scene in timed(recording):
        for person in scene.people:
            samples = people.setdefault(person.id, [])
            if not samples or time_ns > samples[-1][0]:
                joints, seen = recording.joint_map.map(person.positions, person.observed)
                seen = seen & np.isfinite(joints).all(-1)
                samples.append((time_ns, np.where(seen[:, None], joints, 0.0), seen))
    found = []
    for samples in people.values():
        samples = [s for s in samples if s[2].any()]
        stamps = np.array([s[0] for s in samples], dtype=np.int64)
        breaks = np.flatnonzero(np.diff(stamps) > gap_ns(recording.rate_hz)) + 1
        parts = [p for p in np.split(np.arange(len(samples)), breaks) if p.size]
        found += [
            Presence(
                stamps[part],
                np.stack([samples[i][1] for i in part]),
                np.stack([samples[i][2] for i in part]),
                recording.rate_hz,
            )
            for part in parts
        ]
    return found


def gap_ns(rate_hz: float) -> int:
    """The longest gap between captures that is bridged, as in the node's people stage."""
    return round(1e9 * max(0.1, 2.5 / rate_hz))


def as_tracked(presence: Presence, seed: int) -> tuple[Presence, Ints]:
    """Return the presence with noise, and the indices of the captures that the tracker delivers.

    Args:
        presence: as recorded.
        seed: seed of all random draws.
    """
    rng = np.random.default_rng(seed)
    thinned = np.arange(0, len(presence.stamps_ns), max(1, round(presence.rate_hz / FASTEST_HZ)))
    stamps, positions = presence.stamps_ns[thinned], presence.positions[thinned]
    shape = positions.shape
    white = rng.uniform(*WHITE_M) * rng.standard_normal(shape)
    slow = rng.uniform(*SLOW_M) * ar1(rng, np.diff(stamps) * 1e-9, WANDERS_S, shape)
    observed = presence.observed[thinned] & (rng.random(shape[:2]) >= LOST)
    every = int(rng.choice(EVERY))
    delivered = np.arange(0, len(stamps), every)
    delivered = delivered[rng.random(len(delivered)) >= LOST]
    rate_hz = presence.rate_hz / max(1, round(presence.rate_hz / FASTEST_HZ))
    late_ns = 1e9 * LATE_S * max(0.0, rng.uniform(-1.0, 1.0))
    stamps = _rising(stamps + np.round(late_ns * rng.random(len(stamps))).astype(np.int64))
    noisy = np.where(observed[..., None], positions + white + slow, 0.0)
    return Presence(stamps, noisy, observed, rate_hz), delivered


def _rising(stamps: Ints) -> Ints:
    """The stamps, each at least a microsecond after the previous one."""
    apart = 1000 * np.arange(len(stamps))
    found: Ints = np.maximum.accumulate(stamps - apart) + apart
    return found


def ar1(
    rng: np.random.Generator,
    dt_s: Floats,
    lasts_s: float,
    shape: tuple[int, ...],
    *,
    tail: float = np.inf,
) -> Floats:
    """Return correlated noise (F, ...) with standard deviation 1.

    Args:
        rng: random generator for the noise.
        dt_s: (F-1,) seconds between captures.
        lasts_s: correlation time, in which the correlation falls to 1/e.
        shape: F first.
        tail: degrees of freedom of Student's t, above 2; infinite: the normal distribution.
    """
    if np.isfinite(tail):
        found = rng.standard_t(tail, shape) * np.sqrt((tail - 2.0) / tail)
    else:
        found = rng.standard_normal(shape)
    for i, kept in enumerate(np.exp(-dt_s / lasts_s), 1):
        found[i] = kept * found[i - 1] + np.sqrt(1.0 - kept**2) * found[i]
    result: Floats = found
    return result


def of_each(
    entries: Sequence[Path | Recording],
    use: Callable[[str, Recording, Sequence[Presence]], list[Used]],
    *,
    joint_map: JointMap | None,
    nobody: str,
    on_recording: Callable[[str], None],
    on_left_out: Callable[[str], None],
) -> tuple[list[Used], list[str]]:
    """Return the result of ``use`` for each recording, and a line for each that is left out.

    Args:
        entries: files, or recordings in memory.
        use: name, recording, presences -> the parts to use; an empty list leaves the recording out.
        joint_map: the user's own for the files' joints; default: found by their names.
        nobody: the reason given for a recording without any used part.
        on_recording: called with the name of each recording when it is done.
        on_left_out: called with one line for each recording that is left out.

    Raises:
        RecordingError: a file cannot be read, or its content is impossible.
    """
    found: list[Used] = []
    left_out: list[str] = []
    names = names_of([e.path if isinstance(e, Recording) else e for e in entries])
    for entry, name in zip(entries, names, strict=True):
        used, problem = of_one(entry, lambda *its: use(name, *its), joint_map, nobody)  # noqa: B023
        if problem:
            left_out.append(problem)
            on_left_out(f"{problem}; left out")
        found += used
        on_recording(name)
    return found, left_out


def of_one(
    entry: Path | Recording,
    use: Callable[[Recording, Sequence[Presence]], list[Used]],
    joint_map: JointMap | None,
    nobody: str,
) -> tuple[list[Used], str]:
    """Return the used part of one recording, and why it is left out, or ""; see ``of_each``.

    Raises:
        RecordingError: it cannot be read, or its content is impossible.
    """
    try:
        recording = opened(entry, joint_map)
        used = use(recording, presences_of(recording))
    except UnusableRecordingError as error:
        return [], str(error)
    return used, "" if used else f"recording {recording.path}: {nobody}"
