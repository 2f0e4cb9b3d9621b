"""A tracker as a process: sends COCO-17 in camera axes, with noise and outliers, over UDP.

    python touching_sender.py PORT HOW

Each line on standard input, ``x y z``, moves the person's right wrist there (room, metres); with a
fourth word ``walk`` the person stands over x, y instead. HOW is ``camera`` (as a camera above sees
it), ``room`` (the room's axes, as if no camera were there) or ``mirrored``. Prints a line when it
has moved.
"""

import importlib.util
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_sim.people.body import Body

TRUTH = Pose(xyz=[-1.5, 0.4, 2.2], quaternion_xyzw=[-0.0393, 0.2466, 0.0149, 0.9682])
"""Of the camera in the room: looks down by 29 degrees, and is rolled a little."""
NOISE_M = 0.03
OUTLIERS = 0.05
COCO = load_joint_map("coco17")
WHO = Body(1.75)


def joints(wrist: np.ndarray, stands: bool) -> np.ndarray:
    """(17, 3) COCO joints in the room."""
    xy = wrist[:2] if stands else wrist[:2] - np.array([0.45, -0.2])
    body = WHO.joints(WHO.standing(xy, 0.0))
    if not stands:
        body[JOINTS.index("r_wrist")] = wrist
        body[JOINTS.index("r_elbow")] = (wrist + body[JOINTS.index("r_shoulder")]) / 2
    found = np.tile(body[JOINTS.index("head")], (17, 1))
    for canonical, row in enumerate(COCO.weights):
        if (row == 1.0).any():
            found[row.argmax()] = body[canonical]
    return found


def sent(room: np.ndarray, how: str) -> np.ndarray:
    """The same in the units and axes in which the tracker sends them."""
    if how == "room":
        return room
    matrix = TRUTH.matrix()
    seen = (room - matrix[:3, 3]) @ matrix[:3, :3] @ COCO.rotation
    return seen * [-1.0, 1.0, 1.0] if how == "mirrored" else seen


def main() -> None:
    path = Path(__file__).resolve().parents[4] / "drivers" / "python" / "hri_sender.py"
    spec = importlib.util.spec_from_file_location("hri_sender", path)
    assert spec
    assert spec.loader
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    port, how = int(sys.argv[1]), sys.argv[2]
    sender = module.SceneSender("127.0.0.1", port, list(COCO.source_joints))
    place, stands = np.array([1.0, 0.0, 1.0]), False

    def send() -> None:
        rng = np.random.default_rng(1)
        while True:
            shown = sent(joints(place, stands), how) + rng.normal(0.0, NOISE_M, (17, 3))
            shown[rng.random(17) < OUTLIERS] += rng.uniform(-0.5, 0.5, 3)
            sender.send([(1, shown)])
            time.sleep(1 / 60)

    threading.Thread(target=send, daemon=True).start()
    for line in sys.stdin:
        words = line.split()
        place, stands = np.array([float(word) for word in words[:3]]), "walk" in words
        time.sleep(0.1)
        print("there", flush=True)


if __name__ == "__main__":
    main()
