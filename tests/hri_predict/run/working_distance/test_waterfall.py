"""How near a person may work, and what each delay and margin costs of it."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.working_distance.measure import (
    FARTHEST_M,
    FAST,
    HELD,
    Measure,
    Situation,
    _ahead_rad,
    alone,
    robot_of,
)
from hri_predict.run.working_distance.seen import moved_zones
from hri_predict.run.working_distance.standing import standing
from hri_predict.run.working_distance.waterfall import TERMS, waterfall

STEP_M = 0.02


@pytest.fixture(scope="module")
def cell():
    """The demo's cell with a cheap predictor, releases that do not wait, and its source."""
    config = configuration.load(configuration.shipped("demo.yaml"))
    config = alone(config.with_predictor("constant_velocity", horizon_s=1.2))
    at_once = {"release_captures": 1, "speed_rise_m_s2": 1000.0}
    risk = config.node.risk.model_copy(update=at_once)
    return replace(config, node=config.node.model_copy(update={"risk": risk}))


@pytest.fixture(scope="module")
def situation(cell):
    return Situation.of(
        cell, assemble.build_source(cell), assemble.build_predictor(cell), robot_of(cell, None)
    )


def person(situation, hidden=()):
    delivered = situation.source.joint_map.mapped.copy()
    delivered[list(hidden)] = False
    return standing(situation.predictor, delivered, age_s=0.0, seconds=3.2)


def measured(situation, seen, middle=(0.0, 0.0)):
    return Measure(
        situation,
        seen,
        zones=situation.zones(seen),
        robots=situation.robots(seen),
        middle=np.array(middle),
    )


def test_at_the_working_distance_the_robot_may_work_and_a_little_nearer_it_may_not(situation):
    found = measured(situation, person(situation))
    distance_m = found.distance_m(step=STEP_M)
    at = found.limits(distance_m) >= FAST * situation.max_speed_m_s
    assert at.mean() >= HELD
    nearer = found.limits(distance_m - STEP_M) >= FAST * situation.max_speed_m_s
    assert nearer.mean() < HELD
    assert found.limits(0.5).max() == 0.0  # inside the robot's reach
    assert found.limits(FARTHEST_M).min() == situation.max_speed_m_s


def test_each_distance_is_judged_as_the_stages_do_it_tick_by_tick(situation):
    seen = person(situation, hidden=(3,))
    zones, robots = situation.zones(seen), situation.robots(seen)
    found = measured(situation, seen)
    model = situation.models[0]
    for distance_m in (0.8, 1.4, 1.6, 1.8, 2.0, 3.0):
        angle = _ahead_rad(model, situation.path)
        matrix = np.eye(4)
        matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        matrix[:2, 3] = model.base[:2] + matrix[:2, :2] @ [distance_m, 0.0]
        engine = situation.engine(situation.trackers(seen.snapshots[0].now_ns))
        limits = []
        for snapshot, bodies, now in zip(seen.snapshots, zones, robots, strict=True):
            there = moved_zones(bodies, matrix)
            advice = engine.levels(snapshot, there, engine.separation(there, now)).advices[0]
            limits.append(advice.speed_limit_m_s)
        limits = limits[-len(found.limits(6.0)) :]
        works = found.works(distance_m)  # before the limits are known
        assert works == (np.mean(np.array(limits) >= FAST * situation.max_speed_m_s) >= HELD)
        assert found.limits(distance_m).tolist() == limits


def test_it_does_not_matter_where_the_person_was_seen_nor_where_to_look_first(situation):
    seen = person(situation)
    found = measured(situation, seen)
    distance_m = found.distance_m(step=STEP_M)
    assert found.distance_m(low=0.4, high=0.5, step=STEP_M) == pytest.approx(distance_m, abs=STEP_M)
    aside = measured(situation, seen, middle=(0.3, 0.0))  # counted from a place nearer to the robot
    assert aside.distance_m(step=STEP_M) == pytest.approx(distance_m + 0.3, abs=2 * STEP_M)


