"""The Panda and the UR5 against pinocchio, coal, and meshes."""

import os
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio
import pytest
import yaml

from hri_predict.base.arrays import Floats
from hri_predict.base.files import data_path
from hri_predict.base.geometry import Capsules, capsule_distance, segment_distance
from hri_predict.cli.check.check import examine
from hri_predict.robots.model import RobotModel, load_robot
from hri_predict.run import config as configuration
from tests.arms import arm_settings

ROBOTS: dict[str, dict[str, Any]] = {
    name: yaml.safe_load(data_path("robots", f"{name}.yaml").read_text())
    for name in ("panda", "ur5")
}


def arm(name: str) -> RobotModel:
    settings = arm_settings(name, payload_kg=2.0)
    return load_robot(settings, None)


ARMS = {name: arm(name) for name in ROBOTS}


def payload_at(name: str, q: list[float]) -> tuple[Floats, Floats]:
    placed = ARMS[name].capsules(np.array(q))
    i = ARMS[name].capsule_names.index("payload")
    return placed.a[i], placed.b[i]


@pytest.mark.parametrize("name", ROBOTS)
def test_distances_between_links_equal_coal(name: str) -> None:
    rng = np.random.default_rng(5)
    model = ARMS[name]
    compared = 0
    for _ in range(4):
        placed = model.capsules(rng.uniform(model.position_min, model.position_max))
        count = len(model.capsule_names)
        for i in range(count):
            for j in range(i + 2, count):
                one, other = (Capsules(placed.a[k], placed.b[k], placed.radius[k]) for k in (i, j))
                expected = coal_distance(one, other)
                if expected > 0:  # coal's depth is that of another definition
                    assert float(capsule_distance(one, other)) == pytest.approx(expected, abs=1e-6)
                    compared += 1
    assert compared > 40


def coal_distance(*capsules: Capsules) -> float:
    shapes = []
    for c in capsules:
        along = c.b - c.a
        length = float(np.linalg.norm(along))
        turn = pinocchio.Quaternion.FromTwoVectors(np.array([0, 0, 1.0]), along / length).matrix()
        pose = coal.Transform3s(turn, (c.a + c.b) / 2)
        shapes += [coal.Capsule(float(c.radius), length), pose]
    result = coal.DistanceResult()
    return float(coal.distance(*shapes, coal.DistanceRequest(), result))


# --- the meshes ---

SHARE = Path(
    os.environ.get("EXAMPLE_ROBOT_SHARE", Path(pinocchio.__file__).parents[4] / "share")
)  # where example-robot-data is installed, beside pinocchio by default
MESHES = SHARE / "example-robot-data" / "robots"
needs_meshes = pytest.mark.skipif(
    not MESHES.is_dir(), reason="needs the package example-robot-data (pip install it; 131 MB)"
)
URDF = {
    "panda": MESHES / "panda_description" / "urdf" / "panda.urdf",
    "ur5": MESHES / "ur_description" / "urdf" / "ur5_robot.urdf",
}
LINKS = {  # capsule by URDF link, and the radius in mm that the robot file's comment says it needs
    "panda": {
        "panda_link0": ("panda_link0", 104.7),
        "panda_link1": ("panda_link1", 76.3),
        "panda_link2": ("panda_link2", 76.6),
        "panda_link3": ("panda_link3", 69.8),
        "panda_link4": ("panda_link4", 69.7),
        "panda_link5": ("panda_link5", 67.7),
        "panda_link6": ("panda_link6", 75.0),
        "panda_link7": ("panda_link7", 49.5),
        "panda_hand": ("hand", 72.5),
        "panda_leftfinger": ("hand", 72.5),
        "panda_rightfinger": ("hand", 72.5),
    },
    "ur5": {
        "base_link": ("base", 74.3),
        "shoulder_link": ("shoulder", 82.0),
        "upper_arm_link": ("upper_arm", 84.4),
        "forearm_link": ("forearm", 64.2),
        "wrist_1_link": ("wrist_1", 56.8),
        "wrist_2_link": ("wrist_2", 56.8),
        "wrist_3_link": ("wrist_3", 40.3),
    },
}


