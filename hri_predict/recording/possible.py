"""Whether a recording's people can be people: wrong units or axes spoil all that is made of it.

The node refuses such bodies as they come. A recording is judged as a whole, because people lie,
bend and tumble for a while. Its floor is its own, so heights are not judged.
"""

from collections.abc import Iterator

import numpy as np

from hri_predict.arrays import Bools, Floats
from hri_predict.errors import RecordingError
from hri_predict.joint_map import METRES_PER_UNIT
from hri_predict.people.body.posture import posture_of
from hri_predict.people.body.size import is_human_sized, unit_factor
from hri_predict.recording.recording import SELF_EXPLAINED, Recording
from hri_predict.settings import MAX_COORDINATE_M

MOST_SCENES = 1000
"""So many scenes of a recording, evenly over it, say enough."""
PUBLISHED = ("cmu", "assembly")
"""Layouts of the data pack alone, in fixed units and axes: nobody exports them from a tracker."""
TILTED = 0.2
"""Cosine between the sum of everybody's down and gravity below which the axes are wrong."""
COHERENT = 0.3
"""Least length of that sum per length of bones: below, people tumble and show no down."""
MIRRORED_M = 0.025


def check_possible(recording: Recording) -> None:
    """Refuse a recording in which nobody can be as the file says.

    Raises:
        RecordingError: no joint is seen, bodies are not of human size, people never stand, or left
            and right are swapped. The error names the remedy.
    """
    if recording.kind in PUBLISHED:
        return
    bodies = list(_bodies(recording))
    if not bodies:
        if recording.kind in SELF_EXPLAINED:  # an empty room, or people whose joints nobody saw
            return
        raise RecordingError(
            f"recording {recording.path}: no joint of anybody is known: all are missing, or more "
            f"than {MAX_COORDINATE_M:g} m away{_remedy(recording, '--units mm, if it is in mm')}"
        )
    if 2 * sum(not is_human_sized(*body) for body in bodies) > len(bodies):
        raise RecordingError(
            f"recording {recording.path}: bodies are not of human size"
            f"{_remedy(recording, f'--units {_unit(recording, bodies)}')}"
        )
    postures = [posture_of(*body) for body in bodies]
    down = np.sum([posture.down for posture in postures], axis=0)
    bones_m, length = sum(posture.bones_m for posture in postures), float(np.linalg.norm(down))
    if length > COHERENT * bones_m and -down[2] < TILTED * length:
        raise RecordingError(
            f"recording {recording.path}: people lie or hang upside down all the time"
            f"{_remedy(recording, '--axes, such as z,x,y where y is up')}"
        )
    handed = [posture.handed_m for posture in postures if posture.handed_m is not None]
    if handed and np.median(handed) < -MIRRORED_M:
        raise RecordingError(
            f"recording {recording.path}: people have left and right swapped; correct the joints' "
            f"names; if its axes are left-handed (Unity, Unreal)"
            f"{_remedy(recording, '--axes ... --left-handed').removeprefix(';')}"
        )


def _bodies(recording: Recording) -> Iterator[tuple[Floats, Bools]]:
    for scene in recording.scenes[:: -(-len(recording.scenes) // MOST_SCENES)]:
        for person in scene.people:
            joints, seen = recording.joint_map.map(person.positions, person.observed)
            seen = seen & np.isfinite(joints).all(-1)
            if seen.any():
                yield np.where(seen[:, None], joints, 0.0), seen


def _unit(recording: Recording, bodies: list[tuple[Floats, Bools]]) -> str:
    """The unit that would make them human, or all units."""
    now = recording.joint_map.scale_to_m
    by_factor = {metres / now: name for name, metres in METRES_PER_UNIT.items()}
    factor = unit_factor(bodies, by_factor)
    return "|".join(METRES_PER_UNIT) if factor is None else by_factor[factor]


def _remedy(recording: Recording, option: str) -> str:
    if recording.kind in SELF_EXPLAINED:
        return f"; a file of kind {recording.kind} states its own units and axes: leave it out"
    return f"; make a file of it with hri-predict convert INPUT OUT.mcap {option}, and give that"
