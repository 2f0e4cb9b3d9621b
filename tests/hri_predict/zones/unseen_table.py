"""Share of true joints held where a tracker does not see them: ``docs/measured/unseen-joints.md``.

    python -m tests.hri_predict.zones.unseen_table ../shared/data [--predictor sinn] [--level 0.99]
        [--only arm] [--steps 1 --steps 3]

Joints are hidden for the whole recording, or with ``--steps`` only in the last steps of a history.
They are inferred, forecast, and compared with the truth: within the zone, and within its extent in
nearly horizontal directions and along the forecast motion.
"""

import argparse
import itertools
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

import hri_predict as hri
from hri_predict.base.skeleton import CANONICAL
from hri_predict.lab.calibration.body_model import HIDDEN, hidden_joints
from hri_predict.lab.calibration.scores import Scores, evidence_of, score_recordings
from hri_predict.lab.calibration.toward import truth_at
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.inferred import Inference
from hri_predict.people.inferring import with_inferred
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.learned_scale import Evidence
from hri_predict.zones.loops.spheres import UNSEEN
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import CoverageSettings
from hri_predict.zones.toward import direction_class, ways

SETS = ("test", "test_motion", "left_out")
SHOWN = (
    "feet", "legs below the hips", "all below the waist", "hands", "all that COCO-17 lacks",
    "left arm", "right arm", "forearms",
)  # fmt: skip
AT_S = (0.2, 0.4, 0.6, 1.0)
EACH = 6
"""Every sixth window of a recording is judged."""


def completed(history: Any, seen: Any, rate_hz: float) -> Any:
    """The snapshot of bodies (P, T, J, 3), seen (P, T, J), with its inferred joints."""
    people, _, joints = seen.shape
    snapshot = PeopleSnapshot(
        now_ns=0,
        ids=tuple(range(people)),
        history=history,
        observed=seen,
        capture_ns=np.zeros(people, np.int64),
        last_positions=history[:, -1],
        joint_age_s=np.zeros((people, joints)),
        lost=(),
        reasons=(),
        newest_capture_ns=0,
        captures=1,
        counters={},
    )
    return with_inferred(snapshot, Inference(body_model()), rate_hz)


def judged(scored: Scores, predictor: Any, radii: Radii, hidden: Any, last: int | None) -> Any:
    """(3, steps) hits and (steps,) counts of the hidden joints of one recording.

    They are hidden in the ``last`` steps of each history, or in all.
    """
    rows = slice(None, None, EACH)
    seen = scored.observed[rows].copy()
    was_seen = seen.all(1) & hidden  # else other steps than the last may be hidden, too
    seen[:, slice(None) if last is None else slice(-last, None)] &= ~hidden
    history = np.where(seen[..., None], scored.history[rows], 0.0)
    filled = completed(history, seen, predictor.rate_hz)
    own = slice(-predictor.history_steps, None)
    made = predictor.predict(filled.history[:, own], filled.observed[:, own])
    forecast = made.positions
    base = evidence_of(scored)
    past = np.array(base.error_m[rows])
    past[..., hidden] = np.nan
    evidence = Evidence(
        history=filled.history,
        observed=filled.observed,
        forecast=forecast,
        error_m=past,
        residual_m=base.residual_m[rows],
        std=made.std,
    )
    speed = scored.speed_m_s[rows]
    claimed, shares = radii.of(speed, evidence), radii.shares(speed)
    assert shares is not None
    truth = truth_at(scored, forecast.shape[1], predictor.rate_hz)[rows]
    error = truth - forecast
    way = ways(forecast - filled.history[:, -1:])
    flat = np.random.default_rng(0).normal(size=error.shape) * [1.0, 1.0, 0.3]
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    moving = (np.abs(way).sum(-1) > 0) & (np.abs(way[..., 2]) < 0.6)
    ahead = np.where(moving[..., None], way, flat)
    within = filled.inferred.within_m[:, None]

    def held(direction: Any) -> Any:
        share = np.take_along_axis(shares, direction_class(direction, way), axis=2)
        extent = UNSEEN * np.hypot(share * claimed, within)
        return np.einsum("whji,whji->whj", error, direction) <= extent

    known = np.isfinite(error).all(-1) & np.isfinite(claimed)
    known &= (filled.observed[:, -1] & (hidden if last is None else was_seen))[:, None]
    ball = np.linalg.norm(error, axis=-1) <= UNSEEN * np.hypot(claimed, within)
    hits = np.array([(each & known).sum((0, 2)) for each in (ball, held(flat), held(ahead))])
    return hits, known.sum((0, 2))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("--predictor", default="sinn")
    parser.add_argument("--only", default="", help="joints whose title contains this")
    parser.add_argument("--level", type=float, default=0.99)
    parser.add_argument(
        "--steps", type=int, action="append", help="hide joints only in this many last steps"
    )
    options = parser.parse_args()
    predictor = hri.load_predictor(options.predictor, horizon_s=1.2)
    calibration = hri.load_calibration_of(options.predictor, horizon_s=1.2)
    assert calibration is not None
    radii = Radii(calibration, CoverageSettings(level=options.level), CANONICAL, 30)
    steps = [round(at * predictor.rate_hz) - 1 for at in AT_S]
    print("| not seen | set |", " | ".join(f"{at * 1000:.0f} ms" for at in AT_S), "|")
    for name in SETS:
        paths = [p for p in (in_pack(options.data, n) for n in split(name)) if p.exists()]
        scored = score_recordings(predictor, paths)
        shown = [each for each in SHOWN if options.only in each]
        for title, last in itertools.product(shown, options.steps or [None]):
            total: dict[str, Any] = defaultdict(float)
            for each in scored:
                hits, count = judged(each, predictor, radii, hidden_joints(HIDDEN[title]), last)
                total["hits"], total["count"] = total["hits"] + hits, total["count"] + count
            shares = 100 * total["hits"][:, steps] / np.maximum(total["count"][steps], 1)
            cells = [" / ".join(f"{v:.1f}" for v in column) for column in shares.T]
            when = "" if last is None else f", {last} steps"
            print(f"| {title}{when} | {name} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
