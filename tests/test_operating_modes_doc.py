"""The example of docs/guides/operating-modes.md shows each mode that it asks for."""

from collections import Counter
from pathlib import Path

import pytest
import yaml

from hri_predict.base.files import data_path
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level, OperatingMode
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import BASELINE
from tests import pages

PAGE = pages.ROOT / "docs" / "guides" / "operating-modes.md"


class Permitted(View):
    """Counts the ticks of each mode in which the robot may move."""

    def __init__(self) -> None:
        self.ticks: Counter[OperatingMode] = Counter()

    def on_tick(self, tick: Tick) -> None:
        (advice,) = tick.advices
        self.ticks[advice.mode] += advice.level in (Level.SLOW, Level.WARN)


@pytest.mark.long
def test_each_mode_that_the_example_asks_for_moves_the_robot(tmp_path: Path) -> None:
    robots, asked = (yaml.safe_load(block.text) for block in pages.blocks("yaml", PAGE))
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    data |= robots | {"source": asked["source"], "predictor": BASELINE}
    for link in data["links"]:
        link["simulate"]["requests"] = asked["links"][0]["simulate"]["requests"]
    path = tmp_path / "modes.yaml"
    path.write_text(yaml.safe_dump(data | {"alerts": {"terminal": False}}), encoding="utf-8")
    permitted = Permitted()
    summary = run(configuration.load(path), Options(factor=None, duration_s=26, view=permitted))
    assert {f"mode_{m.name.lower()}" for m in OperatingMode} - {"mode_automatic"} == {
        name for name in summary.counted if name.startswith("mode_")
    } - {"mode_refused"}
    at_least = {OperatingMode.RECOVERY: 50, OperatingMode.MUTED: 40, OperatingMode.TEACH: 40}
    assert all(permitted.ticks[mode] >= ticks for mode, ticks in at_least.items()), permitted.ticks
