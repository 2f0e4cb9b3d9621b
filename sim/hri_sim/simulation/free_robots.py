"""Courses of robots that see no person: what an approach is without protection.

Such a course depends on the robots' start and on the losses on the wire alone, not on people. The
losses follow from the start here, so all approaches with one start share a course; the longest so
far is kept, and a shorter approach takes its beginning.
"""

from collections.abc import Sequence
from dataclasses import replace

from hri_predict.contracts.cell import ControllerReport
from hri_sim.simulation.bodies import MotionTicks
from hri_sim.simulation.cell import Cell, Variant
from hri_sim.simulation.course import Course, SharedTruth
from hri_sim.simulation.episode import Log, judge, run_episode
from hri_sim.simulation.scenario import Scenario


class FreeRobots:
    """The robots of a cell without protection.

    Args:
        cell: the parts that stay the same.
        variant: any way to judge risk, because there is no person to judge.
    """

    def __init__(self, cell: Cell, variant: Variant) -> None:
        self._cell, self._variant = cell, variant
        self._known: dict[int, Log] = {}

    def log(self, scenario: Scenario, bodies: MotionTicks, truth: SharedTruth) -> Log:
        """Return the log of an approach whose robots see no person."""
        stamps = [snapshot.now_ns for snapshot in bodies.snapshots]
        known = self._known.get(scenario.start)
        if known is None or known.course.stamps_ns[: len(stamps)] != stamps:
            known = self._known[scenario.start] = run_episode(
                cell=self._cell,
                scenario=replace(scenario, link_seed=scenario.start),
                variant=self._variant,
                bodies=bodies,
                truth=truth,
                nobody=True,
            )
        log = _beginning(known, len(stamps))
        truth.open(stamps[0])
        log.course.people = [truth.at(stamp) for stamp in stamps]
        judge(log, self._cell.config_of(self._variant), self._cell.models)
        return log


def _beginning(log: Log, ticks: int) -> Log:
    """Return the first ticks of a log, without people and tally."""
    course, end_s = log.course, log.times_s[ticks - 1]
    return Log(
        times_s=log.times_s[:ticks],
        course=Course(
            stamps_ns=course.stamps_ns[:ticks],
            robots=course.robots[:ticks],
            tools=course.tools[:ticks],
        ),
        q={name: q[:ticks] for name, q in log.q.items()},
        path_s={name: path_s[:ticks] for name, path_s in log.path_s.items()},
        levels=log.levels[:ticks],
        controllers=_until(log.controllers, end_s),
    )


def _until(reports: Sequence[ControllerReport], end_s: float) -> list[ControllerReport]:
    """Return the reports with their events up to a time; counters are of the whole course."""
    return [
        replace(report, events=[event for event in report.events if event[0] <= end_s])
        for report in reports
    ]
