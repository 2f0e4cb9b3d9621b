"""Shipped arms against their published tables and poses, by pinocchio."""

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.files import data_path
from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.robots.model import RobotModel, load_robot
from tests.arms import arm_settings

HALF = np.pi / 2
UR_ALPHA = (HALF, 0, 0, HALF, -HALF, 0)
Rows = list[tuple[float, float, float]]
IIWA_ALPHA = (-HALF, HALF, HALF, -HALF, -HALF, HALF, 0)


def ur(a2: float, a3: float, d1: float, d4: float, d5: float, d6: float) -> Rows:
    return list(zip((0, a2, a3, 0, 0, 0), UR_ALPHA, (d1, 0, 0, d4, d5, d6), strict=True))


# Rows of Denavit and Hartenberg, classic: a, alpha, d. The iiwas' files have origins
# instead, with upright frames; the table of the Panda and FR3 is Craig's, modified.
CLASSIC: dict[str, Rows] = {
    "ur3e": ur(-0.24355, -0.2132, 0.15185, 0.13105, 0.08535, 0.0921),
    "ur5": ur(-0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823),
    "ur10e": ur(-0.6127, -0.57155, 0.1807, 0.17415, 0.11985, 0.11655),  # their article 45257
    "ur20": ur(-0.8620, -0.7287, 0.2363, 0.2010, 0.1593, 0.1543),
    "iiwa14_r820": list(zip((0,) * 7, IIWA_ALPHA, (0.36, 0, 0.42, 0, 0.4, 0, 0.126), strict=True)),
    "iiwa7_r800": list(zip((0,) * 7, IIWA_ALPHA, (0.34, 0, 0.4, 0, 0.4, 0, 0.126), strict=True)),
}
FRANKA: Rows = [
    (0, 0, 0.333),
    (0, -HALF, 0),
    (0, HALF, 0.316),
    (0.0825, HALF, 0),
    (-0.0825, -HALF, 0.384),
    (0, HALF, 0),
    (0.088, HALF, 0),
]
MODIFIED = {"panda": FRANKA, "fr3": FRANKA}
ALL = [*CLASSIC, *MODIFIED]
ARMS = ["ur3e", "ur20", "iiwa14_r820", "iiwa7_r800", "fr3"]

# Degrees and degrees a second, from the makers' manuals as the robot files cite them.
LIMITS = {
    "ur3e": ([360] * 6, [180, 180, 180, 360, 360, 360]),
    "ur20": ([360] * 6, [120, 120, 150, 210, 210, 210]),
    "iiwa14_r820": ([170, 120, 170, 120, 170, 120, 175], [85, 85, 100, 75, 130, 135, 135]),
    "iiwa7_r800": ([170, 120, 170, 120, 170, 120, 175], [98, 98, 100, 130, 140, 180, 180]),
}


def arm(name: str, payload_kg: float | None = None) -> RobotModel:
    return load_robot(
        arm_settings(name, payload_kg=payload_kg),
        None,
    )


MODELS = {name: arm(name) for name in ALL}
FILES: dict[str, dict[str, Any]] = {
    name: yaml.safe_load(data_path("robots", f"{name}.yaml").read_text()) for name in ALL
}


def translation(x: float, z: float) -> Any:
    return pinocchio.SE3(np.eye(3), np.array([x, 0.0, z]))


def turn(alpha: float) -> Any:
    return pinocchio.SE3(pinocchio.utils.rotate("x", alpha), np.zeros(3))


def oracle(name: str, q: Floats) -> Any:
    """Pose of the frame at the end of the published rows."""
    model, parent, after = pinocchio.Model(), 0, pinocchio.SE3.Identity()
    for i, (a, alpha, d) in enumerate(CLASSIC.get(name) or MODIFIED[name]):
        if name in MODIFIED:
            before, rest = after * turn(alpha) * translation(a, d), pinocchio.SE3.Identity()
        else:
            before, rest = after, translation(a, d) * turn(alpha)
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), before, f"j{i}")
        after = rest
    data = model.createData()
    pinocchio.forwardKinematics(model, data, q)
    return data.oMi[parent] * after


def ends_of_tool(name: str, q: Floats) -> tuple[Floats, Floats]:
    placed = MODELS[name].capsules(q)
    i = MODELS[name].capsule_names.index(FILES[name]["tool"][0]["name"])
    return placed.a[i], placed.b[i]


