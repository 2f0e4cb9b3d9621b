"""Every command of the pages runs, in an empty folder, with what the pages tell to put there.

The pages are those of ``tests.pages``: the README, ``docs/`` and ``drivers/``. A block's language
says how it is tested: ``console`` runs, ``yaml`` is a configuration or a part of one that is put
into the page's cell, ``python`` compiles (and runs below, where it is named), ``toml`` names entry
points that there are. ``sh`` needs hardware or a network and isn't run, but for that of fleet.md.
"""

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hri_drivers.sources.scene_stream.codec import SEES_ROOM, open_datagram
from hri_predict.cli.check.check import examine
from hri_predict.library.conformance.checks import run_checks
from hri_predict.library.conformance.predictors import CHECKS, PredictorPart
from hri_predict.robots.file import read_robot_file
from hri_predict.run.config import load, shipped
from tests import pages
from tests.commands import children, root
from tests.pages import PAGES, ROOT, WIRE_A_CELL, Block
from tests.waiting import free_port

pytestmark = pytest.mark.usefixtures("built_once")
SHARED = ROOT.parent / "shared" / "data"
README = ROOT / "README.md"
COMMANDS = pages.commands()
LANGUAGES = {"console", "yaml", "python", "toml", "sh", "json", "json5", "hex", "c", "text"}
LANGUAGES |= {"iecst", "ini"}  # structured text, which its own tests run; a unit of systemd
SENDER = ROOT / "drivers" / "python" / "hri_sender.py"
RUN_BY_CI = {"make demo", "make test"}  # .ci/run runs both, from a clean clone
DAILY = {"check", "predictors", "convert"}
"""Commands of which the first is run daily: they start soon, and need neither network nor time."""
RECORDINGS = {
    "walking_1.npz": SHARED / "cmu_mocap" / "test" / "walking_1.npz",
    "walking_2.npz": SHARED / "cmu_mocap" / "train" / "walking_2.npz",
}
MINE = ("walking_2", "walking_3", "soccer_1", "basketball_1")
"""Of the data pack's training recordings, what stands for the user's own folder."""
OTHERS = ("walking_1", "walking_extra_7")
"""Of its test recordings, what stands for those that were not used."""
WEIGHTS = ROOT / "hri_predict" / "predictors" / "weights" / "trajectorycnn.safetensors"
"""What stands for the weights that a user trained."""
LISTEN = {"live_udp.yaml", "plant_modbus.yaml", "plant_opcua.yaml"}
"""Cells of the pages that listen at a port."""
CALIBRATION = ROOT / "hri_predict" / "predictors" / "weights" / "constant_velocity.calibration.json"
"""What stands for the calibration that a user made."""
ARM_URDF = """<robot name="arm">
  <link name="base_link"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="turn" type="revolute">
    <parent link="base_link"/><child link="tool0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/>
  </joint>
  <link name="tool0"><collision><geometry><box size="0.1 0.1 1"/></geometry></collision></link>
</robot>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What the pages tell to have, but for the cell."""
    for name, path in RECORDINGS.items():
        if path.exists():
            (tmp_path / name).symlink_to(path)
    for own, split, names in (
        ("recordings", "train", MINE),
        ("other_recordings", "test", OTHERS),
    ):
        (tmp_path / own).mkdir()
        for name in names:
            (tmp_path / own / f"{name}.npz").symlink_to(
                SHARED / "cmu_mocap" / split / f"{name}.npz"
            )
    (tmp_path / "arm.urdf").write_text(ARM_URDF, encoding="utf-8")
    return tmp_path


@pytest.fixture(scope="module")
def demo_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `hri-predict demo --speed max --record demo.mcap` records."""
    folder = tmp_path_factory.mktemp("demo")
    hri_predict("demo", "--speed", "max", "--record", "demo.mcap", cwd=folder)
    return folder / "demo.mcap"


@pytest.fixture
def serial_port() -> Iterator[str]:
    """A device that this machine has, in the place of ``/dev/ttyUSB0``."""
    master, slave = os.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def put_cell(folder: Path, page: Path, port: str) -> None:
    """Save the page's ``cell.yaml``, with devices that this machine has."""
    text = pages.cell(page).replace("/dev/ttyUSB0", port)
    text = text.replace("interface: socketcan", "interface: virtual")
    (folder / "cell.yaml").write_text(text, encoding="utf-8")


