"""``convert`` at the command line: summaries, choices, refusals, and whole files or none."""

import json
import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import open_recording
from hri_predict.recording.format_table import BY_NAME, of_ending
from hri_sim.replay import RecordingSettings, RecordingSource

WRITTEN = dict.fromkeys(each.ending for each in BY_NAME.values())
OF_ANY_JOINTS = [ending for ending in WRITTEN if ending != ".bvh"]
"""A BVH needs most joints of a body."""
GUIDE = Path(__file__).resolve().parents[3] / "docs" / "guides" / "convert.md"

TABLE = "time_s,person,waist_x,waist_y,waist_z,l_wrist_x,l_wrist_y,l_wrist_z\n" + "".join(
    f"{k / 50},{person},{k / 100},{person},1.0,0.3,{person},1.2\n"
    for k in range(51)
    for person in (2, 3)
)


@pytest.fixture
def cli(monkeypatch, cli, tmp_path):
    """Run ``convert`` where two.csv is; gives exit status, standard output, standard error."""
    (tmp_path / "two.csv").write_text(TABLE)
    monkeypatch.chdir(tmp_path)
    return partial(cli, "convert")


@pytest.fixture
def mistake(cli, tmp_path):
    def call(*arguments):
        before = sorted(tmp_path.iterdir())
        status, out, err = cli(*arguments)
        assert (status, out) == (2, "")
        assert len(err.splitlines()) == 1, err
        assert sorted(tmp_path.iterdir()) == before
        return err

    return call


def test_the_summary_is_text_or_json(cli):
    status, out, err = cli("two.csv", "two.c3d")
    assert (status, err) == (0, "")
    assert out == "two.c3d: 51 frames, 1.00 s at 50 per second, people [2, 3], 2 joints\n"
    status, out, err = cli("two.csv", "two.mcap", "--json")
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert summary["to"] == "mcap"
    assert summary["people"] == [2, 3]
    assert summary["frames"] == 51
    assert summary["dropped"] == {}
    assert open_recording("two.mcap").duration_s == pytest.approx(1.0)


def test_a_person_a_part_and_a_rate(cli):
    status, out, err = cli(
        "two.csv", "b.csv", "--person", 3, "--rate", 10, "--start", 0.2, "--end", 0.8, "--json"
    )
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert (summary["frames"], summary["rate_hz"], summary["people"]) == (7, 10.0, [3])
    assert summary["dropped"] == {"other people": 1}
    back = open_recording("b.csv")
    assert back.scenes[0].people[0].positions[0, 0] == pytest.approx(0.1)
    assert back.rate_hz == 10.0


def test_what_is_lost_is_said(cli):
    status, _, err = cli("two.csv", "one.npz")
    assert status == 0
    assert "dropped: 1 other people" in err
    assert "note: the format holds one person: 2 is written; choose with --person" in err
    assert (
        "note: the file does not store that this is person 2: give --person when reading it" in err
    )


def test_units_and_axes_of_the_input(cli):
    assert cli("two.csv", "b.csv", "--units", "mm", "--axes", "z,x,y")[0] == 0
    first = open_recording("b.csv").scenes[0].people[0].positions
    np.testing.assert_allclose(first[0], [0.001, 0, 0.002], atol=1e-6)


def test_a_left_handed_world_is_turned_not_mirrored(cli, mistake):
    options = ("--axes", "x,-y,z", "--left-handed", "--to", "csv")
    assert cli("two.csv", "b.csv", *options)[0] == 0
    raw, turned = (open_recording(f).scenes[0].people[0].positions for f in ("two.csv", "b.csv"))
    np.testing.assert_allclose(turned, raw * [1, -1, 1], atol=1e-6)
    assert "--left-handed: needs --axes" in mistake("two.csv", "c.csv", "--left-handed")
    wrong = mistake("two.csv", "c.csv", "--left-handed", "--axes", "x,y,z")
    assert "right-handed; change a sign, or set left_handed: false" in wrong


def test_the_file_is_replaced_by_force_alone_and_never_the_one_that_is_read(cli, mistake):
    assert cli("two.csv", "two.trc")[0] == 0
    before = Path("two.trc").read_bytes()
    assert "two.trc: already exists; --force replaces it" in mistake("two.csv", "two.trc")
    assert "cannot be written: File name too long" in mistake("two.csv", f"{'a' * 300}.csv")
    assert "cannot be written" in mistake("two.csv", "two.csv/three.csv")
    os.mkfifo("pipe.csv")
    assert "cannot be written: not a file" in mistake("two.csv", "pipe.csv", "--force")
    assert cli("two.csv", "two.trc", "--rate", 10, "--force")[0] == 0
    assert Path("two.trc").read_bytes() != before
    assert "is the input recording" in mistake("two.csv", "two.csv", "--force")
    Path("link.csv").symlink_to("two.csv")
    assert "is the input recording" in mistake("two.csv", "link.csv", "--force")


