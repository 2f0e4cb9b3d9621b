"""``check`` and ``bench joint-maps`` say what it costs that a tracker lacks joints."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from hri_predict.base.files import data_path
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.check.check import check, examine
from hri_predict.cli.check.joint_map import joint_map_cost, joint_map_lines
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_sim.bench.command import app

pytestmark = pytest.mark.usefixtures("built_once")
LIVE = ("live_json", "live_mvn", "live_serial", "live_udp", "live_websocket")


@pytest.fixture
def written(tmp_path):
    def write(joint_map, more=""):
        text = configuration.shipped("live_udp.yaml").read_text(encoding="utf-8")
        path = tmp_path / "cell.yaml"
        path.write_text(text.replace("joint_map: canonical", f"joint_map: {joint_map}") + more)
        return path

    return write


def cost_of(path):
    return examine(configuration.load(path))["joint_map"]


def test_coco_has_a_line_for_each_kind_of_joint(written, capsys):
    check(config=written("coco17"))
    lines = [line for line in capsys.readouterr().out.splitlines() if "joint map coco17" in line]
    assert len(lines) == 4
    assert "l_hand, r_hand inferred from elbow, wrist, within 0.13 m" in "".join(lines)
    assert all("times the volume of delivered joints now" in line for line in lines)


def test_inferred_joints_cost_volume(written):
    parts = cost_of(written("coco17"))["parts"]
    assert {joint for part in parts for joint in part["joints"]} == {
        "torso", "head_top", "l_hand", "r_hand", "l_foot", "r_foot",
    }  # fmt: skip
    assert all(part["times_now"] > 1.2 for part in parts)


def test_a_map_with_all_joints_costs_nothing(written, capsys):
    assert cost_of(written("canonical"))["parts"] == []
    check(config=written("canonical"))
    assert "joint map" not in capsys.readouterr().out


def test_what_the_posture_gives_is_named_as_such(written, capsys):
    check(config=written("assembly_arms"))
    lines = [line for line in capsys.readouterr().out.splitlines() if "joint map" in line]
    (rest,) = [line for line in lines if "inferred from the posture of the joints seen" in line]
    assert "l_knee" in rest


def test_what_is_not_inferred_is_told_once_with_the_remedy(written):
    """A map of one arm: of its body too little is seen for a posture."""
    loaded = configuration.load(written("coco17"))
    whole = load_joint_map("coco17")
    arm = np.isin(JOINTS, ("l_shoulder", "l_elbow", "l_wrist"))
    few = replace(whole, weights=whole.weights * arm[:, None])
    lines = joint_map_lines(joint_map_cost(loaded, assemble.build_predictor(loaded), few))
    (rest,) = [line for line in lines if "bounded by reach" in line]
    assert "people.absent_parts" in rest
    assert "l_knee" in rest


def test_absent_parts_cost_nothing(written):
    legs = "people: {absent_parts: [left_leg, right_leg]}\n"
    joints = {j for part in cost_of(written("coco17", legs))["parts"] for j in part["joints"]}
    assert "l_foot" not in joints
    assert "l_hand" in joints


@pytest.mark.parametrize("name", LIVE)
def test_every_shipped_live_configuration_is_told(name):
    loaded = configuration.load(configuration.shipped(f"{name}.yaml"))
    source = assemble.build_source(loaded)
    cost = joint_map_cost(loaded, assemble.build_predictor(loaded), source.joint_map)
    missing = {joint for part in cost["parts"] for joint in part["joints"]}
    assert len(missing) == (~source.joint_map.mapped).sum()


def test_the_table_of_all_maps():
    done = CliRunner().invoke(app, ["joint-maps", "--json"])
    assert done.exit_code == 0, done.output
    rows = {row["joint_map"]: row for row in json.loads(done.stdout)}
    shipped = {path.stem for path in data_path("skeletons").glob("*.yaml")} - {"bvh"}
    assert set(rows) == shipped
    assert rows["canonical"]["reach"] == rows["canonical"]["inferred"]
    for name in shipped:
        assert rows[name]["missing"] == (~load_joint_map(name).mapped).sum()
        # where the body is now, inferring never costs volume
        assert rows[name]["inferred"][0] <= rows[name]["reach"][0]
    assert rows["coco17"]["inferred"][0] < 0.5 * rows["coco17"]["reach"][0]


@pytest.mark.parametrize(("name", "is_told"), [("assembly_arms", True), ("coco17", False)])
def test_a_map_that_allows_no_check_against_gravity_is_named(written, name, is_told):
    notes = examine(configuration.load(written(name)))["notes"]
    assert any("no check against gravity" in note for note in notes) == is_told
