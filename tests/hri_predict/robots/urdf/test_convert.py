"""Robot files from URDF: end to end, against poses multiplied by hand."""

import sys
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.errors import RobotError
from hri_predict.base.geometry import segment_distance
from hri_predict.base.settings import Pose
from hri_predict.robots.file import read_robot_file
from hri_predict.robots.model import RobotModel, RobotSettings, load_robot
from hri_predict.robots.urdf import convert as converter
from hri_predict.robots.urdf.tree import read_chain
from tests.arms import arm_settings
from tests.hri_predict.robots.urdf.small_urdf import CHAIN, CORNERS, STOP, URDF, run, stl


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    folder = tmp_path_factory.mktemp("urdf")
    (folder / "arm.stl").write_bytes(stl(CORNERS))
    (folder / "small.urdf").write_text(URDF.replace("MESH", "arm.stl"))
    assert run(folder / "small.urdf", *CHAIN, *STOP) == 0
    settings = arm_settings("mine.yaml", payload_kg=1.0)
    return load_robot(settings, folder)


def test_what_comes_out(urdf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(urdf, *CHAIN, *STOP) == 0
    assert capsys.readouterr().out.endswith(
        "mine.yaml: 3 joints, 5 capsules; review the file before you use it\n"
        "what it holds: under tool: and payload:, in the frame of 'wrist', the last link that "
        "moves ('camera': xyz [0.1, 0.0, 0.0], rpy [0.0, 1.0, 0.0] in it)\nnot covered: finger\n"
    )
    text = " ".join((urdf.parent / "mine.yaml").read_text().replace("#", " ").split())
    assert "in the frame of 'wrist', the last link that moves ('camera': xyz [0.1," in text
    robot = read_robot_file("mine.yaml", urdf.parent)
    assert robot.name == "small"
    assert robot.links() == ["plate", "tower", "arm", "wrist"]
    assert [j.position for j in robot.joints] == [[-3, 2.5], [-2, 2], [-8, 8]]
    assert [j.velocity for j in robot.joints] == [1.5, 1, 2]
    assert robot.joints[0].axis == [0, 0, 1]
    carried = {c.name: c.link for c in robot.capsules}
    assert carried == {
        "plate": "plate", "tower": "tower", "arm": "arm", "wrist": "wrist", "camera": "wrist"
    }  # fmt: skip
    # 1 m/s: 0.1 s + 1 / 2 s; 0.1 m + 1 / (2 x 2) m
    i = robot.stopping.speed_m_s.index(1.0)
    assert robot.stopping.rows[0].time_s[i] == pytest.approx(0.6, abs=2e-4)
    assert robot.stopping.rows[0].distance_m[i] == pytest.approx(0.35, abs=2e-4)
    assert robot.stopping.source.startswith("MODEL, NOT MEASURED")
    # The camera is a sphere: it needs its own radius, and gets 5 mm more.
    camera = next(c for c in robot.capsules if c.name == "camera")
    assert camera.radius == pytest.approx(0.035, abs=0.0011)


def test_a_joint_that_slides_is_prismatic_in_metres(urdf: Path) -> None:
    chain = ["--base", "plate", "--tip", "finger"]
    assert run(urdf, *chain, *STOP) == 0
    robot = read_robot_file("mine.yaml", urdf.parent)
    assert [joint.type for joint in robot.joints] == ["revolute"] * 3 + ["prismatic"]
    assert (robot.joints[3].position, robot.joints[3].velocity) == ([0.0, 0.1], 1.0)
    model = load_robot(
        RobotSettings(name="a", model="mine.yaml", room_from_robot=Pose(), max_speed_m_s=1.0),
        urdf.parent,
    )
    finger, out = model.capsule_names.index("finger"), np.array([0.3, 0.2, 0.1, 0.08])
    moved = model.capsules(out).a[finger] - model.capsules(out * [1, 1, 1, 0]).a[finger]
    turned = frames([0.3, 0.2, 0.1])["camera"].rotation
    np.testing.assert_allclose(moved, turned @ [0.08, 0, 0], atol=1e-4)


@settings(max_examples=20)
@given(st.lists(st.floats(-2, 2), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_it_holds_the_whole_robot(model: RobotModel, angles: list[float], seed: int) -> None:
    placed = model.capsules(np.array(angles))
    rng = np.random.default_rng(seed)
    poses = frames(angles)
    spots = rng.uniform(-1, 1, (60, 3))
    unit = spots / np.linalg.norm(spots, axis=1)[:, None]
    ring = np.column_stack(
        [unit[:, :2] / np.linalg.norm(unit[:, :2], axis=1)[:, None], spots[:, 2]]
    )
    tower = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, 0, 0), np.array([0.02, 0, 0.2]))
    solids = {  # points of each link's solids, in its own frame
        "plate": spots * [0.2, 0.1, 0.05],
        "tower": np.vstack(
            [(ring * [0.06, 0.06, 0.2]) @ tower.rotation.T + tower.translation,
             unit * 0.07 + [0, 0.1, 0]]
        ),
        "arm": CORNERS * [0.5, 1, 1] + [0.2, 0, 0],
        "wrist": spots * 0.05,
        "camera": unit * 0.03 + [0, 0, 0.05],
    }  # fmt: skip
    for link, points in solids.items():
        i = model.capsule_names.index(link)
        world = points @ poses[link].rotation.T + poses[link].translation
        far = segment_distance(world, world, placed.a[i], placed.b[i]).max()
        assert far <= placed.radius[i] - 0.005 + 1e-9


def frames(angles: list[float]) -> dict[str, pinocchio.SE3]:
    """Every link's pose from the plate, multiplied by hand."""

    def pose(xyz: list[float], rpy: list[float]) -> pinocchio.SE3:
        return pinocchio.SE3(pinocchio.rpy.rpyToMatrix(np.array(rpy, float)), np.array(xyz, float))

    def turn(axis: list[float], angle: float) -> pinocchio.SE3:
        return pinocchio.SE3(pinocchio.exp3(np.array(axis) * angle), np.zeros(3))

    plate = pinocchio.SE3.Identity()
    tower = plate * pose([0, 0, 0.1], [0.1, 0.2, 0.3]) * turn([0, 0, 1.0], angles[0])
    top = tower * pose([0, 0, 0.4], [0, 0.5, 0])
    arm = top * pose([0, 0.05, 0], [0, 0, 0.7]) * turn([0, 1.0, 0], angles[1])
    wrist = arm * pose([0.4, 0, 0], [0, 0, 0]) * turn([0.6, 0, 0.8], angles[2])
    camera = wrist * pose([0.1, 0, 0], [0, 1, 0])
    return {"plate": plate, "tower": tower, "arm": arm, "wrist": wrist, "camera": camera}


@pytest.mark.long
def test_a_mesh_in_a_package(urdf: Path) -> None:
    meshes = urdf.parent / "ws" / "my_arm" / "meshes"
    meshes.mkdir(parents=True)
    (urdf.parent / "arm.stl").rename(meshes / "arm.stl")
    urdf.write_text(URDF.replace("MESH", "package://my_arm/meshes/arm.stl"))
    for i, folder in enumerate((urdf.parent / "ws", urdf.parent / "ws" / "my_arm")):
        out = ["--out", str(urdf.parent / f"{i}.yaml")]
        assert run(urdf, *CHAIN, *STOP, "--package-dir", str(folder), *out) == 0
    inside = urdf.rename(meshes.parent / "small.urdf")  # its own package needs no option
    assert run(inside, *CHAIN, *STOP) == 0


def test_a_stopping_table_copied(urdf: Path) -> None:
    assert run(urdf, *CHAIN, "--stopping-from", "ur5e") == 0
    mine, ur5e = (read_robot_file(n, urdf.parent) for n in ("mine.yaml", "ur5e"))
    assert mine.stopping.rows == ur5e.stopping.rows
    assert mine.stopping.source.startswith("COPIED FROM ur5e, NOT MEASURED ON THIS ROBOT")


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="f" count="12">0 0 0 0.3 0 0 0 0.2 0 0 0 0.1</float_array>
      <technique_common><accessor source="#f" count="4" stride="3"><param name="X" type="float"/>
        <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
    </source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/>
      <p>0 1 2 0 1 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def test_a_link_that_is_only_seen_is_covered_as_seen(urdf: Path) -> None:
    (urdf.parent / "top.dae").write_text(DAE)
    seen = '<visual><geometry><mesh filename="top.dae"/></geometry></visual>'
    urdf.write_text(
        URDF.replace('<link name="top"/>', f'<link name="top">{seen}</link>').replace(
            "MESH", "arm.stl"
        )
    )
    assert run(urdf, *CHAIN, *STOP) == 0
    top = next(c for c in read_robot_file("mine.yaml", urdf.parent).capsules if c.name == "top")
    # In the tower's frame: 0.4 up, turned by 0.5 about y, which takes x to (cos, 0, -sin).
    c, s = np.cos(0.5), np.sin(0.5)
    corners = np.array([[0, 0, 0.4], [0.3 * c, 0, 0.4 - 0.3 * s], [0, 0.2, 0.4],
                        [0.1 * s, 0, 0.4 + 0.1 * c]])  # fmt: skip
    far = segment_distance(corners, corners, np.array(top.a), np.array(top.b)).max()
    assert top.link == "tower"
    assert 0.004 <= top.radius - far <= 0.0061


def test_what_was_left_out_is_left_out(urdf: Path) -> None:
    chain = read_chain(urdf, "plate", "camera", left_out=["finger"], packages=[])
    assert "finger" not in chain.text
    assert "seen.dae" not in chain.text  # nothing but collision geometry is looked at
    assert "world" not in chain.text


# --- mistakes ---


def test_without_pinocchio(urdf: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(RobotError, match=r"pip install 'hri-predict\[robot\]'"):
        converter.convert(urdf, base="plate", tip="camera", stopping={}, left_out=["finger"])


def test_nothing_is_overwritten(urdf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (urdf.parent / "mine.yaml").write_text("precious")
    assert run(urdf, *CHAIN, *STOP) == 2
    assert "already exists" in capsys.readouterr().err
    assert (urdf.parent / "mine.yaml").read_text() == "precious"


def test_too_many_joints(tmp_path: Path) -> None:
    text = "<robot name='snake'><link name='l0'/>" + "".join(
        f"<link name='l{i}'/><joint name='j{i}' type='revolute'><parent link='l{i - 1}'/>"
        f"<child link='l{i}'/></joint>"
        for i in range(1, 11)
    )
    (tmp_path / "snake.urdf").write_text(text + "</robot>")
    with pytest.raises(RobotError, match=r"10 joints move.*carries 1 to 9"):
        read_chain(tmp_path / "snake.urdf", "l0", "l10", left_out=[], packages=[])
    assert (
        len(read_chain(tmp_path / "snake.urdf", "l0", "l9", left_out=["l10"], packages=[]).joints)
        == 9
    )


def test_extensions_of_other_programs_are_named(
    urdf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = '<d:hint xmlns:d="http://drake.mit.edu"/>'
    text = urdf.read_text().replace("</robot>", f"<gazebo>{more}</gazebo>{more}</robot>")
    urdf.write_text(text.replace('<link name="top"/>', f'<link name="top">{more}</link>'))
    assert run(urdf, *CHAIN, *STOP) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    assert said == "ignored, from other programs: <hint> of http://drake.mit.edu (2)"


def test_a_turn_of_two_pi_with_few_digits_and_a_mirrored_mesh_are_accepted(urdf: Path) -> None:
    text = urdf.read_text().replace('lower="-3" upper="2.5"', 'lower="-6.2832" upper="6.2832"')
    text = text.replace('rpy="0 0 0.7"', 'rpy="0 0 6.28319"').replace('"0.5 1 1"', '"0.5 -1 1"')
    urdf.write_text(text)
    assert run(urdf, *CHAIN, *STOP) == 0
