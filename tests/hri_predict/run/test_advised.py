"""Links that refuse old advice do so at the age that the delay budget allows."""

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.cli.check.check import check, examine
from hri_predict.cli.check.notes import delay_notes
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.review.less_safe import less_safe_settings
from tests.hri_predict.run.review.cells import cell

LINK = "{name: plc, kind: can, interface: virtual, channel: a, "
KINDS = {
    "rtde": "{name: plc, kind: rtde, host: 192.0.2.1, silence_timeout_s: 0.06, ",
    "modbus": "{name: plc, kind: modbus, silence_timeout_s: 0.06, ",
    "opcua": "{name: plc, kind: opcua, silence_timeout_s: 0.06, ",
}
# two periods of the source + 10 ms, 1.5 cycles and the silence time-out, in whole ms
LONGEST_S = 0.196


def of_kind(folder, kind: str, more: str = "") -> Config:
    return cell(folder, (LINK, KINDS[kind] + more))


@pytest.mark.parametrize("kind", KINDS)
def test_the_default_age_follows_from_the_delays(tmp_path, kind):
    config = of_kind(tmp_path, kind)
    assert assemble.completed(config, config.links[0]).model_dump()["max_age_s"] == LONGEST_S
    assert not [note for note in delay_notes(config) if "max_age_s" in note]
    assert not [each for each in less_safe_settings(config) if "max_age_s" in each.key]


def test_the_default_age_is_higher_on_a_slower_link_to_the_same_robot(tmp_path):
    """The robot's distances contain the delay of its slowest link."""
    can = f"{LINK}reaction_s: 0.05, delay_s: 0.01}}"
    slow = can.replace("0.05", "0.1").replace("0.01", "0.05")
    config = cell(tmp_path, (can, KINDS["rtde"].replace("plc", "ur") + "}\n  - " + slow))
    # 45 ms more on the wire and 80 ms more until it brakes than on the link itself
    assert assemble.completed(config, config.links[0]).model_dump()["max_age_s"] == 0.321


@pytest.mark.parametrize("kind", KINDS)
def test_an_age_that_the_delays_do_not_allow_is_noted_with_one_that_they_do(tmp_path, kind):
    config = of_kind(tmp_path, kind, "max_age_s: 0.4, ")
    assert assemble.completed(config, config.links[0]).model_dump()["max_age_s"] == 0.4
    (note,) = (note for note in delay_notes(config) if "max_age_s" in note)
    assert "link plc: max_age_s 400 ms" in note
    assert f"set it to {LONGEST_S:g}, or leave it out" in note
    (less_safe,) = (each for each in less_safe_settings(config) if "max_age_s" in each.key)
    assert (less_safe.value, less_safe.default) == ("0.4", "0.196")
    allowed = of_kind(tmp_path, kind, f"max_age_s: {LONGEST_S}, ")
    assert not [note for note in delay_notes(allowed) if "max_age_s" in note]


def test_a_link_is_built_with_the_age_and_check_prints_it(tmp_path, capsys):
    config = of_kind(tmp_path, "rtde")
    built = assemble.build_link(config, config.links[0], VirtualClock(0), transport=object())  # type: ignore[arg-type]
    assert built._slider._max_age_s == LONGEST_S  # type: ignore[attr-defined]
    assert examine(config)["max_age_s"] == {"plc": LONGEST_S}
    check(config=config.path)
    assert "link plc itself rejects advice older than │ 196 ms" in capsys.readouterr().out
