"""Incidents: each holds, and a story that goes wrong fails."""

from dataclasses import replace

import pytest

from hri_predict.protocol.reasons import Reason
from hri_sim.baseline_demo import baseline_demo
from hri_sim.fault_table.incident import ALL_MODES, Incident, configured, run_incident
from hri_sim.fault_table.incidents import INCIDENTS

STANDS = Incident(
    name="stands",
    people=({"start": [2.3, 0.2], "script": [{"do": "wait", "seconds": 9.0}]},),
    duration_s=3.0,
    modes=("iso",),
)


@pytest.fixture(scope="module")
def base():
    return baseline_demo()


def test_every_incident_has_its_own_name():
    names = [incident.name for incident in INCIDENTS]
    assert len(set(names)) == len(names)


@pytest.mark.long
@pytest.mark.parametrize("number", range(len(INCIDENTS)), ids=lambda k: INCIDENTS[k].name)
def test_each_holds(base, number):
    """Each in one of its modes, those of a kind in one after the other; the table plays all."""
    incident = INCIDENTS[number]
    mode = incident.modes[number % len(incident.modes)]
    (row,) = run_incident(base, replace(incident, modes=(mode,)))
    assert row.fine, (row.fault, row.reason)


@pytest.mark.long
def test_every_mode_of_an_incident_is_a_row(base):
    rows = list(run_incident(base, replace(STANDS, modes=ALL_MODES)))
    assert [row.fault for row in rows] == [f"stands ({mode})" for mode in ALL_MODES]
    assert all(row.fine for row in rows)


def test_a_story_in_which_all_goes_well_holds(base):
    (row,) = run_incident(base, replace(STANDS, not_clear=(1.0, 3.0), moving=(1.0, 3.0)))
    assert row.fine, row.reason


@pytest.mark.parametrize(
    "wrong",
    [
        {"moving": (0.0, 0.1)},
        {"not_moving": (1.0, 3.0)},
        {"says": (Reason.CLOCK_JUMP,)},
        {"never_says": (Reason.PERSON_APPROACHING, Reason.PERSON_NEAR)},
    ],
    ids=lambda wrong: "-".join(wrong),
)
def test_what_does_not_hold_fails(base, wrong):
    (row,) = run_incident(base, replace(STANDS, **wrong))
    assert not row.fine
    assert row.reason


def test_settings_are_merged_key_by_key(base):
    incident = replace(STANDS, settings={"risk": {"band_m": 0.2}, "source": {"noise_m": 0.0}})
    config = configured(base, incident, "fixed")
    assert config.node.risk.band_m == 0.2
    assert config.node.risk.mode == "fixed"
    assert config.source.model_dump()["noise_m"] == 0.0
    assert config.node.people == base.node.people
