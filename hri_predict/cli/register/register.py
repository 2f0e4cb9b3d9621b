"""``register``: find ``room_from_source`` from touched points, and write it."""

import contextlib
import json
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import transform
from hri_predict.cli.common import without_effect
from hri_predict.cli.register.points import Tool, ask, point_from, say, tool_of
from hri_predict.cli.register.sight import (
    FEET,
    Sensor,
    SightedPoint,
    Sights,
    choose_joint,
    opened,
    place_of,
)
from hri_predict.cli.register.solve import LEAST_POINTS, SCALE_WITHIN, Registration, solve
from hri_predict.cli.register.write import lines_to_paste, write_pose
from hri_predict.people.body.posture_watch import refusal_of
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.config import Config

ANKLE_M = 0.08
"""Ankle above the floor, in shoes: lateralmalleolusheight 69.58 mm on average (ANSUR II, see
``hri_predict.base.skeleton``) and a sole."""
ATTEMPTS = 3


def register(
    *,
    config: Annotated[Path, typer.Argument(help="The node's YAML configuration.")],
    point: Annotated[
        list[str] | None,
        typer.Option(help="x,y,z of a point to touch (m, room); with --walk x,y. Repeatable."),
    ] = None,
    walk: Annotated[
        bool, typer.Option("--walk", help="Stand on floor marks instead of touching points.")
    ] = False,
    robot: Annotated[
        str | None,
        typer.Option(help="Touch the tool of this robot, whose controller reports its state."),
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option(
            help="Tip of that tool in the frame of the robot's last link.", show_default="0,0,0"
        ),
    ] = None,
    joint: Annotated[
        str | None, typer.Option(help="The joint that touches; default: a hand, else a wrist.")
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=0.5, max=30, help="Seconds to observe each point.")
    ] = 2.0,
    every: Annotated[
        float | None,
        typer.Option(
            min=0.1, max=600, help="Do not prompt; move to the next point after this many seconds."
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Write without prompting.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print only JSON; write nothing.")
    ] = False,
) -> None:
    """Find the sensor's pose from touched points; write it to room_from_source.

    Touch at least three known points that are not on one line, as far apart as possible, such as a
    corner of the table or a screw of the robot's base. Each is the median of the observed positions
    while you keep still. Axes and pose in the configuration may be wrong beforehand. Exit status 2
    if the points do not fit each other; nothing is written then.

    Example: hri-predict register cell.yaml
    """
    loaded = configuration.load(config)
    refuse_merged(loaded)
    if walk and (robot is not None or joint is not None):
        raise ConfigError("--walk: uses the feet and no robot; leave --robot and --joint out")
    if robot is None:
        without_effect({"--tool": tool}, "without --robot")
    if robot is not None and point:
        raise ConfigError("--robot: provides the points itself; leave --point out")
    if every is not None and not point:
        raise ConfigError("--every: needs the points; give --point at least three times")
    known = [point_from(text, 2 if walk else 3, "--point") for text in point or ()]
    if point and len(known) < LEAST_POINTS:
        raise ConfigError(f"--point: {len(known)} given; give at least {LEAST_POINTS}")
    with contextlib.ExitStack() as stack:
        sensor = stack.enter_context(opened(assemble.build_source(loaded, with_faults=False)))
        reach = tool_of(loaded, robot, point_from(tool or "0,0,0", 3, "--tool")) if robot else None
        wizard = Wizard(
            sensor=sensor,
            joint=FEET if walk else choose_joint(sensor.source, joint),
            tool=stack.enter_context(reach) if reach else None,
            floor_m=loaded.node.people.floor_m,
            seconds=seconds,
            every_s=every,
        )
        wizard.collect(known)
    found = _solved(loaded, wizard)
    if as_json:
        print(json.dumps(found))
        return
    _show(found)
    pose = (found["xyz"], found["quaternion_xyzw"])
    if not yes and ask(f"Write it into {loaded.path}? [y/N]").lower() not in ("y", "yes"):
        say(f"not written; to write it yourself, under 'source:': {lines_to_paste(pose)}")
        return
    backup = write_pose(loaded.path, pose)
    say(f"written; the old file is {backup.name}. Touch one more point to be sure:")
    say(f"hri-predict check {shlex.quote(str(loaded.path))} --touched X,Y,Z")


