"""How well forecasts and zones of a COCO tracker do on recordings that know the missing joints.

    python -m tests.hri_predict.zones.inferred_table ../shared/data

prints the last table of docs/measured/joint-maps.md. Recordings of the test list are played at
30 Hz through the people stage, the predictor, the self-check and the joints' zones, three times:
with all joints of cmu38, and with those of COCO-17, the others inferred or bounded by reach. Every
third capture is judged by the captures 120 ms, 400 ms and 1 s later, of all joints that were known
then and at the capture.
"""

import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.files import data_path, read_yaml
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceSettings
from hri_predict.library.forecasting import load_predictor
from hri_predict.people.body.inferred import Filled, Inference
from hri_predict.people.people import People
from hri_predict.people.settings import PeopleSettings
from hri_predict.recording import open_recording
from hri_predict.zones.calibration import load_calibration, shipped_calibration
from hri_predict.zones.joint_zones import JointZones
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants
from hri_predict.zones.settings import CoverageSettings, HumanLimits

LEVEL, EVERY, JUDGED = 0.99, 4, 3
LATER_MS = (120, 400, 1000)
COCO = load_joint_map("coco17").mapped
GROUPS = {
    "delivered": COCO,
    "hands": np.isin(JOINTS, ("l_hand", "r_hand")),
    "feet": np.isin(JOINTS, ("l_foot", "r_foot")),
    "torso": np.isin(JOINTS, ("torso",)),
}


class Unfilled(Inference):
    """Infers nothing."""

    def fill(self, positions, observed):
        return Filled(positions, observed, np.zeros(observed.shape), np.zeros(observed.shape, bool))


class Node:
    """One person's way from scenes to joint zones, without robots."""

    def __init__(self, predictor, joint_map, infers):
        calibration = load_calibration(shipped_calibration("sinn"))
        rate_hz, steps = predictor.rate_hz, predictor.horizon_steps
        self.predictor = predictor
        self.people = People(
            settings=PeopleSettings(posture_unchecked="recorded feet sink into the floor"),
            joint_map=joint_map,
            source_settings=SourceSettings(kind="test", room_from_source=Pose()),
            rate_hz_source=120.0 / EVERY,
            declares_noise=False,
            history_steps=predictor.history_steps,
            rate_hz_predictor=rate_hz,
        )
        if not infers:
            self.people._inference = Unfilled()
        self._check = SelfCheck(
            SelfCheckConstants(),
            level=LEVEL,
            of="joint",
            rate_hz=rate_hz,
            horizon_steps=steps,
            ranges=calibration.motion_ranges(CANONICAL),
        )
        self._zones = JointZones(
            skeleton=CANONICAL,
            limits=HumanLimits(),
            rate_hz=rate_hz,
            horizon_steps=steps,
            times_s=np.arange(steps + 1) / rate_hz,
            radii=Radii(calibration, CoverageSettings(level=LEVEL), CANONICAL, steps),
        )

    def at(self, now_ns):
        """Forecast and spheres of the only person; ``None`` if there is none."""
        snapshot = self.people.snapshot(now_ns)
        if len(snapshot.ids) != 1:
            return None
        forecast = self.predictor.predict(snapshot.history, snapshot.observed)
        spheres = self._zones.build(
            snapshot,
            forecast,
            capture_ns=int(snapshot.capture_ns[0]),
            trust=(trust := self._check.check(snapshot)),
        )
        assert spheres.claimed is not None
        self._check.note(snapshot, forecast, spheres.claimed)
        return forecast.positions[0], spheres, bool(trust.out_of_distribution[0])


def measure(predictor, recording, found, infers, delivered=None):
    """Add (held, error) of each judged joint to ``found``, by horizon and group."""
    whole = recording.joint_map
    joint_map = whole
    if delivered is not None:
        joint_map = replace(whole, weights=whole.weights * delivered[:, None])
    node = Node(predictor, joint_map, infers)
    scenes = recording.scenes[::EVERY]
    stamps = np.array([scene.stamp_ns for scene in scenes])
    truth = [whole.map(s.people[0].positions, s.people[0].observed) for s in scenes]
    for k, (scene, now_ns) in enumerate(zip(scenes, recording.arrival_ns[::EVERY], strict=True)):
        node.people.receive(scene, now_ns)
        if k % JUDGED or (result := node.at(now_ns)) is None:
            continue
        ahead, spheres, unlike = result
        found["unlike"].append(unlike)
        for later_ms in LATER_MS:
            then = int(stamps.searchsorted(scene.stamp_ns + (later_ms - 1) * 1_000_000))
            if then == len(scenes):
                continue
            step = round(later_ms / 1000 * predictor.rate_hz)
            place, known = truth[then]
            off = np.linalg.norm(place - spheres.mid[0, step], axis=1)
            held = off <= spheres.radius[0, step]
            error = np.linalg.norm(place - ahead[step - 1], axis=1)
            for group, joints in GROUPS.items():
                judged = joints & known & truth[k][1]
                found[later_ms, group].extend(zip(held[judged], error[judged], strict=True))


def main(data: Path) -> None:
    """Print the table."""
    predictor = load_predictor("sinn")
    names = read_yaml(data_path("training", "splits.yaml"), "splits")["test"]
    columns = " | ".join(f"{group}, {ms} ms" for ms in LATER_MS for group in GROUPS)
    print(f"| held %, error mm | {columns} | unlike, % | judged |")
    for title, infers, delivered in (
        ("all joints", True, None),
        ("COCO-17, inferred", True, COCO),
        ("COCO-17, by reach", False, COCO),
    ):
        found: dict[Any, list[Any]] = defaultdict(list)
        for name in names:
            recording = open_recording(data / "cmu_mocap" / f"{name}.npz")
            measure(predictor, recording, found, infers, delivered)
        cells = []
        for later_ms in LATER_MS:
            for group in GROUPS:
                held, error = np.array(found[later_ms, group], np.float64).mean(axis=0)
                cells.append(f"{100 * held:.1f}, {1000 * error:.0f}")
        unlike = found["unlike"]
        print(f"| {title} | {' | '.join(cells)} | {100 * np.mean(unlike):.1f} | {len(unlike)} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
