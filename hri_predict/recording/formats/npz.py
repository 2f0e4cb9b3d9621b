"""Motion recordings as NumPy archives, in the data pack's three layouts.

Keys, units and axes as the data pack documents them:

- whole body (``cmu_mocap``): ``positions_world`` (F, 38, 3) metres, y up, ``fps`` 120,
  ``world_ok``, ``floor_height`` and ``rest_pose_frames``;
- any body (``motion``): ``positions`` (F, J, 3) metres, z up, NaN where not observed, with
  ``joint_names``, ``parents`` and ``fps``; ``floor_height``, and (F, J) ``valid`` and ``jump``
  where the file has them;
- arms of a seated person (``assembly``): ``positions`` (F, 6, 3) metres in the camera's frame, NaN
  where missing, with ``joint_names`` and ``fps``.
"""

import lzma
import math
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.settings import MAX_COORDINATE_M
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.people.body.stature import fitting_unit, is_adult, stature_m
from hri_predict.recording.bounded import decoded
from hri_predict.recording.frames import Written, frames_of_one
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_rate, recording_of_one
from hri_predict.recording.wanted import Wanted

# Exceptions that a damaged archive or header can raise.
_BROKEN: tuple[type[Exception], ...] = (OSError, EOFError, ValueError, KeyError, SyntaxError)
_BROKEN += (OverflowError, RuntimeError, MemoryError, tokenize.TokenError)
_BROKEN += (zipfile.BadZipFile, zlib.error, lzma.LZMAError)

_KEYS = {"positions_world", "world_ok", "floor_height", "rest_pose_frames"}
_KEYS |= {"positions", "joint_names", "parents", "valid", "jump"}
RATES = ("fps", "mocap_framerate", "mocap_frame_rate", "frame_rate", "framerate", "rate_hz")
"""Names of the frame rate; a file may have several, which must agree."""
_KEYS |= set(RATES)
MAX_BYTES = 2**30  # unpacked; two hours of 38 joints at 120 frames per second


def read_npz(path: Path, wanted: Wanted) -> Recording:
    """Read a recording in one of the three layouts.

    A frame whose ``world_ok`` is false (its root rotation is an artefact) becomes a scene in which
    all joints of the person are unobserved: a person is there, but the place is unknown. A joint
    that is not ``valid``, or jumps, is unobserved in that frame.

    Raises:
        RecordingError: the file is truncated, is empty, or has another layout.
    """
    arrays, person = read_arrays(path, _KEYS), wanted.person
    if "positions_world" in arrays:
        return _whole_body(path, arrays, person)
    if "positions" in arrays and "parents" in arrays:
        return _any_body(path, arrays, person)
    if "positions" in arrays:
        return _arms(path, arrays, person)
    raise RecordingError(
        f"recording {path}: holds {', '.join(sorted(arrays)) or 'nothing'}; expected "
        f"'positions_world' (38 joints) or 'positions' with 'joint_names' (and 'parents', unless "
        f"they are arms in a camera's frame)"
    )


def read_arrays(path: Path, keys: Collection[str]) -> dict[str, Any]:
    """The arrays of an archive with one of ``keys``; without these keys, only the array names.

    Raises:
        RecordingError: the file is not an archive, is damaged, or unpacks to more than
            ``MAX_BYTES``.
    """
    try:
        with path.open("rb") as file:
            return _unpacked(path, np.load(file, allow_pickle=False), keys)
    except _BROKEN as error:
        raise RecordingError(
            f"recording {path}: truncated or not a NumPy archive; copy it again"
        ) from error


def _unpacked(path: Path, archive: Any, keys: Collection[str]) -> dict[str, Any]:
    if not isinstance(archive, np.lib.npyio.NpzFile):
        raise RecordingError(
            f"recording {path}: is a single array, not an .npz archive; save it with "
            f"numpy.savez and the documented keys"
        )
    with archive:
        _check_size(path, archive.zip, keys)
        arrays = {key: archive[key] for key in archive.files if key in keys}
        if not all(isinstance(array, np.ndarray) for array in arrays.values()):
            raise ValueError("an entry without NumPy's header comes as bytes")
        return arrays or dict.fromkeys(archive.files)


def _check_size(path: Path, archive: zipfile.ZipFile | None, keys: Collection[str]) -> None:
    """Reject an archive that would fill the memory, counting only the arrays that are read."""
    entries = [] if archive is None else archive.infolist()
    size = sum(e.file_size for e in entries if e.filename.removesuffix(".npy") in keys)
    if size > MAX_BYTES:
        raise RecordingError(
            f"recording {path}: {size / 2**30:.3g} GiB when unpacked, at most "
            f"{MAX_BYTES / 2**30:g} GiB are read; cut it into parts"
        )


