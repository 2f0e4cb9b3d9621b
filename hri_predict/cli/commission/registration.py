"""The first step: measure the error of the sensor's pose by touched points; see ``register``."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import norm, transform
from hri_predict.base.settings import Pose
from hri_predict.cli.commission.answers import RegistrationAnswers, ask_points
from hri_predict.cli.register.register import Wizard, refuse_fallen
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
from hri_predict.commissioning.report import Registration, TouchedPoint
from hri_predict.commissioning.simulated import with_toucher
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.config import Config

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
        refuse_fallen(config, sights, correction)
        pose = (best.xyz, best.quaternion_xyzw)
        write_pose(config.path, pose)
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