def wait_for(endpoint: str) -> None:
    """Wait until somebody listens at ``tcp/HOST:PORT``."""
    host, port = endpoint.removeprefix("tcp/").split(":")
    deadline = time.monotonic() + 60
    while True:
        try:
            return socket.create_connection((host, int(port)), 1.0).close()
        except OSError:
            assert time.monotonic() < deadline, f"nobody listens at {endpoint}"
            time.sleep(0.1)


def with_free_ports(command: str) -> str:
    """The same command at ports that are free, for other tests run beside this one."""
    for port in sorted(set(re.findall(r"tcp/127\.0\.0\.1:(\d+)", command))):
        command = command.replace(f":{port}", f":{free_port()}")
    return re.sub(r"--operator \d+", "--operator 0", command)


def at_free_port(name: str, folder: Path) -> str:
    """Put a shipped cell that listens into the folder, at a port that is free; return the port."""
    text, port = shipped(name).read_text(encoding="utf-8"), str(free_port())
    text, changed = re.subn(r"(?m)^( *port:) \d+", rf"\1 {port}", text)
    assert changed == 1, name
    (folder / name).write_text(text, encoding="utf-8")
    return port


def hri_predict(*words: str, cwd: Path) -> None:
    subprocess.run([sys.executable, "-m", "hri_predict", *words], cwd=cwd, check=True)


def missing(words: list[str]) -> str | None:
    """The first word of a command line that hri-predict does not know: a command or an option."""
    command, ahead = root(), iter(words)
    for word in ahead:
        if word in (below := children(command)):
            command = below[word]
        elif below and not word.startswith("-"):
            return word
        elif word.startswith("--"):
            option, _, value = word.partition("=")
            known = {o: p for p in command.params for o in (*p.opts, *p.secondary_opts)}
            if option not in known:
                return None if option == "--help" else option
            if not (value or getattr(known[option], "is_flag", False)):
                next(ahead, None)  # its value
    return None


def test_the_readme_is_short_and_has_the_two_commands_first():
    assert len(pages.text(README).splitlines()) <= 200
    assert [command for page, command in COMMANDS if page == README][:2] == [
        "make demo",
        "make test",
    ]


def test_ci_runs_the_two_commands_and_the_long_tests():
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert {*RUN_BY_CI, "make test-long"} <= set(ci.splitlines())


def marked() -> Iterator[Any]:
    """Commands as parameters; `long` are all but the first of each of the names above.

    A demo is recorded once, whatever the file's name.
    """
    before = set()
    for page, command in COMMANDS:
        demo = command.startswith("hri-predict demo --speed max --record ")
        if command not in RUN_BY_CI and not (demo and "demo" in before):
            word = command.split()[1]
            marks = [pytest.mark.long] * (word not in DAILY or word in before)
            if word == "bench":  # it measures time, also against an earlier bench
                marks.append(pytest.mark.realtime)
            before.add(word)
            yield pytest.param(page, command, id=f"{pages.name(page)}: {command}", marks=marks)