def _whole_body(path: Path, arrays: Mapping[str, Any], person: int) -> Recording:
    joint_map = load_joint_map("cmu38")
    positions = _positions(path, arrays["positions_world"], len(joint_map.source_joints))
    first = _number(path, arrays, "rest_pose_frames", 0.0)  # a pose, not motion
    if first < 0 or first % 1 != 0:
        raise RecordingError(
            f"recording {path}: 'rest_pose_frames' is {first:g}; it must be a whole number from 0"
        )
    ok = np.asarray(arrays.get("world_ok", np.ones(len(positions), dtype=bool)))
    if ok.shape != (len(positions),) or ok.dtype.kind not in "biu":
        raise RecordingError(
            f"recording {path}: 'world_ok' is {ok.dtype} of shape {ok.shape}; expected one truth "
            f"value for each of the {len(positions)} frames"
        )
    floor_m = _number(path, arrays, "floor_height", 0.0)
    positions[..., 1] -= floor_m  # y is up
    positions[ok == 0] = np.nan
    begin = min(int(first), len(positions))
    recording = _recording(path, "cmu", joint_map, positions[begin:], of=(arrays, person))
    return replace(recording, floor_m=floor_m)


def _any_body(path: Path, arrays: Mapping[str, Any], person: int) -> Recording:
    names = texts(arrays.get("joint_names", []))
    if not names or len(set(names)) != len(names):
        raise RecordingError(
            f"recording {path}: 'joint_names' has {len(set(names))} different names for "
            f"{len(names)} joints; give each joint its own name"
        )
    positions = _positions(path, arrays["positions"], len(names))
    floor_m = _number(path, arrays, "floor_height", 0.0)
    positions[..., 2] -= floor_m  # z is up
    positions[~_flags(path, arrays, "valid", shape=positions.shape[:2], default=True)] = np.nan
    positions[_flags(path, arrays, "jump", shape=positions.shape[:2], default=False)] = np.nan
    recording = _recording(path, "motion", map_of_names(names), positions, of=(arrays, person))
    return replace(recording, floor_m=floor_m)


def _flags(
    path: Path, arrays: Mapping[str, Any], key: str, *, shape: tuple[int, ...], default: bool
) -> Bools:
    """(F, J) truth values of a key, or the default for all."""
    flags = np.asarray(arrays.get(key, np.full(shape, default)))
    if flags.shape != shape or flags.dtype.kind not in "biu":
        raise RecordingError(
            f"recording {path}: '{key}' is {flags.dtype} of shape {flags.shape}; expected one "
            f"truth value for each frame and joint, shape {shape}"
        )
    return flags != 0


def _arms(path: Path, arrays: Mapping[str, Any], person: int) -> Recording:
    joint_map = load_joint_map("assembly_arms")
    names = texts(arrays.get("joint_names", joint_map.source_joints))
    unknown = [n for n in names if n not in joint_map.source_joints]
    missing = [n for n in joint_map.source_joints if n not in names]
    if len(unknown) > len(names) - len(unknown):  # another body, in the layout of any body
        layout = ("positions", "joint_names", "parents", "fps")
        lacking = [key for key in layout if key not in arrays]
        raise RecordingError(
            f"recording {path}: lacks {' and '.join(repr(key) for key in lacking)}; add "
            f"{'it' if len(lacking) == 1 else 'them'}: a file with 'positions' holds also "
            f"'joint_names', 'parents' (the index of each joint's parent) and 'fps'"
        )
    if unknown or missing:
        wrong = f"unknown: {', '.join(unknown)}" if unknown else f"missing: {', '.join(missing)}"
        raise RecordingError(
            f"recording {path}: 'joint_names' do not fit ({wrong}); "
            f"expected {', '.join(joint_map.source_joints)}"
        )
    positions = _positions(path, arrays["positions"], len(names))
    positions = positions[:, [names.index(n) for n in joint_map.source_joints]]
    return _recording(path, "assembly", joint_map, positions, of=(arrays, person))


def _recording(
    path: Path,
    kind: str,
    joint_map: JointMap,
    positions: Floats,
    *,
    of: tuple[Mapping[str, Any], int],
) -> Recording:
    if len(positions) == 0:
        raise RecordingError(f"recording {path}: empty (no frames); choose another")
    arrays, person = of
    rate_hz = rate_of(path, arrays, "fps")
    _check_near(path, joint_map, positions)
    return recording_of_one(path, kind, joint_map, positions, rate_hz=rate_hz, person=person)


