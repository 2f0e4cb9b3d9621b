"""Runs one step of a validation and reports the outcome."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.geometry import norm, transform
from hri_predict.base.settings import Pose
from hri_predict.cli.commission.answers import Answers, RegistrationAnswers, ask_points
from hri_predict.cli.register.points import say
from hri_predict.cli.register.register import Wizard, refuse_fallen, refuse_merged, refuse_misfit
from hri_predict.cli.register.sight import (
    Sensor,
    SightedPoint,
    Sights,
    choose_joint,
    opened,
    place_of,
)
from hri_predict.cli.register.solve import LEAST_POINTS, solve
from hri_predict.cli.register.write import write_pose
from hri_predict.commissioning import echo, stopping
from hri_predict.commissioning.identity import identity_of
from hri_predict.commissioning.playback import circles_of
from hri_predict.commissioning.report import Outcome, Registration, Step, TouchedPoint
from hri_predict.commissioning.simulated import is_simulated, simulated, with_people, with_toucher
from hri_predict.commissioning.typed_stops import MeasuredStop, typed_stops, without_top_speed
from hri_predict.commissioning.walk import WalkPlan, judge_walk, walk
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.config import Config


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Inputs of every step.

    Attributes:
        config: the cell.
        answers: the answers.
        folder: for the recording.
        simulate: use simulated people and mock controllers, regardless of the cell.
        interactive: whether a user can answer prompts.
    """

    config: Config
    answers: Answers
    folder: Path
    simulate: bool
    interactive: bool

    @property
    def live(self) -> Config:
        """The cell, or its simulated version."""
        return simulated(self.config, circles_of(self.config)) if self.simulate else self.config

    @property
    def is_simulated(self) -> bool:
        """Whether people or controllers are simulated."""
        return self.simulate or is_simulated(self.config)

    @property
    def people_simulated(self) -> bool:
        """Whether the people are simulated."""
        return self.simulate or self.config.source.kind == "procedural"


Found = tuple[Any, list[str], list[str], Config]
"""The result, the failures, the points that could not be judged, and the cell afterwards."""


def do_step(name: str, task: Task) -> tuple[Step[Any], Config]:
    """Do one step, or record that it is skipped.

    Raises:
        HriPredictError: it cannot be done; nothing is noted then.
    """
    now = datetime.now(UTC).replace(microsecond=0)
    if name in task.answers.skip:
        note = task.answers.skip[name]
        step = _step(task, task.config, outcome="skipped", at=now, note=note)
        return step, task.config
    result, failed, missing, config = _DO[name](task)
    outcome: Outcome = "failed" if failed else "open" if missing else "passed"
    why = [*failed, *missing]
    return _step(task, config, outcome=outcome, at=now, why=why, result=result), config


def _step(task: Task, config: Config, **fields: Any) -> Step[Any]:
    return Step(
        by=task.answers.by,
        simulated=task.is_simulated,
        identity=identity_of(config).hash,
        **fields,
    )


def _registration(task: Task) -> Found:
    found, config = register_points(
        task.live if task.simulate else task.config,
        task.answers.registration,
        simulated=task.people_simulated,
        interactive=task.interactive,
    )
    return found, judge_registration(found), [], task.config if task.simulate else config


def _echo(task: Task) -> Found:
    answers, names = task.answers.echo, [link.name for link in task.config.links]
    for name in answers.measured:
        if name not in names:
            raise ConfigError(
                f"echo.measured.{name}: no such link{nearest(name, names)} "
                f"(available: {', '.join(names) or 'none'})"
            )
    live = task.live
    if task.people_simulated:
        live = with_people(live, [])
    say(f"echo: measuring for {answers.seconds:g} s in shadow mode; no robot may move")
    elsewhere = {
        name: echo.MeasuredElsewhere(**trips.model_dump())
        for name, trips in answers.measured.items()
    }
    found = echo.measure_echo(live, answers.seconds, MonotonicClock(), elsewhere)
    failed, missing = echo.judge_echo(found)
    left_out = set(names) - {link.name for link in live.links}
    missing += [f"link {name}: links of this kind cannot be simulated" for name in sorted(left_out)]
    return found, failed, missing, task.config


