"""Checks whether a recording's people are plausible: wrong units or axes make it useless.

The node rejects implausible bodies one by one. A recording is judged as a whole, because people
lie, bend and tumble for a while. Heights are not judged, because its floor may differ from the
room's.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import LostRecordingError, RecordingError
from hri_predict.base.settings import MAX_COORDINATE_M
from hri_predict.contracts.scene import Scene
from hri_predict.people.body.axes import standing_axes
from hri_predict.people.body.posture import posture_of
from hri_predict.people.body.size import most_are_not_human_sized
from hri_predict.people.body.stature import fitting_unit, is_adult, stature_m
from hri_predict.recording.recording import SELF_EXPLAINED, Recording, converted_by

MOST_SCENES = 1000
"""Number of scenes judged, spread evenly over a recording."""
PUBLISHED = ("cmu", "assembly")
"""Layouts of the data pack alone, in fixed units and axes: no tracker exports them."""
TILTED = 0.2
"""Cosine between the sum of all bodies' down and gravity below which the axes are wrong."""
COHERENT = 0.3
"""Minimum length of that sum per length of bones: below, people tumble and show no down."""
MIRRORED_M = 0.025
_SMALL = 1e-100
"""Factor of the unit with which no joint of any unit is too far away."""

Reopened = Callable[[float], Recording]
_Bodies = list[tuple[Floats, Bools]]


def check_possible(recording: Recording, reopened: Reopened | None = None) -> None:
    """Reject a recording with implausible people.

    Args:
        recording: as it was read.
        reopened: reads the file again with other metres per unit: where joints are too far away
            to be believed, a remedy needs them.

    Raises:
        RecordingError: no joint is seen, bodies are not of human size, people never stand, or left
            and right are swapped. The error names the remedy for all of it.
    """
    _check(recording, reopened, whole=True)


def check_size(recording: Recording, reopened: Reopened | None = None) -> None:
    """Refuse a recording without any joint, or with bodies that are not of human size.

    For a replay: there the node itself judges how people stand, as its configuration asks. A node's
    own recording plays unchanged, regardless of its content.

    Raises:
        RecordingError: as ``check_possible``.
    """
    if not recording.in_room:
        _check(recording, reopened, whole=False)


def _check(recording: Recording, reopened: Reopened | None, *, whole: bool) -> None:
    if recording.kind in PUBLISHED or not recording.joint_map.mapped.any():
        return
    bodies = list(_bodies(recording))
    bodies, lost = _whole(recording, bodies, reopened)
    if not bodies:
        if recording.kind in SELF_EXPLAINED:  # an empty room, or people whose joints nobody saw
            return
        raise RecordingError(
            f"recording {recording.path}: no joint of any person is known: all are missing; "
            f"correct the export"
        )
    wrong, units, unit_m = _size(recording, bodies)
    if lost and not wrong:
        wrong = "bodies are not where people can be"
    if unit_m is not None and reopened is not None:  # now too, some joints may be too far away
        bodies = list(_bodies(reopened(unit_m)))
    posed, axes = _axes(recording, bodies)
    if not (wrong or (whole and posed)):
        return
    reasons = [*([lost] if lost else []), *([wrong] if wrong else []), *posed]
    what = f"recording {recording.path}: {'; '.join(reasons)}"
    kind = LostRecordingError if lost else RecordingError
    if wrong and not units:
        raise kind(
            f"{what}; no unit explains that: correct the export's scale or origin, or the joints' "
            f"names"
        )
    options = " ".join(part for part in (units, axes) if part)
    if not options:
        raise RecordingError(f"{what}; no axes make them stand: correct the joints' names")
    raise kind(f"{what}{_remedy(recording, options)}")


