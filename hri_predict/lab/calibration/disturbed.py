"""The live self-check on motion unlike the calibration: noise, a wrong scale, a moved camera.

The first recording of each action is disturbed as a whole (``disturbances``) and run through the
zones, with and without the self-check. The zones must hold the body as the sensor places it, but
without noise: motion cannot reveal a camera that was moved long ago, or a wrong but possible scale.
``hri-predict check --touched`` detects those.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hri_predict.base.skeleton import CANONICAL
from hri_predict.lab.calibration.coverage import Calibrated, as_run, run_zones
from hri_predict.lab.calibration.presence import Presence
from hri_predict.lab.calibration.scores import Scores, score_presence
from hri_predict.lab.datasets.disturbances import DISTURBED_S, Disturbance, standard
from hri_predict.lab.evaluation.table import Table, percent
from hri_predict.zones.settings import CoverageSettings

SHIFT_SHARE = 0.5
"""Time of the camera's move, as a share of the shortest recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbed:
    """One condition of one recording, the whole body at 99 %, shares from 0 to 1.

    Attributes:
        condition, recording: the disturbance and the recording.
        without, with_check: coverage at 400 ms without and with the self-check.
        widened, unlike: shares of windows, with the self-check.
        noticed_s: from the shift to the first window that was widened or unlike; ``None`` without
            a shift, or if the self-check did not notice it.
    """

    condition: str
    recording: str
    without: float
    with_check: float
    widened: float
    unlike: float
    noticed_s: float | None


def judge_disturbed(
    calibrated: Calibrated,
    scores: Sequence[Scores],
    on_part: Callable[[str], None] = lambda _: None,
) -> list[Disturbed]:
    """Run every condition of ``disturbances.standard``."""
    chosen = list({s.action: s for s in reversed(scores)}.values())[::-1]
    shortest_s = min(float(s.origin_ns[-1] - s.truth.stamps_ns[0]) * 1e-9 for s in chosen)
    found = []
    for disturbance in standard(shift_at_s=SHIFT_SHARE * shortest_s):
        for entry in chosen:
            on_part(f"{disturbance.name}, {entry.name}")
            one = _one(calibrated, entry, disturbance)
            if one is not None:
                found.append(one)
    return found


def _one(calibrated: Calibrated, entry: Scores, disturbance: Disturbance) -> Disturbed | None:
    truth, predictor = entry.truth, calibrated.predictor
    trunk = list(CANONICAL.parts["torso"])
    moved = disturbance.apply(truth.positions, truth.observed, truth.stamps_ns, trunk)
    seen = Presence(truth.stamps_ns, moved, truth.observed, truth.rate_hz)
    scored = score_presence(predictor, entry.name, entry.action, seen)
    if scored is None:
        return None
    if disturbance.kind == "noise":  # the body itself does not shake
        scored = replace(scored, truth=truth)
    settings = CoverageSettings(of="body")
    step = round(DISTURBED_S * predictor.rate_hz) - 1
    shares = []
    for check in (False, True):
        own = settings.model_copy(update={"self_check": check})
        coverage = as_run([scored], calibrated, own)
        shares.append(float(coverage.share("body")[step]))
    noticed = None
    if disturbance.kind == "shift":
        noticed = _noticed_s(scored, calibrated, settings, disturbance.at_s)
    return Disturbed(
        condition=disturbance.name,
        recording=entry.name,
        without=shares[0],
        with_check=shares[1],
        widened=coverage.widened,
        unlike=coverage.unlike,
        noticed_s=noticed,
    )


def _noticed_s(
    scored: Scores, calibrated: Calibrated, settings: CoverageSettings, at_s: float
) -> float | None:
    """Seconds from the shift to the first window that is unlike, or wider than it was before."""
    since = (scored.origin_ns - scored.truth.stamps_ns[0]) * 1e-9 - at_s
    before = 1.0
    for t, (_, trust) in zip(since, run_zones(scored, calibrated, settings), strict=True):
        largest = float(trust.widen.max())
        if t >= 0 and (trust.out_of_distribution.any() or largest > before + 1e-9):
            return float(t)
        before = largest
    return None


def tables(found: Sequence[Disturbed]) -> list[Table]:
    """One table with every condition and recording."""
    columns = (
        "condition",
        "recording",
        "held at 400 ms",
        "with self-check",
        "widened",
        "unlike",
        "noticed",
    )
    rows = tuple(
        (
            one.condition,
            one.recording,
            *(percent(v) for v in (one.without, one.with_check, one.widened, one.unlike)),
            "–" if one.noticed_s is None else f"after {one.noticed_s:.2f} s",
        )
        for one in found
    )
    title = "Disturbed: whole body at 99 %, shares of windows in %"
    return [Table(title, columns, rows)]


def as_json(found: Sequence[Disturbed]) -> list[dict[str, Any]]:
    """For programs."""
    return [
        {
            "condition": one.condition,
            "recording": one.recording,
            "without": _plain(one.without),
            "with_check": _plain(one.with_check),
            "widened": one.widened,
            "unlike": one.unlike,
            "noticed_s": one.noticed_s,
        }
        for one in found
    ]


def _plain(share: float) -> float | None:
    return round(share, 5) if np.isfinite(share) else None
