"""Episodes with people lost by cameras: drawn from a seed, and safe."""

from dataclasses import replace
from pathlib import Path

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.run import config as configuration
from hri_sim.simulation import occluded
from hri_sim.simulation.occluded import draw, simulate
from hri_sim.simulation.request import OcclusionRequest

CHEAP = "constant_velocity"
CONFIG = configuration.shipped("simulate.yaml")
REQUEST = OcclusionRequest(config=Path(CONFIG), episodes=2, modes=("predictive", "iso", "fixed"))


def test_number_and_seed_decide_an_episode():
    first = draw(3, 5, (8.0, 30.0), 2)
    assert draw(3, 5, (8.0, 30.0), 2) == first
    assert draw(3, 6, (8.0, 30.0), 2) != first
    assert first.rate_hz in (8.0, 30.0)
    assert len(first.cameras) == 2
    assert 1 <= len(first.people) <= 3


def test_a_run_is_played_in_parts(monkeypatch):
    monkeypatch.setattr(occluded, "play", lambda request, index: [index])
    parts = replace(REQUEST, first=40, episodes=3)
    assert list(simulate(parts, lambda k, n: None)) == [40, 41, 42]


def test_the_predictor_is_the_configurations_unless_another_is_named(tmp_path):
    text = CONFIG.read_text(encoding="utf-8").replace("name: average", "name: constant_velocity")
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace("horizon_s: 1.2", "horizon_s: 1.4\n  span_s: 0.3"), "utf-8")
    named = {
        name: occluded._base(replace(REQUEST, config=path, predictor=name)).predictor
        for name in (None, "constant_velocity", "zero_velocity")
    }
    assert named[None].name == "constant_velocity"
    assert named[None].model_dump()["span_s"] == 0.3
    assert named["constant_velocity"] == named[None]
    assert named["zero_velocity"].name == "zero_velocity"
    assert named["zero_velocity"].horizon_s == 1.4


def test_a_robot_without_a_drive_is_refused_before_the_first_episode(tmp_path, monkeypatch):
    """Without its drive no referee could see a touch, and the table would say 0."""
    monkeypatch.setattr(occluded, "play", None)
    robot = """\
  - name: other
    model: ur5e
    room_from_robot: {xyz: [4, 0, 0]}
    max_speed_m_s: 1.0
    motion: {kind: standing, positions: [0, 0, 0, 0, 0, 0]}
"""
    text = CONFIG.read_text(encoding="utf-8").replace("risk:\n", robot + "risk:\n", 1)
    path = tmp_path / "two.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="robot 'other' has no simulated drive; add a link"):
        list(simulate(replace(REQUEST, config=path), lambda k, n: None))


def test_everybody_is_shown_once_unless_the_source_sees_free_space():
    """In the first draw, the only person walks in the shadow of a box all the way."""
    request = replace(REQUEST, seed=61, modes=("predictive",))
    base = occluded._base(request)
    first = draw(61 * occluded._TRIES, 12, request.rates_hz, 1)
    assert occluded._possible(base, replace(request, free_space=True), 12) == first
    assert occluded._possible(base, request, 12) != first


@pytest.mark.long
@pytest.mark.parametrize("free_space", [False, True])
def test_nobody_is_touched_by_a_moving_robot(free_space):
    request = replace(REQUEST, episodes=1, seed=12, free_space=free_space, predictor=CHEAP)
    done = []
    rows = list(simulate(request, lambda k, n: done.append((k, n))))
    assert [row.mode for row in rows] == ["predictive", "iso", "fixed"]
    assert [row.contacts for row in rows] == [0, 0, 0]
    assert any(row.lost > 0 for row in rows)
    assert done[-1] == (1, 1)
