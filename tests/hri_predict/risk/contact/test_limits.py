"""The limits of contact, against values worked by hand from ISO/TS 15066:2016, Annex A."""

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.base.skeleton import CANONICAL
from hri_predict.risk.contact.limits import NEVER, RegionLimits, SegmentLimits, load_table

TABLE = load_table(None, None)
BY_FORCE = 1e3  # cm2: so large that pressure never binds


# v = F / sqrt(mu k), F = 2 F_s, mu = m_H 12 / (m_H + 12), k in N/m; each line worked by hand
@pytest.mark.parametrize(
    ("region", "speed_m_s"),
    [
        ("hand", 1.353),  # 280 / sqrt(0.5714 x 75000)
        ("forearm", 1.222),  # 320 / sqrt(1.7143 x 40000)
        ("upper_arm", 1.118),  # 300 / sqrt(2.4 x 30000)
        ("pelvis", 0.749),  # 360 / sqrt(9.2308 x 25000)
        ("back_and_shoulders", 0.739),  # 420 / sqrt(9.2308 x 35000)
        ("abdomen", 0.724),  # 220 / sqrt(9.2308 x 10000)
        ("thigh", 0.612),  # 440 / sqrt(10.345 x 50000)
        ("chest", 0.583),  # 280 / sqrt(9.2308 x 25000)
        ("lower_leg", 0.330),  # 260 / sqrt(10.345 x 60000)
        ("neck", 1.284),  # 300 / sqrt(1.0909 x 50000)
        ("skull", 0.187),  # 130 / sqrt(3.2195 x 150000)
        ("face", 0.132),  # 65 / sqrt(3.2195 x 75000)
    ],
)
def test_speed_by_force_with_a_robot_of_12_kg(region, speed_m_s):
    found = TABLE.regions[region].speed_m_s(12.0, BY_FORCE)
    assert found == pytest.approx(speed_m_s, abs=6e-4)


def test_pressure_binds_on_a_small_area():
    chest = TABLE.regions["chest"]
    # 2 x 120 N/cm2 x 1 cm2 = 240 N < 280 N; 240 / sqrt(9.2308 x 25000)
    assert chest.speed_m_s(12.0, 1.0) == pytest.approx(0.4996, abs=1e-4)
    assert chest.speed_m_s(12.0, 0.5) == pytest.approx(0.2498, abs=1e-4)
    assert chest.speed_m_s(12.0, 2.0) == chest.speed_m_s(12.0, BY_FORCE)


def test_a_clamped_part_cannot_move_away():
    hand = TABLE.regions["hand"]
    # 140 N, no transient factor, mu = 12 kg: 140 / sqrt(12 x 75000)
    assert hand.speed_m_s(12.0, BY_FORCE, clamped=True) == pytest.approx(0.1476, abs=1e-4)


@given(
    st.sampled_from(sorted(TABLE.regions)), st.floats(0.5, 500), st.floats(0.01, 50), st.booleans()
)
def test_heavier_and_sharper_robots_are_slower(region, robot_kg, area_cm2, clamped):
    limits = TABLE.regions[region]
    speed = limits.speed_m_s(robot_kg, area_cm2, clamped=clamped)
    assert 0 < limits.speed_m_s(robot_kg * 1.5, area_cm2, clamped=clamped) < speed
    assert limits.speed_m_s(robot_kg, area_cm2 / 2, clamped=clamped) <= speed
    assert limits.speed_m_s(robot_kg, area_cm2, clamped=True) <= limits.speed_m_s(
        robot_kg, area_cm2
    )


@given(st.sampled_from(sorted(TABLE.regions)), st.floats(0.5, 500))
def test_the_energy_of_the_touch_is_that_of_the_spring_at_the_force(region, robot_kg):
    """The other way round: mu v^2 / 2 = F^2 / (2 k)."""
    limits: RegionLimits = TABLE.regions[region]
    v = limits.speed_m_s(robot_kg, BY_FORCE)
    mu = 1 / (1 / limits.mass_kg + 1 / robot_kg)
    force = limits.force_n * limits.transient
    assert mu * v**2 / 2 == pytest.approx(force**2 / (2 * limits.spring_n_mm * 1e3))


def test_every_segment_has_the_limit_of_its_most_delicate_region():
    limits = SegmentLimits.of(TABLE, CANONICAL.segment_names, 12.0, BY_FORCE)
    found = dict(zip(CANONICAL.segment_names, limits.transient_m_s, strict=True))
    assert found["head"] == 0
    assert found["thorax"] == found["shoulders"] == pytest.approx(0.583, abs=1e-3)
    assert found["pelvis"] == found["abdomen"] == pytest.approx(0.724, abs=1e-3)
    assert found["l_hand"] == found["r_hand"] == pytest.approx(1.353, abs=1e-3)
    assert found["l_foot"] == found["r_shank"] == pytest.approx(0.330, abs=1e-3)
    assert (limits.transient_m_s > 0).sum() == len(CANONICAL.segments) - 1
    assert np.all(limits.clamped_m_s <= limits.transient_m_s)
    assert limits.region[CANONICAL.segment_names.index("l_forearm")] == "forearm"


def test_what_nobody_knows_may_not_be_touched():
    limits = SegmentLimits.of(TABLE, ["tail", "l_hand"], 12.0, 1.0)
    assert limits.transient_m_s[0] == limits.clamped_m_s[0] == 0
    assert limits.transient_m_s[1] > 0


def test_no_table_permits_a_touch_of_the_head(tmp_path):
    data = yaml.safe_load(data_path("contact", "iso_ts_15066.yaml").read_text())
    for region in NEVER:
        data["regions"][region] |= {"force_n": 1000, "pressure_n_cm2": 1000, "transient": 2}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(data))
    own = load_table("own.yaml", tmp_path)
    assert SegmentLimits.of(own, ["head"], 12.0, BY_FORCE).transient_m_s[0] == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["regions"].pop("hand"), "hand missing"),
        (lambda d: d["regions"].update(tail=d["regions"]["hand"]), "tail"),
        (lambda d: d["regions"]["hand"].update(force_n=0), "force_n"),
        (lambda d: d["regions"]["hand"].update(force_n=float("nan")), "force_n"),
        (lambda d: d["regions"]["hand"].update(transient=20), "transient"),
        (lambda d: d.pop("source"), "source"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, change, said):
    data = yaml.safe_load(data_path("contact", "iso_ts_15066.yaml").read_text())
    change(data)
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError, match=said) as error:
        load_table("own.yaml", tmp_path)
    assert "\n" not in str(error.value)


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        load_table("nowhere.yaml", tmp_path)
    with pytest.raises(ConfigError, match=r"table\.csv is not"):
        load_table("table.csv", tmp_path)
