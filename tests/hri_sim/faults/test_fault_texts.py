"""Faults as they are written on the command line."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_sim.faults.injector import parse_fault


def test_faults_from_the_command_line():
    assert parse_fault("vanish@3+2") == {"kind": "vanish", "start_s": 3.0, "duration_s": 2.0}
    assert parse_fault("freeze") == {"kind": "freeze"}
    assert parse_fault("drop@0.5:probability=0.25") == {
        "kind": "drop",
        "start_s": 0.5,
        "probability": 0.25,
    }
    assert parse_fault("teleport@3+2:person=1,offset=[0, 3,0]")["offset"] == [0, 3, 0]
    assert parse_fault("bit_errors@1:rate=0.01,direction=out")["direction"] == "out"
    assert parse_fault("drop@1:direction=in")["direction"] == "in"  # a link's


@pytest.mark.parametrize(
    ("text", "target", "message"),
    [
        ("vanisch@3+2", None, "did you mean 'vanish'"),
        ("vanish@3+2", "link", "unknown fault 'vanish'"),
        ("bit_errors", "source", "available: .*vanish"),
        ("vanish@-1", None, "expected kind@start"),
        ("vanish@1.2.3", None, "expected kind@start"),
        ("vanish@3+0", None, "duration_s"),
        ("", None, "expected kind@start"),
        ("delay@1:delay=3", "source", "did you mean 'delay_s'"),
        ("delay@1:delay_s", None, "lacks a value"),
        ("delay@1:delay_s=soon", "source", "delay_s"),
        ("delay@1:delay_s=.nan", "source", "delay_s"),
        ("vanish@1:person=[", None, "expected kind@start"),
        ("vanish@1:person=2001-13-45", None, "expected kind@start"),
        ("drop@1+1:kind=freeze", None, "'kind' is not a parameter; write it as kind@start"),
        ("drop@1+1:start_s=3", None, "'start_s' is not a parameter"),
        ("drop@1+1:duration_s=9", None, "'duration_s' is not a parameter"),
        ("delay@1:delay_s=1,delay_s=2", None, "'delay_s' is given twice"),
    ],
)
def test_a_wrong_fault_names_the_remedy(text, target, message):
    with pytest.raises(ConfigError, match=message) as caught:
        parse_fault(text, target)
    assert "\n" not in str(caught.value)
