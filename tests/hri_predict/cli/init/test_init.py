"""``init`` writes a commented configuration that passes ``check``, and spoils no file."""

import io
import json
import os
import pty
import re
import select
import subprocess
import sys
import time

import jsonschema
import pytest
import yaml

from hri_predict.base.files import data_path
from hri_predict.cli.check.check import examine
from hri_predict.cli.init.init import SCHEMA_FILE, WIDTH
from hri_predict.contracts import registry
from hri_predict.protocol.messages import RobotState
from hri_predict.recording.mcap.reader import read_mcap
from hri_predict.risk.settings import RISK_MODES
from hri_predict.run import config as configuration

pytestmark = pytest.mark.usefixtures("built_once")
ROBOTS = sorted(path.stem for path in data_path("robots").glob("*.yaml"))


@pytest.fixture
def call(tmp_path, monkeypatch, cli):
    """Runs the command in an empty folder without a terminal; status, standard error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())

    return lambda *arguments: cli("init", *arguments)[::2]


def read(folder, name="cell.yaml"):
    """The file, which must pass check and the schema beside it."""
    config = configuration.load(folder / name)
    examine(config)
    data = yaml.safe_load(config.text)
    if (folder / SCHEMA_FILE).exists():
        jsonschema.Draft7Validator(json.loads((folder / SCHEMA_FILE).read_text())).validate(data)
    return config.text, data


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robot_can_be_simulated_and_passes_check(call, tmp_path, robot):
    assert call("--simulated", "--yes", "--robot", robot, "--no-schema")[0] == 0
    _, data = read(tmp_path)
    assert data["robots"][0]["model"] == robot
    assert [link["simulate"]["role"] for link in data["links"]] == ["drive", "monitor"]


@pytest.mark.parametrize("mode", [mode for mode in RISK_MODES if mode != "hybrid"])
def test_every_mode_passes_check(call, tmp_path, mode):
    assert call("--yes", "--mode", mode, "--no-schema")[0] == 0
    assert read(tmp_path)[1]["risk"]["mode"] == mode


MOCAP = ("vmc", "rokoko", "zed_livelink", "natnet", "qualisys")
NEEDED = {
    "merged": ["source.sensors={one: {kind: procedural}, two: {kind: procedural}}"],
    **{kind: ["source.sees_room=true"] for kind in ("mvn", *MOCAP)},
    "ros2": ["source.topics=[/people]", "source.frame=map", "source.sees_room=true"],
    "serial_skeleton": ["source.port=/dev/ttyUSB9"],
    "zenoh": ["source.cell=hall"],
}


@pytest.mark.parametrize("kind", sorted(set(registry.names("sources")) - {"approach", "recording"}))
def test_every_live_source_passes_check_with_what_it_needs(call, tmp_path, kind):
    if kind == "ros2":
        pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
    changes = [part for change in NEEDED.get(kind, []) for part in ("--set", change)]
    assert call("--yes", "--source", kind, "--no-schema", *changes) == (0, "written: cell.yaml\n")
    assert read(tmp_path)[1]["source"]["kind"] == kind


def test_a_key_that_a_source_needs_is_named_with_the_flag(call, tmp_path):
    status, err = call("--yes", "--source", "mvn")
    assert status == 2
    assert err.startswith("error: source.sees_room: required key is missing; add it (true only if")
    assert err.endswith("give --set source.sees_room=VALUE\n")
    assert list(tmp_path.iterdir()) == []


def test_all_answers_by_flags_need_no_terminal(call, tmp_path):
    flags = ["--robot", "panda", "--source", "udp", "--mode", "iso", "--max-speed", "0.8"]
    links = ["--link", "can:socketcan:can0", "--link", "serial:/dev/ttyUSB0"]
    changes = ["--set", "links.0.fd=true", "--set", "risk.latch=[start]", "--set", "rate_hz=20"]
    assert call("own.yaml", *flags, *links, *changes) == (
        0,
        f"written: own.yaml, {SCHEMA_FILE}\n",
    )
    text, data = read(tmp_path, "own.yaml")
    assert text.startswith(f"# yaml-language-server: $schema={SCHEMA_FILE}\n")
    assert data["rate_hz"] == 20
    assert data["risk"] | {"mode": "iso", "latch": ["start"]} == data["risk"]
    assert [(link["name"], link["kind"]) for link in data["links"]] == [
        ("can", "can"),
        ("serial", "serial"),
    ]
    assert (
        data["links"][0] | {"interface": "socketcan", "channel": "can0", "fd": True}
        == (data["links"][0])
    )
    assert data["links"][1]["port"] == "/dev/ttyUSB0"
    readme = (data_path().parent / "README.md").read_text(encoding="utf-8")
    assert f"baudrate: {data['links'][1]['baudrate']}" in readme  # has room for zones and poses


def test_the_senders_joints_and_the_predictor_are_taken_from_flags(call, tmp_path):
    assert call("--yes", "--joint-map", "coco17", "--predictor", "stb", "--no-schema")[0] == 0
    _, data = read(tmp_path)
    assert (data["source"]["joint_map"], data["predictor"]["name"]) == ("coco17", "stb")


def test_the_predictor_is_by_default_that_of_the_rule(call, tmp_path):
    assert call("--yes", "--no-schema")[0] == 0
    assert read(tmp_path)[1]["predictor"] == {"name": "average", "horizon_s": 1.2}


def test_a_stop_later_than_the_calibrated_horizon_is_refused_with_a_remedy_that_works(
    call, tmp_path
):
    late = ["--yes", "--no-schema", "--link", "can:socketcan:can0"]
    late += ["--set", "links.0.reaction_s=1.0"]
    status, err = call(*late)
    assert status != 0
    assert "exceeds the last horizon, 1.200 s" in err
    assert "or set risk.limits.extend_beyond_horizon: true" in err
    assert not (tmp_path / "cell.yaml").exists()
    assert call(*late, "--set", "risk.limits.extend_beyond_horizon=true")[0] == 0


def test_numbers_of_lists_are_set_one_by_one(call, tmp_path):
    changes = ["source.room_from_source.xyz.2=1.9", "links.0.silence_timeout_s=0.08"]
    flags = [part for change in changes for part in ("--set", change)]
    assert call("--yes", "--link", "serial:/dev/ttyUSB0", "--no-schema", *flags)[0] == 0
    _, data = read(tmp_path)
    assert data["source"]["room_from_source"]["xyz"] == [0, 0, 1.9]
    assert data["robots"][0]["room_from_robot"]["xyz"] == [0, 0, 0]
    assert data["links"][0]["silence_timeout_s"] == 0.08


def test_every_key_has_a_comment_and_lines_fit_80_columns(call, tmp_path):
    call("--simulated", "--yes")
    lines = (tmp_path / "cell.yaml").read_text().splitlines()
    body = lines[
        4 : lines.index("# Uncomment the keys that this cell needs, and enter its values:")
    ]
    for above, line in zip(["", *body], body, strict=False):
        if re.match(r" *(- )?[a-z_]+:", line):
            assert "  # " in line or above.strip().startswith("#"), line
        if "{" not in line:
            assert len(line) <= WIDTH, line


def test_what_is_written_as_comments_is_right_when_it_is_taken_in(call, tmp_path):
    call("--yes", "--no-schema")
    path = tmp_path / "cell.yaml"
    before, _, after = path.read_text().partition("# Uncomment the keys")
    hints = [re.sub("^# ?", "", line) for line in after.splitlines()[1:]]
    path.write_text(before + "\n".join(hints) + "\n")
    _, data = read(tmp_path)
    assert {"zones", "people", "state"} <= set(data)


def test_an_existing_file_is_never_replaced_without_force(call, tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text("mine")
    status, err = call("--yes")
    assert (status, path.read_text()) == (2, "mine")
    assert "exists" in err
    assert "--force" in err
    assert call("--yes", "--force")[0] == 0
    read(tmp_path)


def test_a_link_to_nowhere_is_not_followed(call, tmp_path):
    (tmp_path / "cell.yaml").symlink_to(tmp_path / "elsewhere.yaml")
    assert call("--yes")[0] == 2
    assert not (tmp_path / "elsewhere.yaml").exists()


def test_somebody_elses_schema_is_never_replaced_without_force(call, tmp_path):
    schema = tmp_path / SCHEMA_FILE
    schema.write_text("[1]")
    assert call("--yes")[0] == 2
    assert schema.read_text() == "[1]"
    assert list(tmp_path.iterdir()) == [schema]
    schema.write_text(json.dumps({"title": "Configuration of hri-predict"}))  # an older one
    assert call("--yes")[0] == 0
    read(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            [],
            "no terminal for prompts, and not given: --robot, --max-speed, --mode, --source, "
            "--link",
        ),
        (["--yes", "--robot", "ur5x"], "--robot ur5x: model: unknown robot model 'ur5x'; did you"),
        (["--yes", "--max-speed", "300"], "--max-speed 300.0: robot: max_speed_m_s: "),
        (
            ["--yes", "--source", "udpp"],
            "--source udpp: unknown source 'udpp'; did you mean 'udp'?",
        ),
        (["--yes", "--link", "can:can0"], "--link can:can0: write can:INTERFACE:CHANNEL"),
        (
            ["--yes", "--link", "cann"],
            "--link cann: unknown link 'cann'; write can:INTERFACE:CHANN",
        ),
        (
            ["--yes", "--link", "can0"],
            "--link can0: unknown link 'can0'; write can:INTERFACE:CHANN",
        ),
        (
            ["--yes", "--link", "/dev/ttyS0"],
            "--link /dev/ttyS0: unknown link '/dev/ttyS0'; write s",
        ),
        (
            ["--yes", "--link", "can:socketcan:can0", "--link", "serial:COM3:460800"],
            "--link serial:COM3:460800: write serial:COM3, and for its baud rate --set "
            "links.1.baudrate=460800",
        ),
        *(
            (
                ["--yes", "--link", f"serial:COM3:{rate}"],
                f"--link serial:COM3:{rate}: write serial:COM3, and for its baud rate --set "
                "links.0.baudrate=RATE",
            )
            for rate in (
                "",
                "0",
                "-5",
                "1e5",
                "115200:8N1",
                "\u0661\u0661\u0665\u0662\u0660\u0660",
                "9" * 20,
            )
        ),
        (
            ["--yes", "--link", "serial::115200"],
            "--link serial::115200: write serial:PORT, and for its baud rate --set "
            "links.0.baudrate=115200",
        ),
        (
            ["--yes", "--link", "can:socketcan:can0:500000"],
            "--link can:socketcan:can0:500000: write can:socketcan:can0; `ip link` sets its bit",
        ),
        (
            ["--yes", "--link", "modbuss"],
            "--link modbuss: unknown link 'modbuss'; did you mean 'mo",
        ),
        (["--yes", "--mode", "bold"], "--mode bold: unknown (iso"),
        (["--yes", "--mode", "hybrid"], "--mode hybrid: hybrid lets the robot touch people"),
        (["--yes", "--set", "risk.mod=iso"], "cell.yaml:25: risk.mod: unknown key; did you mean"),
        (["--yes", "--set", "links.0.fd=true"], "--set links.0.fd=true: 'links' is a list and"),
        (["--yes", "--joint-map", "coco71"], "--joint-map coco71: no joint map 'coco71'; did you"),
        (["--yes", "--source", "approach"], "--source approach: unknown source 'approach'; avail"),
        (["--yes", "--predictor", "sin"], "--predictor sin: unknown predictor 'sin'; did you mean"),
        (
            ["--yes", "--source", "merged", "--joint-map", "coco17"],
            "--joint-map: has no effect with source merged",
        ),
        (["--yes", "--simulated", "--joint-map", "coco17"], "--joint-map: has no effect with"),
        (["--yes", "--set", "rate_hz"], "--set rate_hz: write it as key=value"),
        (["--yes", "--simulated", "--source", "udp"], "--source: has no effect with --simulated"),
        (["cell.txt", "--yes"], "cell.txt: name a file that ends in .yaml"),
        ([".", "--yes"], ".: name a file that ends in .yaml"),
        (["", "--yes"], ".: name a file that ends in .yaml"),
        ([300 * "c" + ".yaml", "--yes"], 300 * "c" + ".yaml: its name is too long"),
        (["none/cell.yaml", "--yes"], "none/cell.yaml: no folder none"),
    ],
)
def test_a_wrong_answer_is_one_line_and_nothing_is_written(call, tmp_path, arguments, said):
    status, err = call(*arguments)
    assert status == 2
    assert re.sub(r":\d+:", ":N:", err).startswith(re.sub(r":\d+:", ":N:", f"error: {said}"))
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_remedy_of_a_baud_rate_works(call, tmp_path):
    flags = ["--link", "serial:COM3", "--set", "links.0.baudrate=460800"]
    assert call("--yes", "--no-schema", *flags)[0] == 0
    assert read(tmp_path)[1]["links"][0]["baudrate"] == 460800


@pytest.mark.parametrize(
    "port",
    ["socket://127.0.0.1:4000", "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0"],
)
def test_other_colons_belong_to_the_port(call, tmp_path, port):
    assert call("--yes", "--no-schema", "--link", f"serial:{port}")[0] == 0
    assert read(tmp_path)[1]["links"][0]["port"] == port


def test_contact_is_allowed_only_by_name(call, tmp_path):
    flags = ["--yes", "--no-schema", "--mode", "hybrid", "--set", "robots.0.contact=allowed"]
    assert call(*flags)[0] == 0
    assert read(tmp_path)[1]["robots"][0]["contact"] == "allowed"


@pytest.mark.realtime
def test_in_a_terminal_it_asks_again_until_an_answer_is_right(tmp_path):
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "hri_predict", "init"]
    talk = [
        ("without hardware? [y/N]: ", ""),
        ("Robot [ur5e]: ", "ur5x"),
        ("did you mean 'ur5'?", None),
        ("Robot [ur5e]: ", "panda"),
        ("m/s [1.0]: ", "fast"),
        ("'fast' is not a number", None),
        ("m/s [1.0]: ", "0.8"),
        ("Source [udp]: ", "mvn"),
        ("Joint map [xsens23]: ", "xsens"),
        ("no joint map 'xsens'", None),
        ("Joint map [xsens23]: ", ""),
        ("source.sees_room: ", "perhaps"),
        ("got 'perhaps'", None),
        ("source.sees_room: ", "true"),
        ("or a kind:", None),  # the kinds follow, wrapped at the terminal's width
        ("modbus_client", None),
        ("Link 1 ('none' ends) [none]: ", "can:socketcan:can0"),
        ("by itself, s [0.06]: ", "0.001"),
        ("got 0.001", None),
        ("by itself, s [0.06]: ", "0.08"),
        ("starts to brake, s [0.02]: ", ""),
        ("Link 2 ('none' ends) [none]: ", ""),
        ("[predictive]: ", "reactive"),
        ("Predictors: ", None),
        ("Predictor [average]: ", "zero"),
        ("unknown predictor 'zero'", None),
        ("Predictor [average]: ", "zero_velocity"),
        ("hri-predict check cell.yaml", None),
    ]
    with subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=tmp_path, start_new_session=True
    ) as process:
        os.close(theirs)
        heard, deadline = "", time.monotonic() + 120
        for awaited, answer in talk:
            while awaited not in heard:
                assert time.monotonic() < deadline, heard
                if select.select([ours], [], [], 1.0)[0]:
                    heard += os.read(ours, 4096).decode()
            heard = heard.partition(awaited)[2]
            if answer is not None:
                os.write(ours, f"{answer}\n".encode())
        assert process.wait(60) == 0
    os.close(ours)
    _, data = read(tmp_path)
    assert data["robots"][0] | {"model": "panda", "max_speed_m_s": 0.8} == data["robots"][0]
    assert data["source"]["sees_room"] is True
    assert data["risk"]["mode"] == "reactive"
    assert len(data["links"]) == 1
    assert (data["links"][0]["silence_timeout_s"], data["links"][0]["reaction_s"]) == (0.08, 0.02)
    assert data["ticks"] == "capture"
    assert data["source"]["joint_map"] == "xsens23"
    assert data["predictor"]["name"] == "zero_velocity"


def test_times_of_a_controller_that_are_not_stated_stay_out_and_are_noted(call, tmp_path):
    assert call("--yes", "--link", "can:socketcan:can0", "--no-schema")[0] == 0
    config = configuration.load(tmp_path / "cell.yaml")
    assert {"silence_timeout_s", "reaction_s"}.isdisjoint(config.links[0].model_fields_set)
    assert any("silence_timeout_s 60 ms and reaction_s" in n for n in examine(config)["notes"])


@pytest.mark.realtime
def test_a_simulated_cell_moves_its_arm_at_once(call, tmp_path):
    call("--simulated", "--yes", "--no-schema")
    command = [sys.executable, "-m", "hri_predict", "run", "cell.yaml", "--duration", "4"]
    ended = subprocess.run(
        [*command, "--record", "run.mcap"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ended.returncode == 0, ended.stderr
    heard = [taken.message for _, taken in read_mcap(tmp_path / "run.mcap").received]
    states = [message for message in heard if isinstance(message, RobotState)]
    turned = [abs(a - b) for a, b in zip(states[0].positions, states[-1].positions, strict=True)]
    assert max(turned) > 0.1  # rad; it stands at the cycle's start, and swings by 1.4
