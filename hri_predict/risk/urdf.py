"""Make a robot file from a URDF: ``python -m hri_predict.risk.urdf --help``.

What is rigidly fixed is merged, and each URDF link that has a shape gets a capsule that holds all
of it (``capsule_fit``). A URDF does not say how a robot stops: the user must.
"""

import argparse
import os
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import yaml

from hri_predict.errors import ConfigError, HriPredictError, RobotError
from hri_predict.risk.capsule_fit import fit_capsule, needed_radius
from hri_predict.risk.robot_file import RobotFile, StoppingFile, read_robot_file
from hri_predict.risk.urdf_model import read_model
from hri_predict.risk.urdf_tree import read_chain
from hri_predict.settings import validated
from hri_predict.whole_file import write_whole

SPEEDS_M_S = [0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0]


@dataclass(frozen=True, slots=True)
class Converted:
    """A robot file from a URDF.

    Attributes:
        data: its contents, valid as ``RobotFile``.
        needed: radius (m) that each capsule needs to hold its link, without the margin.
        omitted: links of the URDF that have a shape and that no capsule covers.
    """

    data: dict[str, Any]
    needed: dict[str, float]
    omitted: list[str]


def main(arguments: list[str] | None = None) -> int:
    """Convert; exit status 2 and one line on standard error at a user's mistake."""
    try:
        print(_run(_parser().parse_args(arguments)))
    except HriPredictError as error:
        line = "".join(c if c.isprintable() else "?" for c in str(error))
        print(f"error: {line}", file=sys.stderr)
        return 2
    return 0


def _run(options: argparse.Namespace) -> str:
    found = convert(
        Path(options.urdf),
        base=options.base,
        tip=options.tip,
        stopping=_stopping(options),
        name=options.name,
        left_out=options.leave_out,
        packages=[Path(folder) for folder in options.package_dir],
        margin_m=_margin_m(options.margin_mm),
    )
    out = Path(options.out)
    if os.path.lexists(out):
        raise RobotError(f"--out {out}: exists already; name another, or remove it")
    try:
        write_whole(out, _text(found, options.margin_mm).encode())
    except OSError as error:
        raise RobotError(f"--out {out}: cannot be written: {error.strerror}") from error
    joints, capsules = len(found.data["joints"]), len(found.data["capsules"])
    said = f"{out}: {joints} joints, {capsules} capsules; look through it"
    return f"{said}\nnot covered: {', '.join(found.omitted)}" if found.omitted else said


def convert(
    urdf: Path,
    base: str,
    tip: str,
    stopping: dict[str, Any],
    name: str | None = None,
    left_out: list[str] | None = None,
    packages: list[Path] | None = None,
    margin_m: float = 0.005,
) -> Converted:
    """A robot file's contents from a URDF.

    Args:
        urdf, base, tip, left_out, packages: as ``read_chain`` takes them.
        stopping: the file's ``stopping``, see ``StoppingFile``.
        name: of the robot; default the URDF's.
        margin_m: added to the radius that a capsule needs, for cables and paint.

    Raises:
        RobotError: one line that names the file, what is wrong in it, and the remedy.
    """
    chain = read_chain(urdf, base, tip, left_out or [], packages or [])
    try:
        joints, bodies = read_model(chain, base)
    except RobotError as error:
        raise RobotError(f"URDF file {urdf}: {error}") from None
    capsules, needed = [], {}
    for link, body in bodies.items():
        fit = fit_capsule(body.points, body.radii)
        a, b = np.round(fit.a, 4) + 0.0, np.round(fit.b, 4) + 0.0  # + 0: no -0.0
        needed[link] = needed_radius(body.points, body.radii, a, b)
        radius = float(np.ceil((needed[link] + margin_m) * 1000) / 1000)
        ends = {"a": a.tolist(), "b": b.tolist()}
        capsules.append({"name": link, "link": body.carrier, **ends, "radius": radius})
    data = {
        "name": name or chain.name,
        "source": f"converted from the URDF {urdf.name}, chain {base} to {tip}",
        "base": base,
        "joints": joints,
        "capsules": capsules,
        "stopping": stopping,
    }
    try:
        validated(RobotFile, data, f"URDF file {urdf}")
    except ConfigError as error:
        raise RobotError(str(error)) from None
    return Converted(data, needed, chain.omitted)


def _stopping(options: argparse.Namespace) -> dict[str, Any]:
    """The stopping table that the user chose: another robot's, or from a deceleration."""
    by_hand = (options.deceleration, options.brake_delay, options.payload_kg)
    if options.stopping_from is not None:
        if by_hand != (None, None, None):
            raise RobotError("give either --stopping-from or --deceleration, not both")
        table = read_robot_file(options.stopping_from, None).stopping.model_dump()
        table["source"] = (
            f"COPIED FROM {options.stopping_from}, NOT MEASURED ON THIS ROBOT. {table['source']}"
        )
        return table
    if None in by_hand:
        raise RobotError(
            "a URDF does not say how the robot stops; give --deceleration M/S2, --brake-delay S "
            "and --payload-kg KG that it surely keeps, or --stopping-from ROBOT"
        )
    return decelerated(*by_hand)


