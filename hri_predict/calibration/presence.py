"""Presences: the unbroken times that one person was seen in a recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.arrays import Bools, Floats, Ints
from hri_predict.errors import RecordingError
from hri_predict.recording.recording import Recording

LEAST_RATE_HZ = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Presence:
    """One person's unbroken presence in a recording, on canonical joints.

    Attributes:
        stamps_ns: (F,) captures.
        positions: (F, J, 3) metres; 0 where not observed.
        observed: (F, J).
        rate_hz: nominal captures per second.
    """

    stamps_ns: NDArray[np.int64]
    positions: Floats
    observed: Bools
    rate_hz: float

    def only(self, captures: Ints) -> "Presence":
        """Some of the captures alone, at their own mean rate."""
        stamps = self.stamps_ns[captures]
        span_s = float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0
        rate_hz = (len(stamps) - 1) / span_s if span_s > 0 else self.rate_hz
        return Presence(stamps, self.positions[captures], self.observed[captures], rate_hz)


def presences_of(recording: Recording) -> list[Presence]:
    """Every person of a recording, split at gaps that are not bridged.

    Raises:
        RecordingError: it has too few captures per second.
    """
    if recording.rate_hz < LEAST_RATE_HZ:
        raise RecordingError(
            f"recording {recording.path}: {recording.rate_hz:.3g} captures per second are too few "
            f"to show what happened between two steps; give one of {LEAST_RATE_HZ:g} or more"
        )
    people: dict[int, list[tuple[int, Floats, Bools]]] = {}
    for scene in recording.scenes:
        for person in scene.people:
            samples = people.setdefault(person.id, [])
            if not samples or scene.stamp_ns > samples[-1][0]:
                joints, seen = recording.joint_map.map(person.positions, person.observed)
                seen = seen & np.isfinite(joints).all(-1)
                samples.append((scene.stamp_ns, np.where(seen[:, None], joints, 0.0), seen))
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
