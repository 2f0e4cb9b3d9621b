"""Programs of others open a recording: Foxglove Studio, MCAP's TypeScript library, Rerun.

``make elsewhere`` fetches the first two and runs this; Rerun is used where it is installed.
"""

import io
import json
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from hri_predict.base.files import data_path
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run
from hri_sim.baseline_demo import BASELINE
from tests.browser import CHROMIUM, wait_for
from tests.elsewhere.studio import HERE, MODULES, studio

pytestmark = pytest.mark.long
fetched = pytest.mark.skipif(not MODULES.is_dir(), reason="not fetched: make elsewhere")
VIEW = ("/view/scene", "/view/people", "/view/frames")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Eight seconds of the demo, in which the person comes near."""
    folder = tmp_path_factory.mktemp("elsewhere")
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    cell = folder / "demo.yaml"
    cell.write_text(yaml.safe_dump({**data, "predictor": BASELINE}), encoding="utf-8")
    options = Options(factor=None, duration_s=8, record=folder / "a.mcap")
    run(configuration.load(cell).quiet(), options)
    return folder / "a.mcap"


def _counted(path: Path) -> dict[str, int]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    return {summary.channels[k].topic: count for k, count in counts.items()}


@fetched
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_foxglove_studio_shows_every_topic_and_names_no_problem(recorded):
    with studio(recorded, "1970-01-01T00:00:07.200000000Z") as browser:
        browser.wait_for_text("hri_predict.Advice @ 7.2", 120)
        browser.wait_for_text("level_number")
        told = browser.text()
        for topic, count in _counted(recorded).items():
            assert topic in told
            assert f"{count:,}" in told, topic
        click = "[...document.querySelectorAll('button')].find(e => /^Problems/.test(e.innerText))"
        browser.evaluate(f"{click}.click()")
        browser.wait_for_text("No problems found")
        time.sleep(1.0)  # a problem with what is drawn shows once it is drawn
        assert "No problems found" in browser.text()
        assert browser.console == []
        assert "STOP" in told
        wait_for(lambda: _red_pixels(browser) > 1000)  # the robot, and the zones before it
    assert {"level", "reason", "separation", "needed", "limit"} <= set(told.split())


@fetched
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_foxglove_studio_opens_a_file_that_was_cut(recorded, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:-4000])  # a killed node writes no summary
    with studio(cut, "1970-01-01T00:00:05.000000000Z") as browser:
        browser.wait_for_text("hri_predict.Advice @ 5.0", 120)
        assert "/view/scene" in browser.text()


def _red_pixels(browser: Any) -> int:
    """Pixels of the 3D view in the red of *stop*, lit or in shadow."""
    image = pytest.importorskip("PIL.Image")
    shown = image.open(io.BytesIO(browser.screenshot())).convert("RGB").crop((420, 40, 1000, 480))
    red, green, blue = np.moveaxis(np.asarray(shown, dtype=np.int64), 2, 0)
    return int(np.sum((red > 100) & (2 * green < red) & (2 * blue < red)))


@fetched
@pytest.mark.skipif(shutil.which("node") is None, reason="no node")
def test_the_library_of_the_authors_reads_and_validates_every_message(recorded):
    told = subprocess.run(
        ["node", str(HERE / "read.mjs"), str(MODULES.parent), str(recorded)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert told.returncode == 0, told.stderr
    found = json.loads(told.stdout)
    counted = _counted(recorded)
    assert found["messages"] == counted
    assert found["counted"] == sum(counted.values())
    assert found["wrong"] == []
    assert found["checkedByFoxglove"] == sum(counted[topic] for topic in VIEW)
    assert found["outOfOrder"] == 0
    assert found["chunks"] > 3


@pytest.mark.skipif(shutil.which("rerun") is None, reason="no rerun: pip install rerun-sdk")
def test_rerun_finds_nothing_wrong_with_the_file(recorded, tmp_path):
    for words in (["check", recorded], ["convert", recorded, "-o", tmp_path / "a.rrd"]):
        told = subprocess.run(
            ["rerun", "mcap", *map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )
        assert told.returncode == 0, told.stderr
        for topic in _counted(recorded):
            assert topic in told.stdout + told.stderr
    assert "error" not in told.stdout.lower()