def test_a_turned_robot_turns_the_person_with_it(situation, cell):
    (robot,) = cell.node.robots
    turned = robot.room_from_robot.model_copy(
        update={"xyz": [2.0, -1.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 2**-0.5, 2**-0.5]}
    )
    robots = [robot.model_copy(update={"room_from_robot": turned})]
    elsewhere = replace(
        situation,
        config=replace(cell, node=cell.node.model_copy(update={"robots": robots})),
    )
    seen = person(situation)
    here_m = measured(situation, seen).distance_m(step=STEP_M)
    assert measured(elsewhere, seen).distance_m(step=STEP_M) == pytest.approx(here_m, abs=STEP_M)


@pytest.mark.long
def test_the_terms_and_what_is_left_add_up_and_no_delay_costs_less_than_nothing(situation):
    feet = [situation.predictor.skeleton.joints.index(f"{side}_foot") for side in "lr"]

    def watch(whole, fresh):
        return situation, person(situation, () if whole else feet)

    found = waterfall(watch, np.zeros(2), step=STEP_M, leaves=("release", "robot_state"))
    assert set(found.costs_m) == {term.key for term in TERMS}
    assert sum(found.costs_m.values()) + found.rest_m == pytest.approx(found.total_m)
    assert found.costs_m["release"] == found.costs_m["robot_state"] == 0.0
    assert min(found.costs_m.values()) > -STEP_M  # the search's own step
    for key in ("silence_timeout", "stopping", "seen", "margins"):
        assert found.costs_m[key] > STEP_M, key


def test_the_error_that_a_tracker_states_is_a_term_of_its_own(situation):
    seen = person(situation)
    stated = [replace(each, errors_m=np.array([0.25])) for each in seen.snapshots]
    coarse = replace(seen, snapshots=stated)
    leaves = [term.key for term in TERMS if term.key != "place"]

    def found(seen):
        return waterfall(lambda *_: (situation, seen), np.zeros(2), step=STEP_M, leaves=leaves)

    without, with_it = found(seen), found(coarse)
    assert without.costs_m["place"] == 0.0
    assert with_it.costs_m["place"] == pytest.approx(0.25, abs=2 * STEP_M)
    assert with_it.rest_m == pytest.approx(without.total_m, abs=STEP_M)


def test_a_shorter_silence_timeout_lets_people_work_nearer(situation):
    (slow, *others) = situation.budget.links
    quick = [replace(link, silence_timeout_s=0.02) for link in (slow, *others)]
    faster = replace(situation, budget=replace(situation.budget, links=tuple(quick)))
    seen = person(situation)
    assert (
        measured(faster, seen).distance_m(step=STEP_M)
        < measured(situation, seen).distance_m(step=STEP_M) - STEP_M
    )


def test_a_robot_whose_path_is_not_known_is_refused_with_the_remedy(situation, cell):
    lost = replace(situation, config=replace(cell, links=()))
    with pytest.raises(
        ConfigError,
        match=r"no path of robot arm is known.*\{kind: state, plan: pick_and_place\}.*brake",
    ):
        _ = lost.path


@pytest.mark.parametrize(
    ("model", "plan"), [("ur10e", "ur10e_pick_and_place"), ("panda", "panda_pick_and_place"),
                        ("ur3e", "path.yaml")],
)  # fmt: skip
def test_the_remedy_names_a_plan_for_this_robot(situation, cell, model, plan):
    node = cell.node.model_copy(
        update={"robots": [cell.node.robots[0].model_copy(update={"model": model})]}
    )
    lost = replace(situation, config=replace(cell, links=(), node=node))
    with pytest.raises(ConfigError, match=rf"plan: {plan}\}}"):
        _ = lost.path


def test_an_unknown_robot_is_refused(cell):
    with pytest.raises(ConfigError, match=r"--robot amr: unknown.*\(known: arm\)"):
        robot_of(cell, "amr")
