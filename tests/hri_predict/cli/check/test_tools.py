"""``check`` says what each tool means, and what a moving base does."""

import io
from pathlib import Path
from typing import Any

import pytest
import yaml
from rich.console import Console

from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.check import examine
from hri_predict.cli.check.robots import WORST, tool_tables
from hri_predict.run import config as configuration

TOOLS = [
    {"name": "small", "number": 4, "payload_kg": 0.0},
    {
        "name": "long",
        "tool": [{"name": "rod", "a": [0, 0, 0], "b": [0, 0, 0.5], "radius": 0.05}],
        "payload_kg": 5.0,
    },
]


def shipped(name: str) -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load(configuration.shipped(name).read_text(encoding="utf-8"))
    return data


def examined(folder: Path, data: dict[str, Any]) -> dict[str, Any]:
    (folder / "cell.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    return examine(configuration.load(folder / "cell.yaml"))


def test_each_tool_and_the_worst(tmp_path: Path) -> None:
    data = shipped("demo.yaml")
    del data["robots"][0]["payload_kg"]
    data["robots"][0]["tools"] = TOOLS
    found = examined(tmp_path, data)
    tools = found["tools"]["arm"]
    assert list(tools) == ["small", "long", WORST]
    assert [facts["number"] for facts in tools.values()] == [4, None, None]
    for key in ("stopping_s", "stopping_m", "reach_m"):
        assert tools["small"][key] < tools["long"][key] == tools[WORST][key]
    # what the budget and the circle are made of is the worst
    assert found["stopping"]["arm"]["time_s"] == tools[WORST]["stopping_s"]
    assert found["risk"]["robots"]["arm"]["reach_m"] == tools[WORST]["reach_m"]
    assert any("tool long has no number" in note for note in found["notes"])
    console = Console(width=100, record=True, file=io.StringIO())
    for table in tool_tables(found["tools"]):
        console.print(table)
    assert "none is confirmed" in console.export_text()


def test_without_tools_there_is_nothing_to_say() -> None:
    assert examine(configuration.load(configuration.shipped("demo.yaml")))["tools"] == {}


def test_a_base_that_moves_is_noted_and_doors_are_refused(tmp_path: Path) -> None:
    data = shipped("simulate_mobile.yaml")
    assert any("its base moves" in note for note in examined(tmp_path, data)["notes"])
    data["people"] = {"exits": [{"polygon": [[30, 0], [31, 0], [31, 1]]}]}
    with pytest.raises(ConfigError, match=r"people.exits.0: the base of robot amr moves"):
        examined(tmp_path, data)
