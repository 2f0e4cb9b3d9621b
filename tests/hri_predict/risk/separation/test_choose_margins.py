"""The worked example of docs/guides/choose-margins.md: its lines of YAML follow from its table."""

import math
import re
from pathlib import Path

import pytest
import yaml

from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import protective_distance

PAGE = (Path(__file__).parents[4] / "docs" / "guides" / "choose-margins.md").read_text(
    encoding="utf-8"
)
ROWS = re.findall(r"^\| `(\w+)` \| ([\d.]+)", PAGE, re.MULTILINE)
V = {name: float(value) for name, value in ROWS}


def test_the_lines_follow_from_the_table():
    block, regions = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    lines = yaml.safe_load(block)["risk"]
    RiskSettings.model_validate(lines | yaml.safe_load(regions)["risk"])
    pixel_mm = 2000 * V["distance"] * math.tan(math.radians(V["angle"] / 2)) / V["pixels"]
    capability_mm = V["across"] * pixel_mm
    assert capability_mm <= 40  # the formula's range
    margins_mm = {
        "intrusion_m": 8 * (capability_mm - 14),
        "person_uncertainty_m": V["bias"] + V["sigmas"] * V["sigma"] + V["mounting"] + V["runs"],
        "robot_uncertainty_m": V["trueness"] + V["survey"],
    }
    for name, needed_mm in margins_mm.items():
        # rounded up, and by no more than 5 mm
        assert needed_mm <= 1000 * lines[name] + 1e-9 < needed_mm + 5
        assert f"**{round(needed_mm)} mm**" in PAGE
    assert f"= {pixel_mm:.2f} mm" in PAGE
    assert f"= {capability_mm:.1f} mm" in PAGE


def test_what_the_page_says_of_delay():
    ten_ms = protective_distance(1.0, 0.51, 0.3, 0.2).total
    assert ten_ms - protective_distance(1.0, 0.50, 0.3, 0.2).total == pytest.approx(0.026)
    assert "each 10 ms of T_r costs 26 mm of S_p at 1 m/s" in PAGE
    with_cuda = V["bias"] + V["sigmas"] * V["sigma"] + V["mounting"] + 87
    assert f"{with_cuda:.0f} mm" in PAGE
