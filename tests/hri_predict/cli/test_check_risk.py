"""``check`` says what the risk mode needs of the room."""

import pytest

from hri_predict import config as configuration
from hri_predict.cli.check import check, examine


@pytest.fixture
def checked(tmp_path):
    def look(risk: str) -> dict:
        text = configuration.shipped("demo.yaml").read_text(encoding="utf-8")
        path = tmp_path / "cell.yaml"
        path.write_text(text.replace("  mode: predictive\n", risk), encoding="utf-8")
        return examine(configuration.load(path))

    return look


def test_the_terms_at_full_speed(checked):
    found = checked("  mode: iso\n  intrusion_m: 0.16\n")
    needs, stop = found["risk"]["robots"]["arm"], found["stopping"]["arm"]
    # 1 m/s; v_h 1.6 m/s until it stands
    assert needs["s_h"] == pytest.approx(1.6 * (found["reaction_s"] + stop["time_s"]))
    assert needs["s_r"] == pytest.approx(1.0 * found["reaction_s"])
    assert needs["s_s"] == stop["distance_m"]
    assert (needs["c"], needs["z_d"], needs["z_r"]) == (0.16, 0.05, 0.01)
    total = sum(needs[term] for term in ("s_h", "s_r", "s_s", "c", "z_d", "z_r"))
    assert needs["protective_distance_m"] == pytest.approx(total)
    assert needs["fixed_radius_m"] == pytest.approx(needs["reach_m"] + total)
    assert not any("fixed_radius_m" in note for note in found["notes"])


def test_a_circle_that_is_too_small_is_noted(checked):
    small = checked("  mode: fixed\n  fixed_radius_m: 2.0\n")
    assert small["risk"]["robots"]["arm"]["fixed_radius_m"] == 2.0
    assert any("risk.fixed_radius_m 2 is below the reach of robot arm" in n for n in small["notes"])
    wide = checked("  mode: fixed\n")
    assert not any("fixed_radius_m" in note for note in wide["notes"])


def test_the_table_names_the_terms(capsys):
    check(configuration.shipped("demo.yaml"))
    out = capsys.readouterr().out
    assert "S_p: protective separation distance" in out
    assert "Risk mode predictive" in out