def _stopping(task: Task) -> Found:
    answers = task.answers.stopping
    if answers.measured:
        return _typed(task)
    live = task.live
    if task.people_simulated:
        live = with_people(live, [])
    moves_really = any(link.simulate is None for link in live.links)
    if moves_really and not answers.cell_is_clear:
        raise ConfigError(
            "stopping.cell_is_clear: not confirmed; robots move in this step. Clear the cell, keep "
            "the emergency stop at hand, and confirm; or skip the step with a note"
        )
    plan = stopping.StoppingTrials(
        speeds_m_s=answers.speeds_m_s,
        repeats=answers.repeats,
        wait_s=answers.wait_s,
    )
    found, missing = stopping.measure_stops(live, plan, MonotonicClock(), say)
    if not found.stops:
        missing.append("no stop was measured: check that the node permits the robots to move")
    else:
        missing += without_top_speed(live.node.robots, found)
    return found, stopping.judge_stops(found), missing, task.config


def _typed(task: Task) -> Found:
    names = [robot.name for robot in task.config.node.robots]
    stops = task.answers.stopping.measured
    for i, stop in enumerate(stops):
        if stop.robot not in names:
            raise ConfigError(
                f"stopping.measured.{i}.robot: no robot '{stop.robot}'{nearest(stop.robot, names)} "
                f"(available: {', '.join(names)})"
            )
    found = typed_stops(task.config, [MeasuredStop(**stop.model_dump()) for stop in stops])
    missing = without_top_speed(task.config.node.robots, found)
    return found, stopping.judge_stops(found), missing, task.config


def _walk(task: Task) -> Found:
    answers, live = task.answers.walk, task.live
    if answers.virtual and (live.source.kind != "procedural" or _real_links(live)):
        raise ConfigError(
            "walk.virtual: people or links of this cell are real, so it runs in real time; leave "
            "it out, or use --simulate"
        )
    if not answers.shadow and _real_links(live) and not task.answers.stopping.cell_is_clear:
        raise ConfigError(
            "walk.shadow: false lets real robots move near the person who walks; leave it out: "
            "shadow mode records the same people"
        )
    plan = WalkPlan(
        seconds=answers.seconds,
        cell_m=answers.cell_m,
        least_coverage=answers.least_coverage,
        exclude=[[list(point) for point in polygon] for polygon in answers.exclude],
        shadow=answers.shadow,
        virtual=answers.virtual,
    )
    if task.interactive and not task.people_simulated:
        say("walk: cover the whole floor, within the robots' reach and around it")
    say(f"walk: recording for {answers.seconds:g} s")
    found = walk(task.config, live, plan, task.folder)
    failed, missing = judge_walk(found)
    return found, failed, missing, task.config


def _real_links(config: Config) -> bool:
    return any(link.simulate is None for link in config.links)


_DO: dict[str, Callable[[Task], Found]] = {
    "registration": _registration,
    "echo": _echo,
    "stopping": _stopping,
    "walk": _walk,
}


SIMULATED_POINTS = [[0.6, -0.5, 0.8], [0.6, 0.6, 1.1], [1.6, 0.5, 0.9], [1.5, -0.6, 1.2]]
"""Points touched by a simulated person by default; metres from the first robot's base."""
_SETTLE_S = 5.0