def vertices(name: str, q: Floats) -> tuple[dict[str, list[Floats]], Any]:
    """Every link's vertices, visual and collision, in the frame of the robot file's base; and the
    pose of its last link, all by pinocchio from the URDF."""
    model = pinocchio.buildModelFromUrdf(str(URDF[name]))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    base, tip = ("panda_link0", "panda_link7") if name == "panda" else ("base", "tool0")
    inverse = data.oMf[model.getFrameId(base)].inverse()
    found: dict[str, list[Floats]] = {}
    for kind in (pinocchio.GeometryType.COLLISION, pinocchio.GeometryType.VISUAL):
        geometry = pinocchio.buildGeomFromUrdf(
            model, str(URDF[name]), kind, package_dirs=[str(SHARE)]
        )
        for item in geometry.geometryObjects:
            shape = item.geometry
            if isinstance(shape, coal.Box):
                points = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
                points = points * shape.halfSide
            else:
                points = np.array(shape.vertices())
            pose = inverse * data.oMi[item.parentJoint] * item.placement
            placed = points @ pose.rotation.T + pose.translation
            found.setdefault(model.frames[item.parentFrame].name, []).append(placed)
    return found, inverse * data.oMf[model.getFrameId(tip)]


@needs_meshes
@pytest.mark.parametrize("name", ROBOTS)
def test_every_vertex_is_inside_as_the_comment_says(name: str) -> None:
    model = ARMS[name]
    q = np.random.default_rng(7).uniform(model.position_min, model.position_max)
    fingers = [0.04, 0.04] if name == "panda" else []  # wide open
    found, _ = vertices(name, np.array([*q, *fingers]))
    placed = model.capsules(q)
    needed: dict[str, float] = {}
    for link, (capsule, _) in LINKS[name].items():
        i = model.capsule_names.index(capsule)
        points = np.vstack(found[link])
        far = segment_distance(points, points, placed.a[i], placed.b[i]).max()
        needed[capsule] = max(needed.get(capsule, 0.0), float(far))
    assert set(needed) == set(model.capsule_names) - {"payload"} - (
        {"gripper"} & {*model.capsule_names}
    )
    for capsule, stated_mm in LINKS[name].values():
        radius = placed.radius[model.capsule_names.index(capsule)]
        assert 1000 * needed[capsule] == pytest.approx(stated_mm, abs=0.06)
        assert 0.004 <= radius - needed[capsule] <= 0.01


@needs_meshes
@pytest.mark.parametrize("name", ROBOTS)
def test_forward_kinematics_equal_the_urdf(name: str) -> None:
    model = ARMS[name]
    rng = np.random.default_rng(8)
    part = ROBOTS[name]["payload"][0]
    fingers = [0.0, 0.0] if name == "panda" else []
    for _ in range(3):
        q = rng.uniform(model.position_min, model.position_max)
        _, tip = vertices(name, np.array([*q, *fingers]))
        for ours, local in zip(payload_at(name, q.tolist()), (part["a"], part["b"]), strict=True):
            np.testing.assert_allclose(ours, tip.act(np.array(local)), atol=1e-9)


# --- in a cell ---

CELL = """
rate_hz: 25
source:
  kind: procedural
  room_from_source: {xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
  people: [{start: [1.2, -0.2], script: [{do: wait, seconds: 60}]}]
predictor: {name: constant_velocity, horizon_s: 1.4}
robots:
  - name: franka
    model: panda
    room_from_robot: {xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
    payload_kg: 1.0
    max_speed_m_s: 1.0
"""
UR5E = """
  - name: ur
    model: ur5e
    room_from_robot: {xyz: [2, 0, 0], quaternion_xyzw: [0, 0, 1, 0]}
    payload_kg: 2.0
    max_speed_m_s: 1.0
"""
LINKS_OF_CELL = """
links:
  - {name: bus, kind: can, interface: virtual, channel: arms, bitrate: 500000}
"""


@pytest.mark.parametrize(("more", "robots"), [("", ["franka"]), (UR5E, ["franka", "ur"])])
def test_a_cell_with_a_panda_passes_check(tmp_path: Path, more: str, robots: list[str]) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(CELL + more + LINKS_OF_CELL)
    found = examine(configuration.load(path))
    assert list(found["stopping"]) == robots
    assert 0 < found["links"][0]["load"] < 1