def _check_near(path: Path, joint_map: JointMap, positions: Floats) -> None:
    """Reject positions that are not in metres, the unit of all three layouts.

    Readers leave out what is too far away: in another unit, little may be left of the people.
    """
    known = ~np.isnan(positions).any(axis=-1)
    finite: Bools = np.isfinite(positions.sum(axis=-1))
    far = (np.abs(positions) > MAX_COORDINATE_M).any(axis=-1)
    if not far.any():
        return
    joints, seen = joint_map.map(positions, finite)
    stature = stature_m(list(zip(joints, seen, strict=True)))
    unit = fitting_unit(stature, 1.0) if stature and not is_adult(stature) else None
    if unit is None and 2 * far.sum() <= known.sum():
        return
    remedy = "correct them" if unit is None else f"multiply them by {unit[0]:g} ({unit[1]})"
    raise RecordingError(
        f"recording {path}: {far.sum() / known.sum():.0%} of its joints are more than "
        f"{MAX_COORDINATE_M:g} m away; its positions must be in metres: {remedy}"
    )


def _positions(path: Path, array: Any, joints: int) -> Floats:
    array = np.asarray(array)
    if array.ndim != 3 or array.shape[1:] != (joints, 3) or array.dtype.kind not in "fiu":
        raise RecordingError(
            f"recording {path}: positions are {array.dtype} of shape {array.shape}; "
            f"expected numbers of shape (frames, {joints}, 3)"
        )
    return array.astype(np.float64)


def _number(path: Path, arrays: Mapping[str, Any], key: str, default: float) -> float:
    if key not in arrays:
        return default
    value = single_number(arrays[key])
    if not math.isfinite(value):
        raise RecordingError(f"recording {path}: '{key}' is not one finite number")
    return value


def single_number(array: Any) -> float:
    """Return the number in an array of one element of any shape; NaN for other arrays."""
    flat = np.asarray(array).ravel()
    try:
        return float(flat[0]) if flat.size == 1 else math.nan
    except (TypeError, ValueError):
        return math.nan


def rate_of(path: Path, arrays: Mapping[str, Any], usual: str) -> float:
    """Return the frame rate of an archive, under any of the names in ``RATES``.

    Args:
        path: the file.
        arrays: its content.
        usual: usual name of the rate in this kind of archive, for the error.

    Raises:
        RecordingError: there is no rate, a rate is out of range, or two rates differ.
    """
    rates = {key: single_number(arrays[key]) for key in RATES if key in arrays}
    if not rates:
        raise RecordingError(f"recording {path}: '{usual}' is missing; add it")
    for key, rate_hz in rates.items():
        if not math.isfinite(rate_hz):
            raise RecordingError(f"recording {path}: '{key}' is not one finite number; correct it")
        check_rate(path, f"'{key}'", rate_hz)
    (key, first), *others = rates.items()
    for other, rate_hz in others:
        if not math.isclose(first, rate_hz, rel_tol=1e-3):
            raise RecordingError(
                f"recording {path}: '{key}' is {first:g}, but '{other}' is {rate_hz:g} frames per "
                f"second; remove the wrong one"
            )
    return first


def texts(array: Any) -> list[str]:
    """The texts of an array of any shape; bytes are UTF-8, or else one byte per character."""
    flat = np.atleast_1d(np.asarray(array)).ravel().tolist()
    return [decoded(item) if isinstance(item, bytes) else str(item) for item in flat]


def write_pack(path: Path, recording: Recording) -> Written:
    """Write one person in the layout of cmu_mocap or assembly, depending on the joints' names.

    Raises:
        ConfigError: the joints fit neither layout.
    """
    frames = frames_of_one(recording)
    names = [name for name in ("cmu38", "assembly_arms") if _same(name, frames.joints)]
    if not names:
        raise ConfigError(
            "the data pack's layouts hold the 38 joints of cmu38 or the 6 of assembly_arms, not "
            f"{', '.join(frames.joints[:4])}, ...; use --to amass, which holds any joints"
        )
    joint_map = load_joint_map(names[0])
    order = [frames.joints.index(joint) for joint in joint_map.source_joints]
    positions = (frames.positions[:, 0, order] @ joint_map.rotation).astype(np.float32)
    fps = np.float32(frames.rate_hz)
    arrays: dict[str, Any]
    if names[0] == "cmu38":
        ok = ~np.isnan(positions).all(axis=(1, 2))
        arrays = {"positions_world": positions, "world_ok": ok, "floor_height": np.array(0.0)}
    else:
        arrays = {"positions": positions, "joint_names": np.array(joint_map.source_joints)}
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, fps=fps, **arrays)
    return frames.written


def _same(map_name: str, joints: Collection[str]) -> bool:
    return sorted(joints) == sorted(load_joint_map(map_name).source_joints)
