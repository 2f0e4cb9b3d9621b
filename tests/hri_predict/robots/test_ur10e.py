"""The UR10e against its published table, alone and on its rail."""

import numpy as np

from hri_predict.base.settings import Pose
from hri_predict.robots.model import RobotModel, RobotSettings, load_robot


def shipped(name: str) -> RobotModel:
    settings = RobotSettings(
        name="arm", model=name, room_from_robot=Pose(), max_speed_m_s=1.0, payload_kg=2.5
    )
    return load_robot(settings, None)


def test_the_ur10e_is_the_published_table() -> None:
    """Universal Robots, article 45257: a2 -0.6127, a3 -0.57155, d1 0.1807, d4 0.17415, d5 0.11985,
    d6 0.11655 m. Stretched, it reaches a2 + a3 along -x, -(d4 + d6) and d1 - d5."""
    robot = shipped("ur10e")
    gripper = robot.capsule_names.index("gripper")
    placed = robot.capsules(np.zeros(6))
    expected = [-0.6127 - 0.57155, -(0.17415 + 0.11655) - 0.03, 0.1807 - 0.11985]
    np.testing.assert_allclose(placed.a[gripper], expected, atol=1e-12)
    upright = robot.capsules(np.array([0, -np.pi / 2, 0, -np.pi / 2, 0, 0]))
    height = 0.1807 + 0.6127 + 0.57155 + 0.11985
    np.testing.assert_allclose(upright.a[gripper], [0, -0.2907 - 0.03, height], atol=1e-12)


def test_on_its_rail_the_ur10e_is_the_same_arm_farther_on() -> None:
    arm, on_rail = (shipped(name) for name in ("ur10e", "ur10e_rail"))
    q = np.array([0.1, -1.0, 1.2, -1.7, -1.5, 0.3])
    alone, moved = arm.capsules(q), on_rail.capsules(np.array([0.7, *q]))
    for i, name in enumerate(arm.capsule_names):
        at = moved.a[on_rail.capsule_names.index(name)]
        np.testing.assert_allclose(at, alone.a[i] + [0.7, 0.0, 0.35], atol=1e-12)
    assert on_rail.units[:2] == ("m", "rad")