def register_points(
    config: Config, answers: RegistrationAnswers, *, simulated: bool, interactive: bool
) -> tuple[Registration, Config]:
    """Prompt for touched points, and compare them with the positions that the sensor sees.

    Returns:
        The findings, and the configuration, with the new pose if one was written.

    Raises:
        ConfigError: too few points, no person in view, the hand not still, ...; or the pose cannot
            be written.
    """
    if not simulated:
        refuse_merged(config)
    points = answers.points
    if not points and simulated:
        pose = config.node.robots[0].room_from_robot
        base = [0.0, 0.0] if pose is None else pose.xyz
        points = [[x + base[0], y + base[1], z] for x, y, z in SIMULATED_POINTS]
    if not points and interactive:
        points = ask_points(LEAST_POINTS)
    if len(points) < LEAST_POINTS:
        raise ConfigError(
            f"registration.points: {len(points)} given; give at least {LEAST_POINTS} "
            f"(x, y, z in the room), or run it in a terminal"
        )
    if not simulated and answers.every_s is None and not interactive:
        raise ConfigError(
            "registration.every_s: missing; give the seconds after which the next point is observed"
        )
    known = [np.array(point) for point in points]
    touch = _touched_by_simulation if simulated else _touched
    joint, places, sights = touch(config, answers, known)
    return _compared(
        config,
        joint=joint,
        places=places,
        sights=sights,
        points=np.array(points),
        write=answers.write and not simulated,
    )


def judge_registration(found: Registration) -> list[str]:
    """Return the failures, one line for each point."""
    return [
        f"point {i}: the sensor is {1e3 * point.error_m:.0f} mm off; allowed "
        f"{1e3 * found.tolerance_m:.0f} (risk.person_uncertainty_m): write the pose that fits, or "
        f"measure the point again"
        for i, point in enumerate(found.points, 1)
        if point.error_m > found.tolerance_m
    ]


Touched = tuple[str, list[SightedPoint], list[Sights]]


def _touched(config: Config, answers: RegistrationAnswers, known: list[Floats]) -> Touched:
    with ExitStack() as stack:
        sensor = stack.enter_context(opened(assemble.build_source(config, with_faults=False)))
        wizard = Wizard(
            sensor=sensor,
            joint=choose_joint(sensor.source, answers.joint),
            tool=None,
            floor_m=config.node.people.floor_m,
            seconds=answers.seconds,
            every_s=answers.every_s,
        )
        wizard.collect(known)
        return wizard.joint, wizard.places, wizard.sights


def _touched_by_simulation(
    config: Config, answers: RegistrationAnswers, known: list[Floats]
) -> Touched:
    """A simulated person who holds a hand at each point in turn, on a virtual clock."""
    joint, places, sights = "", [], []
    for point in known:
        source = assemble.build_source(with_toucher(config, point), with_faults=False)
        clock = VirtualClock(1_000_000_000)
        source.open(clock.now_ns())
        joint = choose_joint(source, answers.joint)
        sensor = Sensor(source, clock)
        sensor.watch(_SETTLE_S)
        sights.append(sensor.watch(answers.seconds))
        places.append(place_of(sensor, sights[-1], joint))
        source.close()
    return joint, places, sights


def _compared(
    config: Config,
    *,
    joint: str,
    places: list[SightedPoint],
    sights: list[Sights],
    points: Floats,
    write: bool,
) -> tuple[Registration, Config]:
    seen = np.array([place.middle for place in places])
    source_from_room = np.asarray(np.linalg.inv(config.source.room_from_source.matrix()))
    best = solve(transform(source_from_room, seen), points)
    if write:
        correction = best.matrix @ source_from_room
        refuse_misfit(config, best)
        refuse_fallen(config, sights, correction)
        pose = (best.xyz, best.quaternion_xyzw)
        backup = write_pose(config.path, pose)
        say(f"the new pose is in {config.path}; the old file is {backup.name}")
        written = Pose(xyz=pose[0], quaternion_xyzw=pose[1])
        seen = transform(written.matrix() @ source_from_room, seen)
        config = replace(configuration.load(config.path), mute=config.mute)
    errors = norm(seen - points)
    return (
        Registration(
            joint=joint,
            tolerance_m=config.node.risk.person_uncertainty_m,
            points=[
                TouchedPoint(
                    point=points[i].tolist(),
                    seen=[round(float(v), 4) for v in seen[i]],
                    spread_m=round(places[i].spread_m, 4),
                    error_m=round(float(errors[i]), 4),
                    residual_m=round(float(best.residuals_m[i]), 4),
                )
                for i in range(len(points))
            ],
            scale=round(best.scale, 4),
            written=write,
        ),
        config,
    )
