"""A free robot's course is that of an episode in which the node sees no person, however long."""

import dataclasses

import pytest

from hri_sim.simulation.episode import run_episode, truth_of
from hri_sim.simulation.free_robots import FreeRobots
from tests.hri_sim.simulation.test_episode import episode


def course(log):
    """What depends on the robots alone."""
    end_s = log.times_s[-1]
    robots = [{name: tuple(map(tuple, q)) for name, q in at.items()} for at in log.course.robots]
    events = [[event for event in report.events if event[0] <= end_s] for report in log.controllers]
    return log.course.stamps_ns, robots, log.course.tools, log.path_s, log.levels, events


@pytest.mark.long
def test_a_shared_course_is_that_of_an_episode_of_its_own(cell):
    free = None
    for name in ("procedural:2", "procedural:1", "procedural:3"):  # longer and shorter ones
        modes, scenario, bodies = episode(cell, [name], 0)
        free = free or FreeRobots(cell, modes[-1])
        own = dataclasses.replace(scenario, link_seed=scenario.start)
        told = {"cell": cell, "bodies": bodies, "variant": modes[0], "nobody": True}
        alone = run_episode(scenario=own, **told)
        shared = free.log(scenario, bodies, truth_of(cell, scenario))
        assert course(shared) == course(alone)
        assert shared.tally() == alone.tally()
        assert shared.min_separation_m is not None
        assert len(shared.people) == len(shared.times_s)
        assert any(shared.people)
