"""``check`` says what the risk mode needs of the room."""

import re
from pathlib import Path

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.check import check, examine
from hri_predict.cli.run import run
from hri_predict.run import config as configuration

pytestmark = pytest.mark.usefixtures("built_once")
UNUSED = "  mode: {mode}\n  coverage: {{calibration: mine.calibration.json}}\n"


@pytest.fixture
def written(tmp_path):
    def write(risk: str) -> Path:
        text = configuration.shipped("demo.yaml").read_text(encoding="utf-8")
        path = tmp_path / "cell.yaml"
        path.write_text(text.replace("  mode: predictive\n", risk), encoding="utf-8")
        return path

    return write


@pytest.fixture
def checked(written):
    def look(risk: str) -> dict:
        return examine(configuration.load(written(risk)))

    return look


def test_the_terms_at_full_speed(checked):
    found = checked("  mode: iso\n  intrusion_m: 0.16\n")
    needs, stop = found["risk"]["robots"]["arm"], found["stopping"]["arm"]
    # 1 m/s; v_h 1.6 m/s until it stops
    assert needs["s_h"] == pytest.approx(1.6 * (found["reaction_time_s"] + stop["time_s"]))
    assert needs["s_r"] == pytest.approx(1.0 * found["reaction_time_s"])
    assert needs["s_s"] == stop["distance_m"]
    assert (needs["c"], needs["z_d"], needs["z_r"]) == (0.16, 0.05, 0.01)
    total = sum(needs[term] for term in ("s_h", "s_r", "s_s", "c", "z_d", "z_r"))
    assert needs["protective_distance_m"] == pytest.approx(total)
    assert needs["fixed_radius_m"] == pytest.approx(needs["reach_m"] + total)
    assert not any("fixed_radius_m" in note for note in found["notes"])


def test_nothing_for_what_reaches_in_unseen_is_noted(checked):
    assert any("risk.intrusion_m (C) is 0" in n for n in checked("  mode: iso\n")["notes"])
    found = checked("  mode: iso\n  intrusion_m: 0.16\n")
    assert not any("intrusion_m" in note for note in found["notes"])


def test_margins_by_region_are_noted(checked):
    found = checked("  mode: iso\n  region_margins_m: {head: 0.1, hand: 0.05}\n")
    said = "risk.region_margins_m, beyond C + Z_d + Z_r: head 0.1 m, hand 0.05 m"
    assert said in found["notes"]


def test_a_circle_that_is_too_small_is_noted(checked):
    small = checked("  mode: fixed\n  fixed_radius_m: 2.0\n")
    assert small["risk"]["robots"]["arm"]["fixed_radius_m"] == 2.0
    assert any("risk.fixed_radius_m 2 is below the reach of robot arm" in n for n in small["notes"])
    wide = checked("  mode: fixed\n")
    assert not any("fixed_radius_m" in note for note in wide["notes"])


def test_the_table_names_the_terms(capsys):
    check(config=configuration.shipped("demo.yaml"))
    out = capsys.readouterr().out
    assert "S_p: protective separation distance" in out
    assert "Risk mode predictive" in out


def test_the_printed_terms_add_up_to_the_printed_sum(written, capsys):
    check(config=written("  mode: iso\n  intrusion_m: 0.16\n  person_uncertainty_m: 0.085\n"))
    rows = re.findall(r"(S_h|S_r|S_s|C|Z_d|Z_r|S_p): .*?(\d+\.\d+) │", capsys.readouterr().out)
    printed = {term: float(metres) for term, metres in rows}
    assert printed["Z_d"] == 0.085
    total = printed.pop("S_p")
    assert total == pytest.approx(sum(printed.values()), abs=0.0035)  # 7 roundings of 0.5 mm


@pytest.mark.parametrize(
    ("risk", "said"),
    [
        ("  mode: predictive\n", "hold each joint in 99 % (estimated), checked live"),
        (
            "  mode: predictive\n  coverage: {level: 0.9, of: body, self_check: false}\n",
            "hold the whole body in 90 % (estimated), not checked live",
        ),
        ("  mode: iso\n", "mode iso uses no forecast"),
    ],
)
def test_what_zones_rest_on_is_said(checked, risk, said):
    assert said in checked(risk)["zones"]