@pytest.mark.parametrize("name", ALL)
@given(st.lists(st.floats(-2.9, 2.9), min_size=7, max_size=7))
def test_the_chain_is_the_published_table(name: str, angles: list[float]) -> None:
    q = np.array(angles[: MODELS[name].dof])
    # The classic tables end at the flange, whose gripper is 30 to 100 mm beyond it.
    part = FILES[name]["tool"][0]
    ends = ([0, 0, 0.03], [0, 0, 0.1]) if name in CLASSIC else (part["a"], part["b"])
    # Metre-sized sums of some ten products of doubles: 1e-15 each.
    for ours, local in zip(ends_of_tool(name, q), ends, strict=True):
        np.testing.assert_allclose(ours, oracle(name, q).act(np.array(local, float)), atol=1e-12)


ZERO: list[float] = [0] * 7
UPRIGHT = [0, -HALF, 0, -HALF, 0, 0]
C = 0.5**0.5


@pytest.mark.parametrize(
    ("name", "q", "at"),
    [
        # Stretched along -x: a2 + a3, -(d4 + d6), d1 - d5, as in the maker's figure.
        ("ur3e", ZERO, [-0.45675, -0.22315 - 0.03, 0.0665]),
        ("ur5", ZERO, [-0.81725, -0.19145 - 0.03, -0.005491]),
        ("ur10e", ZERO, [-1.18425, -0.2907 - 0.03, 0.06085]),
        ("ur20", ZERO, [-1.5907, -0.3553 - 0.03, 0.077]),
        # Upright: d1 - a2 - a3 + d5.
        ("ur5", UPRIGHT, [0, -0.19145 - 0.03, 1.001059]),
        ("ur10e", UPRIGHT, [0, -0.2907 - 0.03, 1.4848]),
        # Upright: 0.36 + 0.42 + 0.4 + 0.126 = 1.306 m, the flange's height; 1.266 m for the 7.
        ("iiwa14_r820", ZERO, [0, 0, 1.306 + 0.03]),
        ("iiwa7_r800", ZERO, [0, 0, 1.266 + 0.03]),
        # The flange at 0.926 m looks down; link 7's frame is 0.107 m above it.
        ("panda", ZERO, [0.088 - 0.042, 0.042, 1.033 - 0.148]),
        ("fr3", ZERO, [0.088 - 0.042, 0.042, 1.033 - 0.148]),
        # Where Franka's examples begin. In the x-z plane, with c = sqrt(1/2): the upper arm leans
        # back by 45 degrees, the forearm is level, the hand hangs, turned by 45 degrees.
        (
            "panda",
            [0, -HALF / 2, 0, -1.5 * HALF, 0, HALF, HALF / 2],
            [0.472 - 0.2335 * C, 0.084 * C, 0.4155 + 0.3985 * C - 0.148],
        ),
    ],
)
def test_poses_are_the_published_ones(name: str, q: list[float], at: list[float]) -> None:
    found, _ = ends_of_tool(name, np.array(q[: MODELS[name].dof], float))
    np.testing.assert_allclose(found, at, atol=1e-12)


def test_on_its_rail_the_ur10e_is_the_same_arm_farther_on() -> None:
    alone, on_rail = MODELS["ur10e"], arm("ur10e_rail")
    q = np.array([0.1, -1.0, 1.2, -1.7, -1.5, 0.3])
    placed, moved = alone.capsules(q), on_rail.capsules(np.array([0.7, *q]))
    for i, name in enumerate(alone.capsule_names):
        at = moved.a[on_rail.capsule_names.index(name)]
        np.testing.assert_allclose(at, placed.a[i] + [0.7, 0.0, 0.35], atol=1e-12)
    assert on_rail.units[:2] == ("m", "rad")


@pytest.mark.parametrize(
    ("name", "reach_m", "slack_m"),
    [
        # To the centre of the wrist, as KUKA counts; Universal Robots count the UR20's to the far
        # side of wrist 2 (a2 + a3 + d5). The UR3e's 0.5 m lies between a2 + a3 and a2 + a3 + d5.
        ("iiwa14_r820", 0.82, 1e-9),
        ("iiwa7_r800", 0.80, 1e-9),
        ("ur20", 1.75, 1e-9),
        ("ur3e", 0.5, 0.0435),
    ],
)
def test_the_reach_is_the_published_one(name: str, reach_m: float, slack_m: float) -> None:
    joints = FILES[name]["joints"]
    if name.startswith("ur"):
        rows = [joint["dh"] for joint in joints]
        reach = -rows[1]["a"] - rows[2]["a"] + rows[4]["d"]
    else:
        reach = joints[3]["origin"]["xyz"][2] + joints[5]["origin"]["xyz"][2]
    assert reach == pytest.approx(reach_m, abs=slack_m)


@pytest.mark.parametrize("name", LIMITS)
def test_limits_are_the_published_ones(name: str) -> None:
    position, velocity = (np.radians(values) for values in LIMITS[name])
    np.testing.assert_allclose(MODELS[name].position_max, position, atol=1e-12)
    np.testing.assert_allclose(MODELS[name].position_min, -position, atol=1e-12)
    np.testing.assert_allclose(MODELS[name].velocity_max, velocity, atol=1e-12)


