"""The fault table: a few of its rows, and that a wrong expectation fails."""

from dataclasses import replace

import pytest

from hri_predict.protocol.reasons import Reason
from hri_sim.baseline_demo import baseline_demo
from hri_sim.fault_table.node_death import die
from hri_sim.fault_table.table import CASES, DEATHS, SENSORS, run_case, run_table

BUSY_S = 0.25  # a test machine may be busy with other things; the table itself allows nothing
NEAR = [{"start": [2.3, 0.2], "script": [{"do": "wait", "seconds": 60.0}]}]


@pytest.fixture(scope="module")
def base():
    return baseline_demo()


def case_of(name):
    return next(case for case in (*CASES, *SENSORS) if case.name == name)


def test_every_row_has_its_own_name_and_a_limit_where_something_must_happen():
    names = [case.name for case in (*CASES, *SENSORS)] + [name for name, *_ in DEATHS]
    assert len(set(names)) == len(names)
    for case in (*CASES, *SENSORS):
        no_limit = case.expected in ("count only", "may stop")
        assert (case.limit_ms is None) == no_limit, case.name


@pytest.mark.parametrize(
    "name",
    [
        "source: scenes lost",
        pytest.param("monitor: silent", marks=pytest.mark.long),
        pytest.param("back of two sensors: unplugged", marks=pytest.mark.long),
        pytest.param("front of two sensors: restarted, its clock 1 h back", marks=pytest.mark.long),
        pytest.param("front of two sensors: moved", marks=pytest.mark.long),
        pytest.param("source: every scene twice", marks=pytest.mark.long),
        pytest.param("drive: flooded, everything 10 times", marks=pytest.mark.long),
        pytest.param("monitor: out of order", marks=pytest.mark.long),
        pytest.param("both links: RobotState 10 times", marks=pytest.mark.long),
    ],
)
def test_a_row(base, name):
    outcome = run_case(base, case_of(name))
    assert outcome.fine
    assert outcome.clear_while_near == 0
    assert (outcome.measured_ms is None) == (outcome.expected == "count only")


LATE = [case for case in CASES if case.expected == "stays stopped"]


@pytest.mark.long
@pytest.mark.parametrize(
    "case",
    LATE,
    ids=lambda case: case.name,
)
def test_delays_longer_than_an_8_bit_counter_keep_the_robot_stopped(base, case):
    outcome = run_case(base, case)
    assert outcome.fine, outcome.reason
    assert outcome.recovered_ms is not None


@pytest.mark.long
def test_a_row_that_must_stay_stopped_fails_if_the_robot_moves_before_the_end(base):
    case = case_of("both links: advice 5.2 s late")
    half = tuple(f.replace("5.2", "0.2") for f in case.faults)  # that late is not too late
    outcome = run_case(base, replace(case, faults=half))
    assert not outcome.fine
    assert outcome.reason.startswith("moved")


@pytest.mark.long
def test_a_predictor_that_fails_has_its_row():
    (row,) = run_table("predictor: gives NaN")
    assert row.fine
    assert row.measured_ms is not None
    assert row.limit_ms is not None
    assert row.measured_ms <= row.limit_ms


@pytest.mark.parametrize(
    "wrong",
    [
        {"expected": "count only", "limit_ms": None},  # it did react
        pytest.param({"reasons": (Reason.CLOCK_JUMP,)}, marks=pytest.mark.long),  # another reason
        # not so soon: input is stale after 120 ms
        pytest.param({"limit_ms": 20.0}, marks=pytest.mark.long),
    ],
    ids=lambda wrong: "-".join(wrong),
)
def test_a_wrong_expectation_fails(base, wrong):
    assert not run_case(base, replace(case_of("source: scenes lost"), **wrong)).fine


@pytest.mark.long
def test_a_controller_that_only_counts_must_not_stop(base):
    """The node does not react to this fault, but the controller does."""
    case = case_of("monitor: silent")
    outcome = run_case(base, replace(case, expected="count only", limit_ms=None))
    assert outcome.measured_ms is not None
    assert not outcome.fine


def test_no_row_of_that_name_gives_no_row():
    assert list(run_table("no such fault")) == []


@pytest.mark.realtime
@pytest.mark.long
def test_the_node_is_killed_while_the_robot_moves():
    """Real processes: the robot stops, and goes on when the node is back."""
    death = die("node: kill -9", "kill", NEAR)
    assert death.limit_ms is not None
    assert death.measured_ms is not None
    stopped_ms = [death.counted[f"{link}_stopped_ms"] for link in ("drive", "monitor")]
    assert all(0 < ms <= death.limit_ms + 1e3 * BUSY_S for ms in stopped_ms)
    assert death.measured_ms <= death.limit_ms + 1e3 * BUSY_S
    assert death.counted["arm_stands_ms"] < death.limit_ms + 1000
    assert death.reason == "silent"
    assert death.fine or death.measured_ms > death.limit_ms  # its exit status is that of SIGKILL
    assert death.recovered_ms  # with the same controllers, which nobody started again
