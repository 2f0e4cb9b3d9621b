"""The unit that is shipped, and the command that prints it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hri_predict.cli.service import UNIT, hidden, service, unit_text, unwritable
from hri_predict.files import data_path
from hri_predict.run import config as configuration
from tests.hri_predict.service.cells import cell, written


def test_the_unit_says_what_the_node_does(tmp_path):
    text = data_path("service", UNIT).read_text(encoding="utf-8")
    for line in ("Type=notify", "Restart=on-failure", "KillMode=mixed", "CapabilityBoundingSet="):
        assert line in text.splitlines()
    watchdog = re.search(r"^WatchdogSec=(\d+)$", text, re.MULTILINE)
    assert watchdog is not None
    assert float(watchdog[1]) >= 2
    assert "MemoryDenyWriteExecute" not in text  # compiled loops are written and run


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


def test_a_program_that_the_unit_hides_is_told():
    (line,) = hidden(Path("/home/robot/hri-predict/.venv/bin/hri-predict"))
    assert "/opt/hri-predict" in line
    assert not hidden(Path("/opt/hri-predict/bin/hri-predict"))
