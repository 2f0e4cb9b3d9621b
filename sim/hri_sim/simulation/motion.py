"""Motions of the people of an approach, each in its own frame with the floor at z = 0.

A motion is one person's recording, or one procedural script, mapped to canonical joints.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, UnusableRecordingError
from hri_predict.base.skeleton import JOINTS
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.people.script import PersonSettings, Timeline
from hri_sim.replay import RecordingSettings, RecordingSource

PROCEDURAL = "procedural"
"""Prefix of scripted motions: ``procedural:talking`` by name, ``procedural:3`` from a seed."""
_SHOULDERS_M = 1.05
"""Shoulder height of a seated person, for recordings of arms in a camera's frame."""
_NO_FLOOR = "marker_clusters9"
_CROWN_M = 1.71
"""Height of a standing person's crown, for the clusters, whose origin is at about table height.
Mean stature of ANSUR II, see ``hri_predict.base.skeleton``."""
_SHORTEST_S = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """One person's motion with N captures and J canonical joints.

    Attributes:
        name: path of the recording, or ``procedural:SEED``.
        rate_hz: captures per second.
        capture_ns: (N,) from 0 at the first.
        positions: (N, J, 3) metres, z up, floor at 0; NaN where not observed.
        observed: (N, J).
    """

    name: str
    rate_hz: float
    capture_ns: NDArray[np.int64]
    positions: Floats
    observed: Bools

    @property
    def duration_s(self) -> float:
        """Time from the first capture to the last."""
        return float(self.capture_ns[-1]) * 1e-9


@lru_cache(maxsize=64)
def load_motion(
    name: str, rate_hz: float, base_dir: Path | None = None, joint_map: str | None = None
) -> Motion:
    """Read a recording (or play a script) at ``rate_hz``, or at its own rate if that is lower.

    ``joint_map`` is the user's own map for the recording's joints.

    Raises:
        RecordingError: it cannot be read.
        UnusableRecordingError: it has less than one second of a person's motion.
        ConfigError: it is not a motion file.
    """
    if name.startswith(PROCEDURAL + ":"):
        return _procedural(name, rate_hz)
    if name.lower().endswith(".mcap"):
        raise ConfigError(
            f"recording {name}: a node's recording plays in its own room and cannot be placed; "
            f"give motion files (.npz, .bvh)"
        )
    settings = RecordingSettings(kind="recording", path=name, joint_map=joint_map)
    source = RecordingSource(settings, base_dir)
    if source.rate_hz > rate_hz:
        source = RecordingSource(settings.model_copy(update={"rate_hz": rate_hz}), base_dir)
    motion = _collected(name, source)
    if source.recording.kind == "assembly":
        return _lifted(motion, ("l_shoulder", "r_shoulder"), _SHOULDERS_M)
    if source.recording.joint_map.name.startswith(_NO_FLOOR):
        return _lifted(motion, ("head_top",), _CROWN_M)
    return motion


def _collected(name: str, source: RecordingSource | ProceduralSource) -> Motion:
    source.open(0)
    stamps, positions, observed = [], [], []
    while (due_ns := source.next_ns()) is not None:
        scene = source.poll(due_ns)
        assert scene is not None
        joints, seen = np.full((len(JOINTS), 3), np.nan), np.zeros(len(JOINTS), dtype=np.bool_)
        for person in scene.people:
            joints, seen = source.joint_map.map(person.positions, person.observed)
        stamps.append(scene.stamp_ns)
        positions.append(np.where(seen[:, None], joints, np.nan))
        observed.append(seen)
    first = next((i for i, seen in enumerate(observed) if seen.any()), len(stamps))
    stamps, positions, observed = stamps[first:], positions[first:], observed[first:]
    if not stamps:
        raise UnusableRecordingError(f"recording {name}: shows no person; leave it out")
    lasts_s = (stamps[-1] - stamps[0]) * 1e-9
    if lasts_s < _SHORTEST_S:
        raise UnusableRecordingError(
            f"recording {name}: too short: it ends {lasts_s:.2f} s after a person comes into view, "
            f"and an approach needs {_SHORTEST_S:g} s; leave it out"
        )
    capture_ns = np.array(stamps, dtype=np.int64) - stamps[0]
    return Motion(
        name=name,
        rate_hz=source.rate_hz,
        capture_ns=capture_ns,
        positions=np.array(positions),
        observed=np.array(observed),
    )


