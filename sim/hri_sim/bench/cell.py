"""Configuration of the cell that the benches measure: people standing near moving robots."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.run import config as configuration
from hri_predict.run.config import Config, NodeSettings

RINGS = ((1.5, 6), (2.6, 10))  # metres from a robot, people there; together 16
MAX_PEOPLE = sum(count for _, count in RINGS)
APART_M = 6.0  # between robots: each has its own ring of capsules, people are near the first
_FOREVER = [{"do": "wait", "seconds": 3600.0}]


def settings(
    *,
    people: int = 2,
    robots: int = 1,
    predictor: str = "zero_velocity",
    rate_hz: float = 25.0,
    captures_hz: float | None = None,
    ticks: str = "fixed",
    horizon_s: float = 1.2,
    joint_map: str | None = None,
    links: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Return a configuration, as written in YAML, whose robots need no controller.

    Args:
        people: number of people around the first robot, up to 16.
        robots: number of robots that repeat a pick-and-place motion, side by side.
        predictor: name of the predictor.
        rate_hz: ticks a second.
        captures_hz: captures a second; default: one a second more than ticks, to cover every phase
            between captures and ticks.
        ticks: what starts a tick, as in the configuration.
        horizon_s: horizon of the forecast, seconds.
        joint_map: joint map of the tracker; the source delivers only its joints.
        links: entries of ``links:``.
    """
    source: dict[str, Any] = {
        "kind": "procedural",
        "rate_hz": captures_hz or rate_hz + 1.0,
        "noise_m": 0.004,
        "people": [{"start": at, "script": _FOREVER} for at in _places(people)],
    }
    if joint_map is not None:
        source["joint_map"] = joint_map
    return {
        "rate_hz": rate_hz,
        "ticks": ticks,
        "source": source,
        "predictor": {"name": predictor, "horizon_s": horizon_s},
        "people": {"max_people": max(8, people)},
        "robots": [_robot(index) for index in range(robots)],
        "links": list(links),
        "risk": {"limits": {"extend_beyond_horizon": True}},  # short horizons are measured, too
    }


def config(**wanted: Any) -> Config:
    """Return the validated configuration for ``settings``, without a file.

    Raises:
        ConfigError: one line naming the key and the remedy.
    """
    data = settings(**wanted)
    where = "the bench's cell"
    node = validated(NodeSettings, data, where)
    source, links = registry.load("sources", "procedural").settings_model, node.links
    return Config(
        path=Path("bench"),
        text="",
        node=node,
        source=validated(source, node.source, where),
        predictor=configuration.predictor_settings(node.predictor, where),
        links=tuple(
            validated(registry.load("links", link["kind"]).settings_model, link, where)
            for link in links
        ),
    )


def _places(people: int) -> list[list[float]]:
    """Return evenly spaced places on the rings, innermost ring first, all clear of the robot."""
    found: list[list[float]] = []
    for radius, count in RINGS:
        for k in range(min(count, people - len(found))):
            angle = 2.0 * math.pi * k / count
            found.append([radius * math.cos(angle), radius * math.sin(angle)])
    return found


def _robot(index: int) -> dict[str, Any]:
    return {
        "name": f"arm{index}",
        "model": "ur5e",
        "room_from_robot": {"xyz": [APART_M * index, 0.0, 0.0]},
        "payload_kg": 2.0,
        "max_speed_m_s": 1.0,
        "motion": {"kind": "trajectory", "file": "pick_and_place"},
    }