def test_a_predictor_with_settings_of_its_own_is_not_calibrated(tmp_path):
    text = configuration.shipped("demo.yaml").read_text(encoding="utf-8")
    own = "  name: constant_velocity\n  span_s: 0.2\n"
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace("  name: average\n", own), encoding="utf-8")
    assert "not calibrated for constant_velocity" in examine(configuration.load(path))["zones"]


def test_a_guarantee_that_so_few_recordings_do_not_give_is_refused(checked):
    with pytest.raises(ConfigError, match="with 49 more, lower the level, or set basis"):
        checked("  mode: predictive\n  coverage: {basis: guaranteed}\n")


@pytest.mark.parametrize("mode", ["iso", "reactive", "fixed"])
def test_a_calibration_that_nothing_uses_is_noted(checked, mode):
    notes = checked(UNUSED.format(mode=mode))["notes"]
    said = f"risk.coverage has no effect: mode {mode} uses no forecast"
    assert [said in note for note in notes].count(True) == 1
    assert not any("coverage" in note for note in checked(f"  mode: {mode}\n")["notes"])


def test_run_warns_of_a_calibration_that_nothing_uses(written, monkeypatch, capsys):
    def not_run(*_):
        raise ConfigError("not today")

    monkeypatch.setattr("hri_predict.cli.run.run_session", not_run)
    for risk, warned in ((UNUSED.format(mode="iso"), 1), ("  mode: iso\n", 0)):
        with pytest.raises(ConfigError, match="not today"):
            run(config=written(risk))
        err = capsys.readouterr().err
        assert err.count("warning: risk.coverage has no effect: mode iso") == warned


def test_what_is_believed_of_the_source_s_clock(checked):
    found = checked("  mode: iso\n")
    assert found["clock"] == {"max_drift_ppm": pytest.approx(200), "wander_s": 0.1}


def test_the_restart_type_and_the_hashes_of_sets_are_found(checked):
    found = checked("  mode: iso\n  restart: supervised\n")
    assert (found["restart"], found["latch"]) == ("supervised", ["stop", "start", "blind", "lost"])
    assert found["sets"] == []
    assert not any("risk.sets" in note for note in found["notes"])


def test_sets_that_no_link_can_choose_are_noted(checked):
    found = checked("  mode: iso\n  sets: [{number: 4, name: load, max_speed_m_s: 0.3}]\n")
    (chosen,) = found["sets"]
    assert (chosen["number"], chosen["name"]) == (4, "load")
    assert 0 < chosen["hash"] < 2**32
    assert any("no link can choose a set" in note for note in found["notes"])


TWO = """\
rate_hz: 25
source: {kind: udp, room_from_source: {xyz: [0, 0, 0]}, rate_hz: 30, joint_map: coco17}
predictor: {name: constant_velocity, horizon_s: 1.2}
people: {posture_unchecked: only a test of check}
robots:
  - {name: a, model: ur5e, room_from_robot: {xyz: [0, 0, 0]}, max_speed_m_s: 1.0}
  - {name: b, model: ur5e, room_from_robot: {xyz: [2, 0, 0]}, max_speed_m_s: 1.0}
risk: {mode: iso}
links:
  - {name: slow, kind: serial, port: /dev/ttyUSB0, robots: [a], silence_timeout_s: 0.5}
  - {name: fast, kind: serial, port: /dev/ttyUSB1, robots: [b]}
"""


def test_each_controller_has_the_age_limit_of_its_own_robot(tmp_path, capsys):
    path = tmp_path / "two.yaml"
    path.write_text(TWO, encoding="utf-8")
    found = examine(configuration.load(path))
    slow_s, fast_s = (found["refuse_advice_older_than_s"][link] for link in ("slow", "fast"))
    assert slow_s - fast_s == pytest.approx(0.44)
    assert found["until_stopped_s"]["a"] - found["until_stopped_s"]["b"] == pytest.approx(0.44)
    needs = found["risk"]["robots"]["b"]
    assert needs["s_h"] == pytest.approx(1.6 * found["until_stopped_s"]["b"])
    check(config=path)
    said = capsys.readouterr().out
    assert f"controller on link fast: reject advice older than │ {fast_s * 1e3:.0f} ms" in said
