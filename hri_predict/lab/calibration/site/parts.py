"""A site's recordings as units: parts of ten minutes, and the data kept of each.

Windows of one stay resemble each other: the same person, the same work, the same light. So
recordings are cut into parts of ``PART_S`` from their first scene on, and each part with a person
in it counts as one recording, however much happens in it. Parts of one night still resemble each
other more than nights do; they give no guarantee (``mixing``), and the coverage on held-out parts
is that of the same people.

Of each part at most ``STRETCHES`` stretches of ``STRETCH_S`` are used, evenly spread over the
people and the time, and every ``EVERY``-th window of them: a whole night fits the memory.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.predictor import Predictor
from hri_predict.lab.calibration.presence import Presence, of_each
from hri_predict.lab.calibration.scores import HISTORY_STEPS, Scores, evidence_of, score_presence
from hri_predict.recording.recording import Recording
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.learned_scale import LearnedScale
from hri_predict.zones.motion_class import SPEED_CLASSES, speed_class
from hri_predict.zones.motion_ranges import motion_ranges

PART_S = 600.0
STRETCH_S = 10.0
STRETCHES = 12
EVERY = 3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Part:
    """Data kept of a part. W windows, H steps, J joints.

    Attributes:
        name: the recording's, and the minute at which the part begins.
        digest: digest of the recording's file.
        error_m, scale_m: (W, H, J) metres.
        speeds: (W,) speed class.
        fastest_m_s: (J,) highest speed of each joint; NaN where not measured.
    """

    name: str
    digest: str | None
    error_m: Floats
    scale_m: Floats
    speeds: Ints
    fastest_m_s: Floats

    @property
    def windows(self) -> tuple[int, ...]:
        """Number of windows in each speed class."""
        return tuple(np.bincount(self.speeds, minlength=len(SPEED_CLASSES)).tolist())


def score_parts(
    *,
    predictor: Predictor,
    base: Calibration,
    files: Sequence[Path | Recording],
    joint_map: JointMap | None = None,
    on_recording: Callable[[str], None] = lambda _: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Part]:
    """Score a predictor on the site's recordings, in their order; recordings without people, too
    slow or of unknown joints are left out.

    Args:
        predictor: on canonical joints; its horizon is that of ``base``.
        base: its scale is used.
        files: recordings, or their files.
        joint_map: the user's own for the files' joints; default: found by their names.
        on_recording: called with the name of each recording when it is done.
        on_left_out: called with one line for each recording that is left out.

    Raises:
        RecordingError: a file cannot be read, or none can be used.
        PredictorError: the predictor breaks its contract.
    """
    learned = LearnedScale(base.scale, predictor.skeleton, predictor.rate_hz, base.steps)

    def scale(entry: Scores) -> Floats:
        plain = learned(evidence_of(entry))
        return plain if base.shape is None else base.shape.of(plain, speed_class(entry.speed_m_s))

    def of(name: str, recording: Recording, presences: Sequence[Presence]) -> list[Part]:
        here = []
        for index, stretches in sorted(_stretches(presences, recording.scenes[0].stamp_ns).items()):
            part_name = f"{name} from minute {round(index * PART_S / 60)}"
            scored = [
                score_presence(predictor, part_name, recording.action, each)
                for each in _chosen(stretches)
            ]
            known = [entry for entry in scored if entry is not None]
            if known:
                here.append(
                    _part(
                        name=part_name,
                        digest=recording.digest,
                        known=known,
                        scale=scale,
                        rate_hz=predictor.rate_hz,
                    )
                )
        return here

    found, left_out = of_each(
        files,
        of,
        joint_map=joint_map,
        nobody="no person is seen for a second without a break",
        on_recording=on_recording,
        on_left_out=on_left_out,
    )
    if not found:
        raise RecordingError(
            f"{left_out[0]}, and no other recording is left; record while people work"
        )
    return found


def _stretches(presences: Sequence[Presence], start_ns: int) -> dict[int, list[Presence]]:
    """Number of the part -> its stretches, person by person and in order."""
    found: dict[int, list[Presence]] = {}
    for presence in presences:
        stretch = (presence.stamps_ns - start_ns) // round(STRETCH_S * 1e9)
        cuts = np.flatnonzero(np.diff(stretch)) + 1
        for captures in np.split(np.arange(len(stretch)), cuts):
            part = int(stretch[captures[0]] // round(PART_S / STRETCH_S))
            found.setdefault(part, []).append(
                Presence(
                    presence.stamps_ns[captures],
                    presence.positions[captures],
                    presence.observed[captures],
                    presence.rate_hz,
                )
            )
    return found


def _chosen(stretches: Sequence[Presence]) -> list[Presence]:
    """At most ``STRETCHES`` of them, evenly spread; those of half a second or less never count."""
    long = [s for s in stretches if s.stamps_ns[-1] - s.stamps_ns[0] > 500_000_000]
    count = min(len(long), STRETCHES)
    return [long[i * len(long) // count] for i in range(count)]


def _part(
    *,
    name: str,
    digest: str | None,
    known: Sequence[Scores],
    scale: Callable[[Scores], Floats],
    rate_hz: float,
) -> Part:
    history = np.concatenate([entry.history[:, -HISTORY_STEPS:] for entry in known])
    observed = np.concatenate([entry.observed[:, -HISTORY_STEPS:] for entry in known])
    ranges = motion_ranges(history, observed, rate_hz, ratio_short=1.0)
    small = np.float32  # a night of windows must fit the memory
    return Part(
        name=name,
        digest=digest,
        error_m=np.concatenate([entry.error_m[::EVERY].astype(small) for entry in known]),
        scale_m=np.concatenate([scale(entry)[::EVERY].astype(small) for entry in known]),
        speeds=np.concatenate([speed_class(entry.speed_m_s[::EVERY]) for entry in known]),
        fastest_m_s=ranges.speed_m_s,
    )
