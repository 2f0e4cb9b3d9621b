"""Recordings written message by message, as a node of another day or a deceiver might."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.recording.mcap.clocks import VirtualClocks
from hri_predict.recording.mcap.info import FullSpeed
from hri_predict.recording.mcap.items import Item

SECOND = 1_000_000_000
NOON = 1_772_971_200 * SECOND
"""2026-03-08T12:00:00Z."""


def written(
    path: Path,
    messages: Iterable[tuple[float, str, Any]],
    *,
    cell: str = "press",
    utc_ns: int | None = NOON,
    config: str = "",
    full_speed: Mapping[str, FullSpeed] | None = None,
) -> Path:
    """A recording of (seconds, topic, message); at second 0 it is ``utc_ns``, or nobody knows."""
    info = RecordingInfo(
        joint_map=load_joint_map("canonical"),
        rate_hz=30.0,
        declares_noise=False,
        cell=cell,
        robots=(("arm", ("base", "forearm")),),
        config=config,
        full_speed=full_speed or {},
    )
    clocks = VirtualClocks(0, utc_ns)
    with Recorder(path, info, threaded=False, clocks=clocks) as recorder:
        for seconds, topic, message in messages:
            recorder.take(Item(topic, round(seconds * SECOND), _as_it_is, (message,)))
    return path


def _as_it_is(message: Any) -> Any:
    return message


def advice(level: str, reason: str = "NONE", **fields: Any) -> dict[str, Any]:
    """A message on /advice/arm."""
    limit = 1.0 if level in ("CLEAR", "WARN") else 0.25 if level == "SLOW" else 0.0
    return {
        "type": "Advice",
        "name": "arm",
        "robot": 0,
        "level": level,
        "reason": reason,
        "detail": "",
        "speed_limit_m_s": limit,
        "age_s": 0.02,
        "grounds": None,
    } | fields


def told(levels: str, step_s: float = 0.1, **fields: Any) -> list[tuple[float, str, Any]]:
    """Advice after advice: C clear, S slow, X stop, U unknown."""
    names = {
        "C": ("CLEAR", "NONE"),
        "S": ("SLOW", "PERSON_APPROACHING"),
        "X": ("STOP", "PERSON_NEAR"),
        "R": ("STOP", "RELEASE_PENDING"),
        "U": ("UNKNOWN", "INPUT_STALE"),
    }
    return [
        (k * step_s, "/advice/arm", advice(*names[letter], **fields))
        for k, letter in enumerate(levels)
    ]
