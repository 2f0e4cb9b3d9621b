"""Errors of a person's place, by BlazePose on pictures of recorded bodies whose place is known.

``python -m tests.camera_place --model PACKAGE``, from the checkout's root; PACKAGE is the file that
``hri-predict camera --fetch-model`` fetches. Needs ../shared/data and the extra ``camera``. 300
bodies take about two minutes of one core. Prints the table of docs/measured/camera-place.md.
"""

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hri_drivers.camera.network import package
from hri_drivers.camera.network.blazepose import BlazePose
from hri_drivers.camera.network.runtime import load_net
from hri_drivers.camera.place.alone import place_alone
from hri_drivers.camera.place.bones import bones_of
from hri_drivers.camera.place.camera import OPTICAL_FROM_REP103, Camera, guessed_camera
from hri_drivers.camera.place.placed import Placed, Unplaced
from hri_drivers.camera.place.together import View, place_together
from hri_drivers.camera.seen import Seen, UInt8
from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import norm, transform
from hri_predict.base.settings import Pose
from tests.camera_place.figure import figure, render

DATA = Path(__file__).parents[2].parent / "shared/data/motion"
VIEW_DEG = 64.0
CAMERA = replace(guessed_camera(960, 720, VIEW_DEG), focal_error=0.01)
PAIRS = {
    11: "LeftArm", 12: "RightArm", 13: "LeftForeArm", 14: "RightForeArm", 15: "LeftHand",
    16: "RightHand", 23: "LeftUpLeg", 24: "RightUpLeg", 25: "LeftLeg", 26: "RightLeg",
    27: "LeftFoot", 28: "RightFoot",
}  # fmt: skip
HEAD = """\
| | people | along the ray, %: 50, 95, 99 % | across, m: 50, 99 % | stated, % | held, % |
|---|---:|---:|---:|---:|---:|"""
LEGS_SHARE = 0.491  # of the stature: hip to ankle (``place.bones``)


@dataclass(frozen=True, slots=True)
class Row:
    """One person: distance, errors along and across the ray, and the error that was stated."""

    distance: float
    along: float
    across: float
    stated: float
    is_whole: bool

    @property
    def held(self) -> bool:
        """Whether the stated error holds the true one."""
        return math.hypot(self.along, self.across) <= self.stated


def bodies(random: np.random.Generator) -> Callable[[], dict[str, Floats]]:
    """Return a function that draws a recorded body: joints around the hips, metres, room.

    It is turned by any angle about the vertical.
    """
    files = [p for folder in ("cmu_subjects", "cmu_misc") for p in (DATA / folder).glob("*.npz")]
    loaded = [np.load(path) for path in sorted(files)]
    needed = {*PAIRS.values(), "Head", "Head_End", "LeftToeBase_End", "RightToeBase_End"}
    whole = [
        (d["joint_names"], d["positions"])
        for d in loaded
        if needed <= set(d["joint_names"].tolist())
    ]

    def draw() -> dict[str, Floats]:
        names, positions = whole[random.integers(len(whole))]
        frame = positions[random.integers(1, len(positions))].astype(np.float64)
        angle = random.uniform(0, 2 * math.pi)
        c, s = math.cos(angle), math.sin(angle)
        turned = frame @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
        joints = dict(zip(names, turned, strict=True))
        hips = (joints["LeftUpLeg"] + joints["RightUpLeg"]) / 2
        return {name: place - hips for name, place in joints.items()}

    return draw


class Network:
    """BlazePose as it follows a person in a video."""

    def __init__(self, path: Path) -> None:
        detector, landmarks, _ = package.read(path, "full")
        self._nets = load_net(detector, "detector"), load_net(landmarks, "full")

    def see(self, picture: UInt8) -> Seen | None:
        """Return the person in a picture, seen for the second time; None if not found."""
        finder = BlazePose(*self._nets, 1)
        for _ in range(2):
            people = finder.find(picture).people
        if not people:
            return None
        one = people[0]
        return Seen(0, "mediapipe33", one.pixels, one.visibility, one.world)


def stature_of(joints: dict[str, Floats]) -> float:
    """Return the stature in metres by the length of the legs."""
    legs = [
        float(norm(joints[side + a] - joints[side + b]))
        for side in ("Left", "Right")
        for a, b in (("UpLeg", "Leg"), ("Leg", "Foot"))
    ]
    return sum(legs) / 2 / LEGS_SHARE


def compared(placed: Placed, truth: Floats) -> Row | None:
    """Return the errors of the middle of those joints that were observed; ``truth`` (12, 3)."""
    of = list(PAIRS)
    known = placed.observed[of]
    if not known.any():
        return None
    found = np.median(placed.positions[of][known], axis=0)
    middle = np.median(truth[known], axis=0)
    distance = float(np.linalg.norm(middle))
    off, way = found - middle, middle / distance
    along = float(off @ way)
    bones = bones_of("mediapipe33")
    whole = (
        placed.observed[list(bones.shoulders)].any() and placed.observed[list(bones.ankles)].any()
    )
    across = float(np.linalg.norm(off - along * way))
    return Row(distance, along, across, placed.error_m, bool(whole))