def test_limits_of_the_fr3_hold_every_published_range() -> None:
    """The older, narrower ranges of franka_description lie within: no pose of it is refused."""
    low = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
    high = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
    assert np.all(MODELS["fr3"].position_min <= low)
    assert np.all(MODELS["fr3"].position_max >= high)
    assert MODELS["fr3"].velocity_max.tolist() == [2.62] * 4 + [5.26, 4.18, 5.26]


@pytest.mark.parametrize("name", ARMS)
def test_the_first_joint_at_full_speed_moves_the_tip_as_far_as_it_reaches(name: str) -> None:
    model = MODELS[name]
    q = np.zeros(model.dof)
    if name == "fr3":
        q[1], q[3] = HALF, -0.12
    elif name.startswith("iiwa"):
        q[1] = HALF
    qd = np.zeros(model.dof)
    qd[0] = model.velocity_max[0]
    placed = model.capsules(q)
    ends = np.concatenate([placed.a, placed.b])
    radii = np.concatenate([placed.radius, placed.radius])
    reach = (np.linalg.norm(ends[:, :2], axis=1) + radii).max()
    assert float(model.tip_speed(q, qd)) == pytest.approx(reach * qd[0], rel=1e-9)
    assert 1.5 < reach * qd[0] < 5.0


@pytest.mark.parametrize("name", ARMS)
def test_capsules_of_neighbouring_links_leave_no_gap(name: str) -> None:
    model = MODELS[name]
    links = [FILES[name]["base"], *(j["child"] for j in FILES[name]["joints"])]
    of = {
        link: [
            model.capsule_names.index(c["name"])
            for c in FILES[name]["capsules"]
            if c["link"] == link
        ]
        for link in links
    }
    rng = np.random.default_rng(4)
    for _ in range(50):
        placed = model.capsules(rng.uniform(model.position_min, model.position_max))
        part = [
            Capsules(*(x[k] for x in (placed.a, placed.b, placed.radius)))
            for k in range(len(placed.a))
        ]
        for one, other in pairwise(links):
            assert (
                min(float(capsule_distance(part[i], part[j])) for i in of[one] for j in of[other])
                <= 0.0
            ), (one, other)


@pytest.mark.parametrize("name", ["fr3", "iiwa7_r800"])
def test_estimated_capsules_are_not_thinner_than_those_they_come_from(name: str) -> None:
    origin = {"fr3": "panda", "iiwa7_r800": "iiwa14_r820"}[name]
    fitted = yaml.safe_load(data_path("robots", f"{origin}.yaml").read_text())["capsules"]
    added = {"fr3": 0.01, "iiwa7_r800": 0.0}[name]
    for ours, theirs in zip(FILES[name]["capsules"], fitted, strict=True):
        assert ours["radius"] == pytest.approx(theirs["radius"] + added, abs=1e-12)


def test_the_ur20_is_at_least_a_larger_ur10e() -> None:
    """Every capsule of the UR10e, 1.33 times as thick: the ratio of the published wrists."""
    smaller = yaml.safe_load(data_path("robots", "ur10e.yaml").read_text())["capsules"]
    for ours, theirs in zip(FILES["ur20"]["capsules"], smaller, strict=True):
        assert ours["name"] == theirs["name"]
        # Rounded to whole millimetres.
        assert ours["radius"] >= 0.1593 / 0.11985 * theirs["radius"] - 0.0005


def test_the_ur3e_stops_no_sooner_than_the_worst_published_for_its_predecessor() -> None:
    """UR3/CB3, User Manual 3.10, appendix A.1: shoulder, 183 deg/s, 3 kg: 0.20 rad, 154 ms."""
    reach_m = 0.5
    time_s, distance_m = arm("ur3e", 3.0).stopping(float(np.radians(183)) * reach_m)
    assert time_s >= 0.154
    assert distance_m >= 0.20 * reach_m


@pytest.mark.parametrize(
    ("name", "payload_kg"),
    [("ur3e", 3.0), ("ur20", 20.0), ("fr3", 3.0), ("iiwa14_r820", 14.0), ("iiwa7_r800", 7.0)],
)
def test_the_rated_payload_is_taken_and_the_table_says_that_it_is_a_model(
    name: str, payload_kg: float
) -> None:
    assert arm(name, payload_kg).stopping(1.0)[1] > arm(name, 0.0).stopping(1.0)[1]
    source = FILES[name]["stopping"]["source"]
    assert "MODEL, NOT MEASURED" in source
    assert "hri-predict commission" in source
