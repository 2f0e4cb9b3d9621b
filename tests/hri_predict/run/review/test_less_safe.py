"""Each setting that is less safe than its default is named with what it permits, or refused."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.run.review.less_safe import less_safe_settings
from tests.hri_predict.run.review.cells import cell


def found(folder, *changes):
    return [str(each) for each in less_safe_settings(cell(folder, *changes))]


def people(text):
    return "people: {", f"people: {{{text}, "


def risk(text):
    return "risk: {", f"risk: {{{text}, "


def test_defaults_and_safer_values_are_not_named(tmp_path):
    assert found(tmp_path) == []
    safer = people("found_within_s: 0.1, lost_speed_m_s: 2.5")
    assert found(tmp_path, safer, ("reaction_s: 0.05", "reaction_s: 0.2")) == []


REACH = "limits: {reach: {trunk: {speed_m_s: 5, burst_m_s: 1}, arm: {speed_m_s: 15, burst_m_s: 4.5}, leg: {speed_m_s: 20, burst_m_s: 9}}}"  # noqa: E501


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (people("found_within_s: 2"), "people.found_within_s: 2 (default 0.5): a body that appears"
         " up to 2 s after a loss"),
        (people("lost_speed_m_s: 1.2"), "people.lost_speed_m_s: 1.2 (default 1.6): the zone of a "
         "lost person grows 0.4 m/s more slowly"),
        (people("exits: [{polygon: [[3, 3], [9, 3], [9, 6], [3, 6]]}]"),
         "people.exits: 6.0 x 3.0 m (default none): a person who crosses"),
        (people("max_gap_s: 1"), "people.max_gap_s: 1 (default 0.1): a person may be unseen for 1"),
        (people("posture_unchecked: the sensor is a radar"), "people.posture_unchecked: the sen"),
        (risk("limits: {physical_speed_m_s: 1.2}"), "risk.limits.physical_speed_m_s: 1.2 (default "
         "2): joints without a forecast and lost people are assumed to be 0.8 m/s slower"),
        (risk("limits: {arm_speed_m_s: 5, body_speed_m_s: 5}"), "risk.limits.body_speed_m_s: 5 "
         "(default 1.6): a person who approaches at up to 5 m/s does not count as fast"),
        (risk("limits: {velocity_error_m_s: 0}"),
         "risk.limits.velocity_error_m_s: 0 (default 1.6)"),
        (risk(REACH), "risk.limits.reach.trunk.speed_m_s: 5 (default 10): no zone holds"),
        (risk("person_uncertainty_m: 0"), "risk.person_uncertainty_m: 0 (default 0.05): a person "
         "may be 0.05 m nearer"),
        (risk("release_captures: 1"), "risk.release_captures: 1 (default 15)"),
        (risk("coverage: {self_check: false}"), "risk.coverage.self_check: false (default true)"),
        (("reaction_s: 0.05", "reaction_s: 0.001"), "links.plc.reaction_s: 0.001 (default 0.02): "
         "the controller is assumed to brake 0.019 s sooner"),
        (("0.05, delay_s: 0.01", "0.05, delay_s: 0.0001"),
         "links.plc.delay_s: 0.0001 (default 0.005)"),
        (("0.05, delay_s: 0.01", "0.05, delay_s: 0.1"),
         "robots.0.motion.delay_s: 0.01 (default 0.1): a RobotState counts as 0.09 s fresher"),
        (("0.05, delay_s: 0.01", "0.05, delay_s: 0.1, robots: []"),  # all of them
         "robots.0.motion.delay_s: 0.01 (default 0.1): a RobotState counts as 0.09 s fresher"),
        (("kind: state, ", "kind: state, stale_s: 1, "),
         "robots.0.motion.stale_s: 1 (default 0.1)"),
        (("model: ur5e", "model: ur5e\n    payload_kg: 2"), "robots.0.payload_kg: 2 (default 5): "
         "with more than 2 kg the robot stops later"),
        (("  kind: procedural\n", "  kind: procedural\n  stale_s: 2\n"),
         "source.stale_s: 2 (default 0.07667): input 2 s old is used"),
    ],
)  # fmt: skip
def test_what_is_less_safe_is_named_with_what_it_permits(tmp_path, change, said):
    lines = found(tmp_path, change)
    assert any(line.startswith(said) for line in lines), lines


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (people("found_within_s: 5"), "found_within_s"),
        (people("lost_speed_m_s: 0.5"), "lost_speed_m_s"),
        (risk("limits: {physical_speed_m_s: 0.5}"), "physical_speed_m_s"),
        (risk("limits: {arm_speed_m_s: 20, body_speed_m_s: 20}"), "_speed_m_s.*metres per second"),
        (risk(REACH.replace("speed_m_s: 5", "speed_m_s: 4")), "reach: trunk.speed_m_s 4 is less"),
        (("reaction_s: 0.05", "reaction_s: 0"), "reaction_s"),
        (("0.05, delay_s: 0.01", "0.05, delay_s: 0"), "delay_s"),
        (people("platform_m: 1000"), "platform_m.*metres are meant: 1?"),
    ],
)
def test_what_no_cell_needs_is_refused(tmp_path, change, said):
    with pytest.raises(ConfigError, match=said):
        cell(tmp_path, change)