def show(name: str, rows: Sequence[Row]) -> None:
    """Print a row of the table."""
    if len(rows) < 10:
        print(f"| {name} | {len(rows)} | | | | | |")
        return
    share = np.array([abs(row.along) / row.distance for row in rows]) * 100
    p50, p95, p99 = np.percentile(share, [50, 95, 99])
    across = np.percentile([row.across for row in rows], [50, 99])
    stated = float(np.median([row.stated / row.distance for row in rows])) * 100
    held = 100 * float(np.mean([row.held for row in rows]))
    print(
        f"| {name} | {len(rows)} | {p50:.0f}, {p95:.0f}, {p99:.0f} | "
        f"{across[0]:.2f}, {across[1]:.2f} | {stated:.0f} | {held:.1f} |"
    )


def measure_alone(network: Network, count: int, random: np.random.Generator) -> None:
    """Measure one camera."""
    draw = bodies(random)
    rows: dict[str, list[Row]] = {}
    unseen, unplaced = 0, 0
    for _ in range(count):
        joints = draw()
        distance = random.uniform(1.0, 8.0)
        place = distance * np.array([random.uniform(-0.5, 0.5), random.uniform(-0.2, 0.3), 1.0])
        pitch = math.radians(random.uniform(0, 25))
        c, s = math.cos(pitch), math.sin(pitch)
        down = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        seen_at = {n: down @ OPTICAL_FROM_REP103 @ p + place for n, p in joints.items()}
        seen = network.see(render(figure(seen_at), CAMERA, random))
        if seen is None:
            unseen += 1
            continue
        truth = np.array([seen_at[name] for name in PAIRS.values()])
        height = stature_of(joints)
        view = random.uniform(50, 80)  # the true one of a camera that is guessed at 64
        longer = math.tan(math.radians(VIEW_DEG) / 2) / math.tan(math.radians(view) / 2)
        guess = guessed_camera(*CAMERA.size)
        for name, camera, known, scale in (
            ("height known", CAMERA, height, 1.0),
            ("adult", CAMERA, None, 1.0),
            ("adult, field of view guessed", guess, None, longer),
        ):
            placed = place_alone(seen, camera, known)
            if isinstance(placed, Unplaced):
                unplaced += 1
                continue
            # with a longer focal length the same picture shows a body that is farther away
            row = compared(placed, truth * [1, 1, scale])
            if row is not None:
                part = "whole body" if row.is_whole else "part of the body"
                rows.setdefault(f"{part}, {name}", []).append(row)
                if name == "height known" and row.is_whole:
                    low, high = next(b for b in ((0, 2), (2, 4), (4, 20)) if row.distance < b[1])
                    rows.setdefault(f"{part}, {name}, {low} to {high} m", []).append(row)
    print(f"one camera: {count} bodies, {unseen} not found, {unplaced} of 3 each not placed")
    for name in sorted(rows):
        show(name, rows[name])


def measure_together(network: Network, count: int, random: np.random.Generator) -> None:
    """Measure two cameras 3 m apart, at right angles at a person 3 m away."""
    draw = bodies(random)
    cameras = [_standing(0.0, -1.5, 26.0), _standing(0.0, 1.5, -26.0)]
    rows, unplaced, joints_off = [], 0, []
    for _ in range(count):
        joints = draw()
        at = np.array([random.uniform(2.0, 4.5), random.uniform(-1, 1), 0.95])
        views, room = [], {name: place + at for name, place in joints.items()}
        for camera in cameras:
            from_room = np.asarray(np.linalg.inv(camera.room_from_optical()), np.float64)
            own = {name: transform(from_room, place) for name, place in room.items()}
            seen = network.see(render(figure(own), camera, random))
            views.append(View(camera, 0, () if seen is None else (seen,)))
        placed = [t.placed for t in place_together(views) if isinstance(t.placed, Placed)]
        if not placed:
            unplaced += 1
            continue
        from_room = np.asarray(np.linalg.inv(cameras[0].room_from_optical()), np.float64)
        truth = transform(from_room, np.array([room[name] for name in PAIRS.values()]))
        row = compared(placed[0], truth)
        if row is not None:
            rows.append(row)
        known = placed[0].observed[list(PAIRS)]
        joints_off.append(norm((placed[0].positions[list(PAIRS)] - truth)[known]))
    off = np.percentile(np.concatenate(joints_off), [50, 95, 99])
    print(f"two cameras: {count} bodies, {unplaced} not placed")
    print(f"joints off by {off[0]:.3f}, {off[1]:.3f}, {off[2]:.3f} m (50, 95, 99 %)")
    show("two cameras", rows)


def _standing(x: float, y: float, turned_deg: float) -> Camera:
    half = math.radians(turned_deg) / 2
    pose = Pose(xyz=[x, y, 1.4], quaternion_xyzw=[0.0, 0.0, math.sin(half), math.cos(half)])
    return replace(CAMERA, pose=pose)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.camera_place", description=__doc__)
    parser.add_argument("--model", type=Path, default=package.kept_at())
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--together", action="store_true", help="two cameras instead of one")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    network, random = Network(asked.model), np.random.default_rng(asked.seed)
    print(HEAD)
    (measure_together if asked.together else measure_alone)(network, asked.count, random)


if __name__ == "__main__":
    main()