@pytest.mark.timeout(600)  # a machine that is busy with other tests
@pytest.mark.parametrize(("page", "command"), [*marked()])
def test_command(
    page: Path, command: str, folder: Path, serial_port: str, request: pytest.FixtureRequest
):
    put_cell(folder, page, serial_port)
    command = with_free_ports(command.replace("can:socketcan:can0", "can:virtual:readme"))
    words = shlex.split(command)
    assert words[0] == "hri-predict"
    if words[1] == "urdf":
        pytest.importorskip("pinocchio", reason="needs pin, as the page says")
    for name, path in RECORDINGS.items():
        if name in command and not path.exists():
            pytest.skip(f"needs ../shared/data for {name}")
    if re.search(r"--data (other_)?recordings", command) and not SHARED.exists():
        pytest.skip("needs ../shared/data for recordings")
    if words[1] == "train":  # an hour's work, done for a moment
        words += ["--set", "train.epochs=1", "--set", "train.windows_per_epoch=64"]
    if words[:2] == ["hri-predict", "bench"] and (len(words) == 2 or words[2].startswith("--")):
        if "--baseline" in words:  # which an earlier command makes
            own = words[words.index("--only") + 1] if "--only" in words else "parts"
            hri_predict("bench", "--quick", "--only", own, "--save", "before.json", cwd=folder)
        words += [] if "--quick" in words else ["--quick"]
        words += [] if "--only" in words else ["--only", "parts"]
        words += ["--worse-than", "100"] if "--baseline" in words else []  # nothing is timed
    for option in {"--duration", "--seconds"} & set(words):
        words += [option, "5"]  # the last one counts, and a moment is enough
    words += ["--seconds", "1"] * (words[1] in ("listen", "fleet"))
    if words[:3] == ["hri-predict", "replay", "monday.mcap"]:  # which an earlier command records
        record = ["run", "cell.yaml", "--shadow", "--record", "monday.mcap", "--duration", "3"]
        hri_predict(*record, cwd=folder)
    if "first.yaml" in words and words[1] != "init":  # which an earlier command writes
        hri_predict("init", "first.yaml", "--simulated", "--yes", cwd=folder)
    for name in {"demo.mcap", "walk.mcap"} & set(words):  # which an earlier command records
        if words[1] != "demo":
            (folder / name).symlink_to(request.getfixturevalue("demo_recording"))
    if words[1] == "convert" and "walk.mcap" in words:
        (folder / words[3]).unlink(missing_ok=True)
    if words[1] == "evidence":  # which an earlier run keeps
        with (folder / "cell.yaml").open("a", encoding="utf-8") as cell:
            cell.write("\nevidence: evidence\n")
        hri_predict("run", "cell.yaml", "--shadow", "--duration", "3", cwd=folder)
    if "--calibration" in words:  # which an earlier command makes
        shutil.copy(CALIBRATION, folder / "mine.calibration.json")
    daemon = words[1] == "run" and "--duration" not in words
    beside = None
    ports = [at_free_port(name, folder) for name in LISTEN & set(words) if words[1] == "run"]
    if "live_udp.yaml" in words and words[1] == "run":
        sender = [sys.executable, str(SENDER), "--port", *ports, "--seconds", "120"]
        beside = subprocess.Popen(sender, cwd=folder)
    if "--connect" in words:  # to what is there already
        router = ["fleet", "--listen", words[words.index("--connect") + 1], "--seconds", "120"]
        beside = subprocess.Popen(
            [sys.executable, "-m", "hri_predict", *router], cwd=folder, stdout=subprocess.DEVNULL
        )
        wait_for(words[words.index("--connect") + 1])
    process = subprocess.Popen(
        [sys.executable, "-m", "hri_predict", *words[1:]],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    if daemon:  # it is up when it has alerted somebody
        end = time.monotonic() + 120
        while not (folder / "alerts.jsonl").exists() and process.poll() is None:
            assert time.monotonic() < end, "no alert"
            time.sleep(0.1)
        time.sleep(1.0)
        process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=500)
    if beside is not None:
        beside.kill()
        beside.wait()
    if "live_udp.yaml" in words and words[1] == "run":
        assert int(re.findall(r"scenes *│ *(\d+)", out)[0]) > 10
    assert process.returncode == 0, f"{out}\n{err}"
    assert "Traceback" not in err
    assert "the calibration was made from" not in err
    if daemon:
        assert "Summary" in out
    if words[1] == "urdf":
        assert read_robot_file(words[words.index("--out") + 1], folder).joints
    if "--record" in words:
        assert (folder / words[words.index("--record") + 1]).stat().st_size > 1000


@pytest.mark.parametrize("page", PAGES, ids=pages.name)
def test_every_command_in_the_words_of_a_page_is_one(page: Path):
    """What stands between backticks isn't run; its words are those of the command line."""
    for command in re.findall(r"`(?:python -m )?hri-predict ([^`]+)`", pages.prose(page)):
        words = command.replace("…", "").split()
        assert missing(words) is None, f"hri-predict {command}"


@pytest.mark.parametrize("page", PAGES, ids=pages.name)
def test_every_block_says_what_it_is(page: Path):
    """So none is passed over by the tests here; and what is to be run is fenced."""
    for block in pages.BLOCKS:
        if block.page == page:
            assert block.language in LANGUAGES, block.text
    assert not re.findall(r"^(?: {4}|\t)(?:\$ |hri-predict |python )", pages.prose(page), re.M)


OF_ROS = {"kind: ros2": "rclpy", "message: ros4hri": "hri_msgs", "message: zed\n": "zed_msgs"}
"""Packages that building a configuration of these words needs."""


def yaml_id(block: Block) -> str:
    return f"{pages.name(block.page)}: {block.text.split(chr(10))[0]}"


