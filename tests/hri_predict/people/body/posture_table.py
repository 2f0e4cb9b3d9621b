"""How often people are refused in recordings mapped right, and how soon in recordings mapped wrong.

    python -m tests.hri_predict.people.body.posture_table ../shared/data

prints the tables of docs/measured/axes.md. Every recording of the data pack is played at 30 Hz. A
camera stands 3 m before its start and 1.5 m up; a wrong rotation turns everything about the camera,
as wrong axes do.
"""

import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.settings import Region
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.people.body.posture_watch import PostureWatch, Verdict
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body
from hri_predict.recording import open_recording

RATE_HZ = 30.0
COCO = np.array([load_joint_map("coco17").mapped[i] for i in range(len(JOINTS))])
SEEN = {  # what of a body a tracker shows that shows no trunk
    "head, neck, shoulders, arms": ("head", "neck", "shoulder", "elbow", "wrist", "hand"),
    "head, neck, shoulders": ("head", "neck", "shoulder"),
    "shoulders, hips": ("shoulder", "hip"),
    "arms": ("shoulder", "elbow", "wrist", "hand"),
}
_NAMES = {  # data pack, section 8: skeletons that no shipped map describes
    23: {"waist": "hip", "torso": "chest", "neck": "neck", "head": "head"}
    | {
        f"{s}_{joint}": f"{s}{name}"
        for s in "lr"
        for joint, name in zip(
            ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot"),
            ("Shldr", "ForeArm", "Hand", "Thigh", "Shin", "Foot", "Foot_End"),
            strict=True,
        )
    },
    9: {"waist": "hip", "neck": "collar", "head": "head"}
    | {
        f"{s}_{joint}": f"{side}_{name}"
        for s, side in (("l", "left"), ("r", "right"))
        for joint, name in (("shoulder", "shoulder"), ("elbow", "elbow"), ("wrist", "hand"))
    },
}


@dataclass(frozen=True, eq=False)
class Played:
    """A recording on the canonical skeleton at about 30 Hz: (F, J, 3) metres, (F, J)."""

    group: str
    name: str
    positions: Floats
    observed: Bools


def recordings(data: Path) -> Iterator[Played]:
    """Every recording of the data pack."""
    for path in sorted(data.glob("**/*.npz")):
        group = "/".join(path.relative_to(data).parts[:-1])
        yield _motion(path, group) if group.startswith("motion") else _shipped(path, group)


def _shipped(path: Path, group: str) -> Played:
    recording = open_recording(path)
    scenes = recording.scenes[:: max(1, round(recording.rate_hz / RATE_HZ))]
    positions, observed = recording.joint_map.map(
        np.array([scene.people[0].positions for scene in scenes]),
        np.array([scene.people[0].observed for scene in scenes]),
    )
    return Played(group, path.stem, positions, observed)


def _motion(path: Path, group: str) -> Played:
    data = np.load(path)
    step = max(1, round(float(data["fps"]) / RATE_HZ))
    raw = data["positions"][::step].astype(np.float64)
    seen = np.isfinite(raw).all(axis=-1)
    if "valid" in data:
        seen &= data["valid"][::step]
    raw[..., 2] -= float(data["floor_height"]) if "floor_height" in data else 0.0
    if raw.shape[1] == 38:
        return Played(group, path.stem, *load_joint_map("cmu38").map(raw, seen))
    names = [str(name) for name in data["joint_names"]]
    positions = np.zeros((len(raw), len(JOINTS), 3))
    observed = np.zeros(positions.shape[:2], bool)
    for canonical, name in _NAMES[len(names)].items():
        here, there = JOINTS.index(canonical), names.index(name)
        positions[:, here] = np.where(seen[:, there, None], raw[:, there], 0.0)
        observed[:, here] = seen[:, there]
    return Played(group, path.stem, positions, observed)


def verdicts(
    positions: Floats, observed: Bools, field_of_view: Region | None = None
) -> list[Verdict | None]:
    """The verdict at each capture in which something is seen."""
    watch = PostureWatch(PeopleSettings(), field_of_view)
    return [
        watch.judge(Body(1, joints, seen), round((k + 1) * 1e9 / RATE_HZ))
        for k, (joints, seen) in enumerate(zip(positions, observed, strict=True))
        if seen.any()
    ]


def refused_after_s(positions: Floats, observed: Bools, view: Region | None = None) -> float:
    """Seconds until the first refusal; infinite without one."""
    found = verdicts(positions, observed, view)
    return next((k / RATE_HZ for k, verdict in enumerate(found) if verdict), np.inf)


