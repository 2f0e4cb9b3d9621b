"""The unit that is shipped, and the command that prints it."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hri_predict.base.files import data_path
from hri_predict.cli.service import (
    UNIT,
    hidden,
    instance,
    own_files,
    service,
    unit_text,
    unwritable,
)
from hri_predict.run import config as configuration
from tests.hri_predict.operation.service.cells import cell, written


def test_the_unit_says_what_the_node_does(tmp_path):
    text = data_path("service", UNIT).read_text(encoding="utf-8")
    for line in ("Type=notify", "Restart=on-failure", "KillMode=mixed", "CapabilityBoundingSet="):
        assert line in text.splitlines()
    watchdog = re.search(r"^WatchdogSec=(\d+)$", text, re.MULTILINE)
    assert watchdog is not None
    assert float(watchdog[1]) >= 2
    assert "MemoryDenyWriteExecute=" not in text  # compiled loops are written and run


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_finds_nothing_wrong_with_the_unit(tmp_path):
    config = configuration.load(written(tmp_path, cell()))
    program = tmp_path / "hri-predict"
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    program.chmod(0o755)
    unit = tmp_path / "hri-predict@cell.service"
    unit.write_text(unit_text(program, config), encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
    broken = tmp_path / "broken@cell.service"  # the check itself must be able to fail
    broken.write_text(unit.read_text().replace("Type=notify", "Type=notified"), encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", str(broken)], capture_output=True, text=True, timeout=60
    )
    assert "notified" in done.stderr


def test_the_command_puts_in_its_own_program_and_the_priority(tmp_path):
    config = configuration.load(written(tmp_path, cell(realtime={"priority": 42})))
    text = unit_text(Path(sys.executable), config)
    assert f"ExecStart={sys.executable} -m hri_predict run /etc/hri-predict/%i.yaml" in text
    assert "LimitRTPRIO=42" in text.splitlines()


ODD = [
    "with space",
    "100%",
    "100%i",
    "a$HOME",
    'quo"te',
    "back\\slash",
    "ümlaut",
    "it's",
    "tab\there",
    "a;b",
]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.parametrize("name", ODD)
def test_systemd_finds_the_program_in_any_folder(tmp_path, name):
    config = configuration.load(written(tmp_path, cell()))
    program = tmp_path / name / "hri-predict"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    program.chmod(0o755)
    unit = tmp_path / "hri-predict@cell.service"
    text = unit_text(program, config)
    unit.write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, ""), text  # it looks for the program itself
    words = command_of(text)
    assert str(program) in words[:2]


def command_of(text):
    """``ExecStart`` as systemd reads it: quotes and escapes, then ``%%`` and ``$$``."""
    (line,) = re.findall(r"^ExecStart=(.*)$", text, re.MULTILINE)
    words = [match[1] or match[2] for match in re.finditer(r'"((?:[^"\\]|\\.)*)"|(\S+)', line)]
    plain = [os.fsencode(word).decode("unicode_escape").encode("latin-1") for word in words]
    first, *rest = [os.fsdecode(word).replace("%%", "%") for word in plain]
    return [first, *(word.replace("$$", "$") for word in rest)]


@pytest.mark.skipif(shutil.which("systemd-escape") is None, reason="needs systemd-escape")
@pytest.mark.parametrize("name", [*ODD, "cell7", "cell_7.b"])
def test_a_cells_name_is_escaped_as_systemd_does_it(name):
    done = subprocess.run(
        ["systemd-escape", "--", name], capture_output=True, text=True, check=True
    )
    assert instance(name) == done.stdout.strip()


@pytest.mark.parametrize("folder", ODD)
@pytest.mark.parametrize("name", ["with space", "cell (7)", "cell-7"])
def test_the_commands_that_are_printed_are_words_of_a_shell(tmp_path, capsys, folder, name):
    config = tmp_path / folder
    config.mkdir()
    path = written(config, cell()).rename(config / f"{name}.yaml")
    (tmp_path / "units").mkdir()
    service(path, tmp_path / "units")
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    commands = [shlex.split(line) for line in said]
    assert commands[1] == [
        "install", "-D", "-m", "0640", "-g", "hri-predict", str(path),
        f"/etc/hri-predict/{instance(name)}.yaml",
    ]  # fmt: skip
    assert commands[-1][-1] == f"hri-predict@{instance(name)}"


def test_files_that_the_service_may_not_write_are_named_with_the_remedy(tmp_path):
    good = {
        "state": "/var/lib/hri-predict/cell/state.json",
        "alerts": {"file": "/var/log/hri-predict/cell/alerts.jsonl"},
    }
    assert unwritable(configuration.load(written(tmp_path, cell(**good))), "cell") == []
    bad = {"state": "state.json", "alerts": {"file": "/var/log/hri-predict/other/alerts.jsonl"}}
    lines = unwritable(configuration.load(written(tmp_path, cell(**bad))), "cell")
    assert [line.split(":")[0] for line in lines] == ["alerts.file", "state"]
    assert all("/hri-predict/cell" in line for line in lines)


def test_the_unit_is_written_where_it_is_asked_for(tmp_path, capsys):
    config = written(tmp_path, cell())
    service(config, tmp_path)
    assert "[Service]" in (tmp_path / UNIT).read_text(encoding="utf-8")
    assert f"{tmp_path / UNIT}: written" in capsys.readouterr().out


@pytest.fixture
def with_files(tmp_path):
    """A cell whose robot, joint map and keys are files beside it."""
    (tmp_path / "robots").mkdir()
    shutil.copy(data_path("robots", "ur5e.yaml"), tmp_path / "robots" / "my arm.yaml")
    shutil.copy(data_path("skeletons", "coco17.yaml"), tmp_path / "mine.yaml")
    for name in ("scene.key", "hook.token"):
        (tmp_path / name).write_text("secret")
    hook = {"kind": "webhook", "url": "https://localhost/", "token_file": "hook.token"}
    alerts = {"terminal": False, "file": "/var/log/hri-predict/cell/alerts.jsonl", "to": [hook]}
    data = cell(alerts=alerts)
    data["robots"][0]["model"] = "robots/my arm.yaml"
    sensor = {"kind": "udp", "room_from_source": {"xyz": [0, 0, 0]}, "rate_hz": 30}
    sensor |= {"joint_map": "mine.yaml", "key_file": "scene.key"}
    other = sensor | {"joint_map": "coco17", "port": 9872}
    data["source"] = {"kind": "merged", "sensors": {"left": sensor, "right": other}}
    return tmp_path, data


def test_each_file_beside_the_configuration_is_installed_beside_it(with_files, capsys):
    folder, data = with_files
    path = written(folder, data)
    service(path, folder)
    said = capsys.readouterr()
    commands = [shlex.split(line) for line in said.out.splitlines() if line.startswith("  ")]
    installed = {each[-2]: (each[3], each[-1]) for each in commands if each[0] == "install"}
    assert installed == {
        str(path): ("0640", f"/etc/hri-predict/{path.stem}.yaml"),
        str(folder / "robots" / "my arm.yaml"): ("0640", "/etc/hri-predict/robots/my arm.yaml"),
        str(folder / "mine.yaml"): ("0640", "/etc/hri-predict/mine.yaml"),
        str(folder / "scene.key"): ("0400", "/etc/hri-predict/scene.key"),
        str(folder / "hook.token"): ("0400", "/etc/hri-predict/hook.token"),
    }
    assert "warning" not in said.err


def test_a_file_that_the_service_would_not_find_is_named(with_files):
    folder, data = with_files
    (folder / "scene.key").unlink()
    (folder / "cell").mkdir()
    data["robots"][0]["model"] = "../robots/my arm.yaml"
    for sensor in data["source"]["sensors"].values():
        sensor["key_file"] = "scene.key"
    data["alerts"]["to"][0]["token_file"] = "/home/robot/hook.token"
    data["source"]["sensors"]["left"]["joint_map"] = "coco17"
    data["commissioning"] = "reports/report.json"
    to_copy, lines = own_files(configuration.load(written(folder / "cell", data)))
    assert to_copy == []
    assert [line.split(":")[0] for line in lines] == [
        "robots.arm.model",
        "source.sensors.left.key_file",
        "source.sensors.right.key_file",
        "alerts.to.0.token_file",
        "commissioning.report",
    ]


def test_a_cell_of_shipped_parts_needs_no_other_file():
    assert own_files(configuration.load(data_path("demo.yaml"))) == ([], [])


def test_a_program_that_the_unit_hides_is_told():
    (line,) = hidden(Path("/home/robot/hri-predict/.venv/bin/hri-predict"))
    assert "/opt/hri-predict" in line
    assert not hidden(Path("/opt/hri-predict/bin/hri-predict"))
