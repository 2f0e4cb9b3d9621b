"""Recordings from scenes that a test made."""

from collections.abc import Sequence
from pathlib import Path

from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.scene import Scene
from hri_predict.recording.recording import Recording


def of_scenes(
    scenes: Sequence[Scene],
    joint_map: JointMap,
    rate_hz: float,
    arrival_ns: Sequence[int] | None = None,
    kind: str = "csv",
) -> Recording:
    """A recording as a reader makes it; scenes arrive at their stamps, unless told otherwise."""
    return Recording(
        path=Path("x"),
        kind=kind,
        joint_map=joint_map,
        rate_hz=rate_hz,
        scenes=scenes,
        arrival_ns=[scene.stamp_ns for scene in scenes] if arrival_ns is None else arrival_ns,
    )