def _whole(recording: Recording, bodies: _Bodies, reopened: Reopened | None) -> tuple[_Bodies, str]:
    """Return the bodies with the joints too far away to be believed, if the unit may be the cause.

    Readers leave such joints out, so in a wrong unit, what they kept says nothing about its size.

    Returns:
        These bodies, and what is wrong if most joints of the file are too far away, or else "".
    """
    adult = (stature := stature_m(bodies)) is not None and is_adult(stature)
    people = sum(len(scene.people) for scene in judged(recording))
    most = 2 * sum(seen.sum() for _, seen in bodies) >= people * recording.joint_map.mapped.sum()
    if reopened is None or recording.kind in SELF_EXPLAINED or (adult and most):
        return bodies, ""
    small = _bodies(reopened(recording.joint_map.scale_to_m * _SMALL))
    found = [(joints / _SMALL, seen) for joints, seen in small]
    away = [(np.abs(joints) > MAX_COORDINATE_M).any(axis=-1) & seen for joints, seen in found]
    far, known = np.sum(away), sum(seen.sum() for _, seen in found)
    if 2 * far > known:
        return found, f"{far / known:.0%} of the joints are more than {MAX_COORDINATE_M:g} m away"
    return (found if far and not adult else bodies), ""


def _size(recording: Recording, bodies: _Bodies) -> tuple[str, str, float | None]:
    """Return the problem with the size of most bodies, the option that corrects it, and its unit;
    "", "" and ``None`` if there is none.
    """
    stature = stature_m(bodies)
    small = most_are_not_human_sized(bodies)
    if not small and (stature is None or is_adult(stature)):
        return "", "", None
    if not stature:  # or all joints in one place
        return "bodies are not of human size", "", None
    wrong = f"bodies are not of human size: by their limbs they are {stature:.3g} m tall"
    scale_to_m = recording.joint_map.scale_to_m
    if (unit := fitting_unit(stature, scale_to_m)) is None:
        return wrong, "", None
    unit_m, name = unit
    if " " in name:  # a unit that was taken for another one
        return f"{wrong}, which would be {name}", f"--units {unit_m:.6g}", unit_m
    wrong += f", and {stature * unit_m / scale_to_m:.2f} m if its unit is {name}"
    return wrong, f"--units {name}", unit_m


def _axes(recording: Recording, bodies: _Bodies) -> tuple[list[str], str]:
    """Return the problem with how most people stand, and the options that correct it."""
    postures = [posture_of(*body) for body in bodies]
    down = np.sum([posture.down for posture in postures], axis=0)
    bones_m, length = sum(posture.bones_m for posture in postures), float(np.linalg.norm(down))
    lying = length > COHERENT * bones_m and -down[2] < TILTED * length
    handed = [posture.handed_m for posture in postures if posture.handed_m is not None]
    size = (stature_m(bodies) or 1.7) / 1.7  # of bodies in another unit
    mirrored = bool(handed) and float(np.median(handed)) < -MIRRORED_M * size
    wrong = ["people lie or hang upside down all the time"] if lying else []
    if mirrored:
        wrong.append(
            "people have left and right swapped: correct the joints' names if these are swapped"
        )
    if not wrong:
        return [], ""
    axes = standing_axes(bodies, recording.joint_map.rotation, -1.0 if mirrored else 1.0)
    if axes is None:
        return wrong, ""
    left = round(float(np.linalg.det(recording.joint_map.rotation))) * (-1 if mirrored else 1) < 0
    shown = ",".join(axes)
    return wrong, f"--axes {shown} --left-handed" if left else f"--axes {shown}"


def judged(recording: Recording) -> Sequence[Scene]:
    """Return the scenes used to judge a recording: ``MOST_SCENES`` at most, evenly over it."""
    return recording.scenes[:: max(1, -(-len(recording.scenes) // MOST_SCENES))]


def _bodies(recording: Recording) -> Iterator[tuple[Floats, Bools]]:
    for scene in judged(recording):
        for person in scene.people:
            joints, seen = recording.joint_map.map(person.positions, person.observed)
            seen = seen & np.isfinite(joints).all(-1)
            if seen.any():
                yield np.where(seen[:, None], joints, 0.0), seen


def _remedy(recording: Recording, options: str) -> str:
    if recording.kind in SELF_EXPLAINED:
        return (
            f"; a file of kind {recording.kind} states its own units and axes: leave it out, or "
            f"convert the original again"
        )
    return f"; {converted_by(recording.path, options)}"