@pytest.mark.parametrize("ending", OF_ANY_JOINTS)
@pytest.mark.parametrize("problem", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_what_breaks_off_leaves_nothing_half(cli, tmp_path, monkeypatch, ending, problem):
    chosen = next(each for each in of_ending(ending) if each.write is not None)
    (tmp_path / f"a{ending}").write_bytes(b"old")

    write = chosen.write
    assert write is not None

    def broken(path, recording):
        write(path, recording)
        raise problem

    monkeypatch.setitem(BY_NAME, chosen.name, replace(chosen, write=broken))
    status, out, err = cli("two.csv", f"a{ending}", "--force")
    assert (status, out) == ((130, "") if problem is KeyboardInterrupt else (2, ""))
    assert problem is KeyboardInterrupt or "No space left" in err
    assert (tmp_path / f"a{ending}").read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([f"a{ending}", "two.csv"])


def test_mistakes_are_one_line_with_the_remedy(mistake):
    assert "unknown ending '.fbx'; use .npz" in mistake("two.csv", "a.fbx")
    assert "can be read but not written: ending '.bag'; use" in mistake("two.csv", "a.bag")
    assert "--to bvg: unknown; did you mean 'bvh'?" in mistake("two.csv", "a.fbx", "--to", "bvg")
    assert "use --to amass" in mistake("two.csv", "a.npz", "--to", "pack")
    said = mistake("two.csv", "a.db3", "--to", "rosbag2")
    assert "name it a.mcap, or use --to rosbag2-sqlite" in said
    assert "name it a.bvh" in mistake("two.csv", "a.bag", "--to", "bvh")
    said = mistake("two.csv", "a.xyz", "--to", "csv")
    assert "writes '.csv' files, and '.xyz' means no format; name it a.csv" in said
    assert "no such file" in mistake("gone.csv", "a.csv")
    assert ": no person 9; it has 2, 3" in mistake("two.csv", "a.csv", "--person", 9)
    assert "must be after --start" in mistake("two.csv", "a.csv", "--start", 3, "--end", 2)
    assert "it lasts 1.0 s" in mistake("two.csv", "a.csv", "--start", 3)
    for start in ("inf", "1e300"):
        assert "must be 0 to 1e+09 s" in mistake("two.csv", "a.csv", "--start", start)
    assert "never invented" in mistake("two.csv", "a.csv", "--rate", 100)
    assert "--rate 0: must be 0.1" in mistake("two.csv", "a.csv", "--rate", 0)
    assert "--units px: use one of m, cm" in mistake("two.csv", "a.csv", "--units", "px")
    assert "left-handed; change a sign" in mistake("two.csv", "a.csv", "--axes", "x,z,y")
    Path("odd.csv").write_text("time_s,q_x,q_y,q_z\n0,1,2,3\n1,1,2,3\n")
    assert "no joint matches" in mistake("odd.csv", "a.bvh")


def test_units_of_what_states_its_own_are_refused(cli, mistake):
    assert cli("two.csv", "two.mcap")[0] == 0
    assert "--units: has no effect on two.mcap" in mistake("two.mcap", "a.csv", "--units", "mm")


@pytest.mark.parametrize("ending", OF_ANY_JOINTS)
def test_a_converted_recording_is_a_source_of_the_node(cli, ending):
    assert cli("two.csv", f"a{ending}")[0] == 0
    settings = RecordingSettings(kind="recording", path=f"a{ending}", start_s=0.1)
    source = RecordingSource(settings, Path())
    source.open(1_000_000_000)
    scene = source.poll(1_000_000_000)
    assert scene is not None
    assert scene.sees_room
    joints, seen = source.joint_map.map(scene.people[0].positions, scene.people[0].observed)
    assert [JOINTS[k] for k in np.flatnonzero(seen)] == ["waist", "l_wrist"]
    np.testing.assert_allclose(joints[0], [0.05, 2, 1], atol=1e-6)


def test_the_joints_that_were_written_are_counted(cli):
    assert json.loads(cli("two.csv", "two.trc", "--json")[1])["joints"] == 2
    odd = [*JOINTS, "tool"]  # a BVH holds bodies, a TRC any marker
    head = ",".join(f"{joint}_{axis}" for joint in odd for axis in "xyz")
    places = ",".join(f"{k / 100},0,{0.5 + k / 100}" for k in range(len(odd)))
    rows = "".join(f"{k / 50},1,{places}\n" for k in range(5))
    Path("odd.csv").write_text(f"time_s,person,{head}\n{rows}")
    for output, joints in (("odd.bvh", len(JOINTS)), ("odd.trc", len(odd))):
        status, out, _ = cli("odd.csv", output)
        assert status == 0
        assert out.endswith(f", {joints} joints\n"), output


def test_the_guide_has_a_row_for_each_format():
    table = GUIDE.read_text(encoding="utf-8").partition("| format |")[2].partition("\n\n")[0]
    rows = [row.partition("|")[0] for row in table.split("\n| ")]
    assert [ending for ending in WRITTEN if not any(f"`{ending}`" in row for row in rows)] == []


def test_a_moved_floor_is_told(cli):
    source = "a_1.npz"
    names = np.array(["l_shoulder", "r_shoulder", "l_hip", "r_hip", "l_knee", "r_knee"])
    np.savez(
        source,
        positions=np.ones((4, 6, 3)) + np.arange(6)[:, None] * 0.1,
        joint_names=names,
        parents=np.full(6, -1),
        fps=np.float32(50),
        floor_height=-0.0524,
    )
    status, _, err = cli(source, "a.csv")
    assert status == 0
    assert "note: heights are raised by 5.2 cm, so that the floor is at 0" in err