def turns() -> list[Floats]:
    """The 24 rotations that carry axes to axes, the right one first."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return sorted(found, key=lambda turn: -float(np.trace(turn)))


def wrong(played: Played, seconds: float = 3.0) -> Iterator[tuple[str, Floats, Region | None]]:
    """The start of a recording in all wrong ways: what is wrong, positions, field of view."""
    start = played.positions[: round(seconds * RATE_HZ)]
    middle = start[played.observed[: len(start)]].mean(axis=0)
    camera = np.array([middle[0] - 3.0, middle[1], 1.5])
    x, y = camera[:2]
    view = Region(
        polygon=[[x + 0.3, y - 0.3], [x + 6, y - 6], [x + 6, y + 6], [x + 0.3, y + 0.3]], z_min=-1.0
    )
    for turn in turns()[1:]:
        moved = camera + (start - camera) @ turn.T
        if turn[2, 2] > 0.5:
            yield "wrong heading (3 rotations), with a field of view", moved, view
        else:
            kind = "upside down (4)" if turn[2, 2] < -0.5 else "lying (16)"
            yield f"{kind}", moved, None
    yield "mirrored", camera + (start - camera) * [1.0, -1.0, 1.0], None
    swapped = np.arange(len(JOINTS))
    for left, right in CANONICAL.left_right_pairs:
        swapped[left], swapped[right] = right, left
    yield "left and right named wrongly", start[:, swapped], None


def noisy(positions: Floats, metres: float = 0.03) -> Floats:
    """With noise of a poor tracker, standard deviation per axis."""
    return positions + np.random.default_rng(0).normal(0.0, metres, positions.shape)


def seen_of(kind: str) -> Bools:
    """(J,) the joints of a kind of ``SEEN``; the crown is none of them."""
    return np.array([name != "head_top" and name.endswith(SEEN[kind]) for name in JOINTS])


def print_reduced(data: Path) -> None:
    """The table of bodies without a trunk, mapped right."""
    print("\n| joints | captures | refused | refused, 30 mm noise |\n|---|---:|---:|---:|")
    counts = {kind: [0, 0, 0] for kind in SEEN}
    for played in recordings(data):
        for kind, numbers in counts.items():
            observed = played.observed & seen_of(kind)
            numbers[0] += int(observed.any(axis=1).sum())
            for index, positions in enumerate((played.positions, noisy(played.positions)), 1):
                numbers[index] += sum(v is not None for v in verdicts(positions, observed))
    for kind, numbers in counts.items():
        print(f"| {kind} |", " | ".join(f"{number:,}" for number in numbers), "|")


def main(data: Path) -> None:
    right: dict[str, list[int]] = {}
    late: dict[tuple[str, str], dict[str, list[float]]] = {}
    for played in recordings(data):
        group = played.group
        for index, positions in enumerate((played.positions, noisy(played.positions))):
            found = verdicts(positions, played.observed)
            counts = right.setdefault(group, [0, 0, 0, 0])
            counts[0] += not index
            counts[1] += len(found) * (not index)
            counts[2 + index] += sum(verdict is not None for verdict in found)
        if group == "assembly":
            continue
        body = "upper bodies" if group.endswith("beside_robot") else "whole bodies"
        for kind, positions, view in wrong(played):
            seen = played.observed[: len(positions)]
            for joints, of in (("all joints", seen), ("coco17, 30 mm", seen & COCO)):
                at = noisy(positions) if "mm" in joints else positions
                times = late.setdefault((body, kind), {}).setdefault(joints, [])
                times.append(refused_after_s(at, of, view))
    print("| set | recordings | captures | refused | refused, 30 mm noise |")
    print("|---|---:|---:|---:|---:|")
    for group, counts in right.items():
        print(f"| {group} |", " | ".join(f"{count:,}" for count in counts), "|")
    print(
        "\n| bodies | what is wrong | joints | starts | within 1 s, % | within 3 s, % | median, s |"
    )
    print("|---|---|---|---:|---:|---:|---:|")
    for (body, kind), by_joints in late.items():
        for joints, seconds in by_joints.items():
            shares = " | ".join(f"{100 * np.mean(np.array(seconds) <= s):.1f}" for s in (1, 3))
            print(f"| {body} | {kind} | {joints} | {len(seconds)} | {shares} | "
                  f"{np.median(seconds):.2f} |")  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]))
    print_reduced(Path(sys.argv[1]))