@dataclass
class Wizard:
    """Prompts for points and observes them.

    Attributes:
        places: position of the joint at each point, seen by the source as configured now.
        points: (3,) position of each in the room.
        sights: all observations.
    """

    sensor: Sensor
    joint: str
    tool: Tool | None
    floor_m: float
    seconds: float
    every_s: float | None

    def __post_init__(self) -> None:
        self.places: list[SightedPoint] = []
        self.points: list[Floats] = []
        self.sights: list[Sights] = []

    def collect(self, known: Sequence[Floats]) -> None:
        """Observe the ``known`` points, or prompt for points until an empty line."""
        for number, point in enumerate(known, 1):
            self._take(self._raised(point), f"Point {number} of {len(known)}, {_text(point)}: ")
        while not known:
            number = len(self.points) + 1
            end = "; empty when done" if number > LEAST_POINTS else ""
            if self.tool is not None:
                end = " (q: done)" if number > LEAST_POINTS else ""
                line = ask(
                    f"Point {number}: move the tool there, let it come to rest, press Enter{end}:"
                )
                if line == "q" and number > LEAST_POINTS:
                    return
                self._take(self.tool.position(), "")
                continue
            numbers = 2 if self.joint == FEET else 3
            line = ask(f"Point {number}: its {','.join('xyz'[:numbers])} in the room (m{end}):")
            if not line and number > LEAST_POINTS:
                return
            try:
                point = point_from(line, numbers, "point")
            except ConfigError as error:
                say(str(error))
                continue
            self._take(self._raised(point), "")

    def _raised(self, point: Floats) -> Floats:
        """Return a mark on the floor raised to ankle height; any other point unchanged."""
        return np.append(point, self.floor_m + ANKLE_M) if self.joint == FEET else point

    def _take(self, point: Floats, label: str) -> None:
        """Observe one point, and repeat after a poor measurement."""
        doing = "stand on it" if self.joint == FEET else f"touch it with {self.joint}"
        for attempt in range(1, ATTEMPTS + 1):
            if self.every_s is None:
                ask(f"{label}{doing}, keep still and press Enter:")
            else:
                say(f"{label}{doing}; measuring in {self.every_s:g} s")
                time.sleep(self.every_s)
            sights = self.sensor.watch(self.seconds)
            try:
                place = place_of(self.sensor, sights, self.joint)
            except ConfigError as error:
                if attempt == ATTEMPTS or not sights.scenes:
                    raise
                say(f"once more: {error}")
                continue
            say(f"  seen {place.count} times, noise {place.spread_m * 1e3:.0f} mm per axis")
            self.places.append(place)
            self.points.append(point)
            self.sights.append(sights)
            return


def _solved(config: Config, wizard: Wizard) -> dict[str, Any]:
    """Solve for the pose, and reject an implausible result.

    Raises:
        ConfigError: the points do not fit each other, or people would not stand upright.
    """
    source_from_room = np.asarray(
        np.linalg.inv(config.source.room_from_source.matrix()), np.float64
    )
    seen = transform(source_from_room, np.array([place.middle for place in wizard.places]))
    result = solve(seen, np.array(wizard.points))
    rows = [
        {"point": [round(float(v), 4) for v in point], "spread_m": round(place.spread_m, 4),
         "residual_m": round(float(residual), 4)}
        for point, place, residual in zip(
            wizard.points, wizard.places, result.residuals_m, strict=True
        )
    ]  # fmt: skip
    refuse_misfit(config, result)
    refuse_fallen(config, wizard.sights, result.matrix @ source_from_room)
    return {
        "joint": wizard.joint,
        "points": rows,
        "scale": round(result.scale, 4),
        "xyz": result.xyz,
        "quaternion_xyzw": result.quaternion_xyzw,
        "path": str(config.path),
    }


def refuse_merged(config: Config) -> None:
    """Refuse a merged source: its pose is not that of any of its sensors.

    Raises:
        ConfigError: the source is merged.
    """
    if config.source.kind == "merged":
        raise ConfigError(
            f"{config.path}: source: sensors of a merged source cannot be registered; name a "
            f"configuration with one of them as source"
        )


def refuse_misfit(config: Config, result: Registration) -> None:
    """Reject a pose that does not fit the points within ``risk.person_uncertainty_m``.

    Raises:
        ConfigError: the points do not fit each other.
    """
    allowed_m, worst = config.node.risk.person_uncertainty_m, int(result.residuals_m.argmax())
    if result.residuals_m[worst] > allowed_m:
        each = ", ".join(f"{1e3 * v:.0f}" for v in result.residuals_m)
        raise ConfigError(
            f"the points do not fit each other: residuals {each} mm, allowed {allowed_m * 1e3:.0f} "
            f"(risk.person_uncertainty_m); {_scale_text(result)}measure and touch point "
            f"{worst + 1} first again"
        )


def refuse_fallen(config: Config, seen: Sequence[Sights], correction: Floats) -> None:
    """Reject a pose in which the person who touched the points would not stand on the floor.

    Args:
        config: the cell.
        seen: captures of the source at each point, with the pose as configured.
        correction: (4, 4) from the pose as configured to the new one.

    Raises:
        ConfigError: the person would lie, float or hang upside down.
    """
    for sights in seen:
        why = refusal_of(
            transform(correction, sights.positions), sights.observed, config.node.people
        )
        if why is not None:
            raise ConfigError(
                f"with this pose the person who touched the points would be {why.text}; check the "
                f"points' order and signs, and people.floor_m"
            )


def _show(found: dict[str, Any]) -> None:
    for number, row in enumerate(found["points"], 1):
        print(
            f"point {number}  {_text(row['point']):24}  noise {row['spread_m'] * 1e3:3.0f} mm"
            f"  residual {row['residual_m'] * 1e3:3.0f} mm"
        )
    if abs(found["scale"] - 1.0) > SCALE_WITHIN:
        print(
            f"warning: the source's lengths are {1 / found['scale']:.2f} of the room's; check its "
            f"calibration and units"
        )
    print(lines_to_paste((found["xyz"], found["quaternion_xyzw"])))


def _scale_text(result: Registration) -> str:
    if abs(result.scale - 1.0) <= SCALE_WITHIN:
        return ""
    return f"the source's lengths are {1 / result.scale:.2f} of the room's; "


def _text(point: Sequence[float] | Floats) -> str:
    return ",".join(f"{float(v):g}" for v in point)
