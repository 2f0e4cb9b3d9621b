"""Comparison of a forecast with the actual motion."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.explaining.bodies import Offset, SeenPerson, people_of, place_at
from hri_predict.explaining.values import listed, whole
from hri_predict.explaining.window import TimeWindow, newest
from hri_predict.recording import RecordingInfo, Told

HORIZONS_S = (0.2, 0.4, 0.8)
_NEAR_S = 0.021
"""Maximum difference between a recorded step and a horizon: half a step at 25 Hz."""


def forecast_of(told: Told, person: int) -> tuple[int, list[int], Floats] | None:
    """Capture (node's clock), steps, and (len(steps), J, 3) of one person's forecast."""
    ids, captures = listed(told.data.get("ids")), listed(told.data.get("capture_ns"))
    if person not in ids or len(captures) != len(ids):
        return None
    row = ids.index(person)
    steps = [k for k in listed(told.data.get("steps")) if whole(k) is not None]
    try:
        positions = np.array(told.data["positions"][row], dtype=np.float64)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        return None
    if positions.shape != (len(steps), len(JOINTS), 3) or whole(captures[row]) is None:
        return None
    return captures[row], steps, positions


def error_at(
    *,
    capture_ns: int,
    ahead_s: float,
    predicted: Floats,
    track: Sequence[SeenPerson],
    offset_ns: int,
) -> Floats | None:
    """(J,) metres, NaN where not observed; ``None``: the person was not observed at that
    time.
    """
    there = place_at(track, capture_ns + round(ahead_s * 1e9) - offset_ns)
    if there is None or not there[1].any():
        return None
    positions, observed = there
    error: Floats = np.linalg.norm(predicted - positions, axis=-1)
    return np.where(observed, error, np.nan)


def hindsight(
    window: TimeWindow, info: RecordingInfo, utc_ns: int, *, person: int | None, segment: str
) -> dict[str, Any] | None:
    """Return one person's forecast at an instant and its errors; ``None`` without a forecast.

    Errors are in metres: the mean of all observed joints (``mean_m``), and the larger
    error of the deciding segment's two joints (``segment_m``).
    """
    told = None if person is None else newest(window.forecasts, utc_ns, 1.0)
    made = None if told is None or person is None else forecast_of(told, person)
    if told is None or made is None or person is None or info.forecast_rate_hz <= 0:
        return None
    offset, track = _offset_and_track(window, info, person)
    if offset.ns is None:
        return None
    capture_ns, steps, positions = made
    result: dict[str, Any] = {
        "person": person,
        "made_utc_ns": told.utc_ns,
        "predictor": info.predictor,
        "errors": [],
    }
    for horizon_s in HORIZONS_S:
        ahead = [(step + 1) / info.forecast_rate_hz for step in steps]
        close = [k for k, s in enumerate(ahead) if abs(s - horizon_s) <= _NEAR_S]
        if not close:
            continue
        error = error_at(
            capture_ns=capture_ns,
            ahead_s=ahead[close[0]],
            predicted=positions[close[0]],
            track=track,
            offset_ns=offset.ns,
        )
        result["errors"].append({"ahead_s": ahead[close[0]], **_figures(error, segment)})
    return result


def _figures(error: Floats | None, segment: str) -> dict[str, float | None]:
    if error is None:
        return {"mean_m": None, "segment_m": None}
    ends = [(s.joint_a, s.joint_b) for s in CANONICAL.segments if s.name == segment]
    of_segment = error[list(ends[0])] if ends else np.array([np.nan])
    worst = None if np.isnan(of_segment).all() else round(float(np.nanmax(of_segment)), 3)
    return {"mean_m": round(float(np.nanmean(error)), 3), "segment_m": worst}


def _offset_and_track(
    window: TimeWindow, info: RecordingInfo, person: int
) -> tuple[Offset, list[SeenPerson]]:
    offset, track = Offset(), list[SeenPerson]()
    stamps: dict[int, int] = {}
    events = sorted([*window.scenes, *window.forecasts], key=lambda told: told.utc_ns)
    for told in events:
        if told.topic == "/forecast":
            offset.learn(told, stamps)
            continue
        for seen in people_of(told, info.joint_map):
            stamps[seen.person] = seen.stamp_ns
            if seen.person == person and (not track or seen.stamp_ns > track[-1].stamp_ns):
                track.append(seen)
    return offset, track