def _lifted(motion: Motion, joints: Sequence[str], height_m: float) -> Motion:
    """Raise a recording with unknown floor, so that the mean height of its joints is this."""
    chosen = [JOINTS.index(joint) for joint in joints]
    lift = height_m - float(np.nanmean(motion.positions[:, chosen, 2]))
    lifted = motion.positions + np.array([0.0, 0.0, lift])
    return replace(motion, positions=lifted)


def _procedural(name: str, rate_hz: float) -> Motion:
    """Play a script: a named one, or one drawn from the seed."""
    named = name.partition(":")[2]
    person = SCRIPTS[named] if named in SCRIPTS else _drawn(name)
    settings = PersonSettings.model_validate(person | {"repeat": False})
    lasts_s = Timeline(settings, f"motion {name}", True).cycle_s
    played = ProceduralSettings(
        kind="procedural", people=[settings], rate_hz=rate_hz, duration_s=lasts_s
    )
    return _collected(name, ProceduralSource(played))


def _drawn(name: str) -> dict[str, Any]:
    """Draw a script from the seed: a person walks up, reaches out, stays and walks away."""
    try:
        rng = np.random.default_rng([int(name.partition(":")[2]), 0])
    except ValueError as error:
        raise ConfigError(
            f"motion {name}: write procedural:SEED, such as procedural:3, or one of "
            f"{', '.join(SCRIPTS)}"
        ) from error
    walked = float(rng.uniform(2.5, 4.0))
    hand = str(rng.choice(["left", "right"]))
    aside = float(rng.uniform(-0.15, 0.15))
    reach = {
        "do": "reach", "hand": hand, "hold_s": float(rng.uniform(0.2, 1.5)),
        "to": [walked + float(rng.uniform(0.4, 0.55)), aside, float(rng.uniform(0.9, 1.25))],
    }  # fmt: skip
    speed = {"speed_m_s": float(rng.uniform(0.8, 1.6))}
    away = {"do": "walk", "to": [float(rng.uniform(0.5, 1.5)), float(rng.uniform(-1.0, 1.0))]}
    return {
        "start": [0.0, 0.0],
        "height_m": float(rng.uniform(1.6, 1.9)),
        "script": [
            {"do": "walk", "to": [walked, 0.0]} | speed,
            {"do": "wait", "seconds": float(rng.uniform(0.1, 0.6))},
            reach,
            away | speed,
        ],
    }


# -- scripts of people at work beside a robot, by name: they need no recording ---------------------


def _gesture(hand: str, at: tuple[float, float, float], hold_s: float) -> dict[str, Any]:
    """Return a gesture of one hand while talking."""
    ahead, aside, up = at
    to = [-ahead, aside, up]
    return {"do": "reach", "hand": hand, "to": to, "hold_s": hold_s}


def _reach_in() -> dict[str, Any]:
    """Return an easy reach towards the robot and back."""
    return {"do": "reach", "hand": "right", "to": [-0.6, 0.05, 1.05], "hold_s": 0.8}


SCRIPTS: dict[str, dict[str, Any]] = {
    "talking": {
        "start": [0.0, 0.0],
        "yaw": math.pi,  # towards the robot
        "script": [
            {"do": "wait", "seconds": 1.5},
            _gesture("right", (0.35, 0.25, 1.2), 0.6),
            _gesture("left", (0.4, -0.2, 1.25), 0.4),
            {"do": "wait", "seconds": 1.0},
            _gesture("right", (0.4, 0.15, 1.3), 0.3),
            _gesture("right", (0.3, 0.3, 1.15), 0.8),
            {"do": "wait", "seconds": 2.0},
        ],
    },
    "reaching": {
        "start": [0.0, 0.0],
        "yaw": math.pi,  # towards the robot
        "script": [
            {"do": "wait", "seconds": 2.0},
            _reach_in(),
            {"do": "wait", "seconds": 1.5},
            _reach_in(),
            {"do": "wait", "seconds": 2.0},
        ],
    },
    "passing": {
        "start": [0.0, -2.5],
        "script": [
            {"do": "walk", "to": [0.0, 2.5]},
            {"do": "walk", "to": [0.0, -2.5]},
        ],
    },
}
"""``PersonSettings`` of each named script."""