@pytest.mark.parametrize("block", pages.blocks("yaml"), ids=yaml_id)
def test_a_configuration_is_valid_in_the_cell(block: Block, folder: Path, serial_port: str):
    for words, package in OF_ROS.items():
        if words in block.text:
            pytest.importorskip(package, reason=f"needs {package}, of a ROS 2 installation")
    if block.text.startswith("network:"):
        return  # describes a network: tests/hri_drivers/camera/network/test_described.py
    put_cell(folder, block.page, serial_port)
    (folder / "mine").mkdir()
    (folder / "mine" / "trajectorycnn.safetensors").symlink_to(WEIGHTS)
    (folder / "cell.key").write_text("0123456789abcdef" * 2, encoding="utf-8")
    (folder / "cell.key").chmod(0o600)
    for secret in re.findall(r"(?:token|sign_key|password)_file: ([\w.]+)", block.text):
        (folder / secret).write_text("secret", encoding="utf-8")
        (folder / secret).chmod(0o600)
    whole = yaml.safe_load((folder / "cell.yaml").read_text(encoding="utf-8"))
    whole |= yaml.safe_load(block.text)
    (folder / "cell.yaml").write_text(yaml.safe_dump(whole), encoding="utf-8")
    found = examine(load(folder / "cell.yaml"))
    assert [link["name"] for link in found["links"]] == [link["name"] for link in whole["links"]]


def test_an_unknown_fault_lists_those_there_are(folder: Path):
    assert "`hri-predict demo --fault nothing`" in pages.text(ROOT / "docs/guides/faults.md")
    command = [sys.executable, "-m", "hri_predict", "demo", "--fault", "nothing"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "vanish" in done.stderr
    assert "bit_errors" in done.stderr


def test_the_controllers_that_stand_in_for_hardware_are_valid(folder: Path, serial_port: str):
    (block,) = (b.text for b in pages.blocks("yaml", WIRE_A_CELL) if "simulate:" in b.text)
    put_cell(folder, WIRE_A_CELL, serial_port)
    cell = (folder / "cell.yaml").read_text(encoding="utf-8")
    before, _, after = re.split(r"(links:\n(?:  .*\n)+)", cell)
    assert "socketcan" not in before + after
    (folder / "cell.yaml").write_text(before + block + after, encoding="utf-8")
    found = examine(load(folder / "cell.yaml"))
    assert [link["name"] for link in found["links"]] == ["plc", "drive"]
    assert "simulated links: mock controllers, no hardware" in found["notes"]


@pytest.mark.parametrize("block", pages.blocks("python"), ids=lambda b: pages.name(b.page))
def test_a_program_compiles(block: Block):
    compile(block.text, block.file or pages.name(block.page), "exec")


@pytest.mark.parametrize("block", pages.blocks("toml"), ids=lambda b: pages.name(b.page))
def test_the_entry_points_that_a_page_shows_are_there(block: Block):
    ours = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = tomllib.loads(block.text)["project"]["entry-points"]
    assert groups
    assert set(groups) <= set(ours["project"]["entry-points"])


def test_the_predictor_that_the_page_shows_keeps_the_contract():
    page = ROOT / "docs" / "guides" / "add-a-predictor.md"
    names: dict[str, Any] = {}
    exec(pages.named("my_package.py", page).text, names)
    settings = names["Mine"].settings_model(name="mine", horizon_s=0.5)
    mine = names["Mine"](settings)
    assert mine.horizon_steps / mine.rate_hz >= 0.5
    judged = run_checks(CHECKS, PredictorPart(names["Mine"], settings, mine))
    assert len(judged) > 8
    assert [str(finding) for finding in judged if finding.verdict != "pass"] == []
    history = np.random.default_rng(0).normal(size=(2, mine.history_steps, 21, 3))
    forecast = mine.predict(history, np.ones(history.shape[:3], bool))
    np.testing.assert_array_equal(forecast.positions[:, -1], history[:, -1])


def test_the_tracker_that_the_page_shows_is_heard(monkeypatch):
    code = pages.named("tracker.py", ROOT / "docs" / "guides" / "live-sources.md").text
    monkeypatch.syspath_prepend(SENDER.parent)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        node.bind(("127.0.0.1", 0))
        node.settimeout(20)
        names: dict[str, Any] = {}
        exec(code.replace("47800", str(node.getsockname()[1])), names)
        headers = [open_datagram(node.recv(2000))[0] for _ in range(3)]
        names["sender"].close()
    assert [(h.sequence, h.people, h.flags & SEES_ROOM) for h in headers] == [
        (0, 1, 1), (1, 0, 1), (2, 0, 0),
    ]  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=pages.name)
def test_a_page_names_only_files_that_are_there(page: Path):
    links = re.findall(r"\]\((?!\w+:)([^)#]+)(?:#[^)]*)?\)", pages.prose(page))
    if page == README:
        assert len(links) > 10
    for link in links:
        assert (page.parent / link).exists(), link