def decelerated(deceleration: float, delay_s: float, payload_kg: float) -> dict[str, Any]:
    """The stopping table of full speed v for a delay T and then uniform deceleration d: time
    ``T + v / d``, distance ``v T + v^2 / (2 d)``; both rounded up.

    Args:
        deceleration: of the fastest point, m/s^2, 0.05 to 100.
        delay_s: from the onset of braking until it bites, 0 to 10.
        payload_kg: heaviest load with which the robot keeps to it.

    Raises:
        RobotError: not so.
    """
    for what, value, low, high in (
        ("--deceleration", deceleration, 0.05, 100),
        ("--brake-delay", delay_s, 0, 10),
        ("--payload-kg", payload_kg, 0, 100_000),
    ):
        if not low <= value <= high:
            raise RobotError(f"{what} must be {low:g} to {high:g}; got {value:g}")
    speed = np.array(SPEEDS_M_S)
    time_s = delay_s + speed / deceleration
    distance_m = speed * delay_s + speed**2 / (2 * deceleration)
    table = {
        "source": (
            f"MODEL, NOT MEASURED: full speed for {delay_s:g} s (brake build-up), "
            f"then uniform deceleration of {deceleration:g} m/s2, as given by whoever converted "
            f"the URDF. Measure your own robot, with its own load, before relying on any of it."
        ),
        "speed_m_s": SPEEDS_M_S,
        "rows": [
            {
                "payload_kg": payload_kg,
                "time_s": (np.ceil(time_s * 1e4) / 1e4).tolist(),
                "distance_m": (np.ceil(distance_m * 1e4) / 1e4).tolist(),
            }
        ],
    }
    try:
        validated(StoppingFile, table, "--deceleration and --brake-delay")
    except ConfigError as error:
        raise RobotError(str(error)) from None
    return table


def _margin_m(margin_mm: float) -> float:
    if not 0 <= margin_mm <= 1000:
        raise RobotError(f"--margin-mm must be 0 to 1000; got {margin_mm:g}")
    return margin_mm / 1000


def _text(found: Converted, margin_mm: float) -> str:
    """The robot file, with what a reader must know of its capsules."""
    radii = ", ".join(f"{link} {1000 * radius:.1f}" for link, radius in found.needed.items())
    about = (
        f"One capsule for each link with a shape, fitted to hold all of it: its collision geometry "
        f"or, where it has no other, its visual one. Radii needed, in mm: {radii}; {margin_mm:g} "
        f"mm were added, rounded up to a whole millimetre. Not covered: "
        f"{', '.join(found.omitted) or 'nothing'}. Are these shapes as large as the robot with its "
        f"cables? What it holds belongs under tool: and payload: (configs/robots/ur5e.yaml shows "
        f"how), in the frame of the last link."
    )
    lines = textwrap.fill(about, 98, initial_indent="# ", subsequent_indent="# ")
    body = yaml.safe_dump(found.data, sort_keys=False, default_flow_style=None, width=100)
    return f"# Metres, radians, kilograms, seconds.\n{lines}\n{body}"


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise RobotError(f"{message}; see {self.prog} --help")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m hri_predict.risk.urdf",
        description="Make a robot file from a URDF. Example: %(prog)s arm.urdf --base base_link "
        "--tip tool0 --deceleration 3 --brake-delay 0.05 --payload-kg 5 --out arm.yaml",
    )
    add = parser.add_argument
    add("urdf", help="the URDF file (a xacro file must be expanded first)")
    add("--base", required=True, metavar="LINK", help="link that stands still in the room")
    add("--tip", required=True, metavar="LINK", help="link at the end of the chain")
    add("--out", required=True, metavar="FILE", help="the robot file to write")
    add("--name", help="of the robot; default the URDF's")
    add("--leave-out", action="append", default=[], metavar="LINK", help="drop it and all beyond")
    add("--package-dir", action="append", default=[], metavar="DIR", help="holds package://NAME")
    add("--margin-mm", type=float, default=5.0, help="added to each capsule's radius; default 5")
    add("--stopping-from", metavar="ROBOT", help="copy the stopping table of this robot file")
    add("--deceleration", type=float, metavar="M/S2", help="or: that the robot surely keeps,")
    add("--brake-delay", type=float, metavar="S", help="after this time at full speed,")
    add("--payload-kg", type=float, metavar="KG", help="with this load")
    return parser


if __name__ == "__main__":
    sys.exit(main())
