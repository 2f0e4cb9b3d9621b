"""Make a robot file from a URDF: ``hri-predict urdf --help``.

Rigidly fixed links are merged, and each URDF link with a shape gets a capsule that contains it
(``fit_capsule``). A URDF has no stopping data; the user must provide it.
"""

import os
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, OsErrorAs, RobotError
from hri_predict.base.files import atomic_write
from hri_predict.base.geometry import segment_distance
from hri_predict.base.settings import validated
from hri_predict.robots.body.shape import MAX_CAPSULES
from hri_predict.robots.file import RobotFile, StoppingFile, read_robot_file, size_problem
from hri_predict.robots.urdf.model import UrdfModel, read_model
from hri_predict.robots.urdf.tree import read_chain

SPEEDS_M_S = [0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0]


@dataclass(frozen=True, slots=True)
class Converted:
    """A robot file from a URDF.

    Attributes:
        data: its contents, valid as ``RobotFile``.
        needed: radius (m) required for each capsule to contain its link, without the margin.
        omitted: links of the URDF with a shape not covered by any capsule.
        unread: URDF extensions for other programs, with their number.
        hand: the frame of tool and payload, and the tip's place in it.
    """

    data: dict[str, Any]
    needed: dict[str, float]
    omitted: list[str]
    unread: list[str]
    hand: str


def convert(
    urdf: Path,
    *,
    base: str,
    tip: str,
    stopping: dict[str, Any],
    name: str | None = None,
    left_out: list[str] | None = None,
    packages: list[Path] | None = None,
    margin_m: float = 0.005,
) -> Converted:
    """Return the contents of a robot file from a URDF.

    Args:
        urdf, base, tip, left_out, packages: as ``read_chain`` takes them.
        stopping: the file's ``stopping``, see ``StoppingFile``.
        name: name of the robot; default: the URDF's.
        margin_m: margin added to each capsule's required radius, for cables and paint.

    Raises:
        RobotError: one line that names the file, what is wrong in it, and the remedy.
    """
    chain = read_chain(urdf, base, tip, left_out=left_out or [], packages=packages or [])
    try:
        model = read_model(chain, base, tip)
    except RobotError as error:
        raise RobotError(f"URDF file {urdf}: {error}") from None
    capsules, needed = [], {}
    for link, body in model.bodies.items():
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
        "joints": model.joints,
        "capsules": capsules,
        "stopping": stopping,
    }
    try:
        robot = validated(RobotFile, data, f"URDF file {urdf}")
    except ConfigError as error:
        raise RobotError(str(error)) from None
    if problem := size_problem(robot):
        raise RobotError(f"URDF file {urdf}: {problem}")
    if len(capsules) > MAX_CAPSULES:
        raise RobotError(
            f"URDF file {urdf}: {len(capsules)} links have a shape, but a robot has at most "
            f"{MAX_CAPSULES} capsules; --leave-out those inside others, or join them in the URDF"
        )
    return Converted(data, needed, chain.omitted, chain.unread, _hand(model, tip))


def _hand(model: UrdfModel, tip: str) -> str:
    """Describe the frame of tool and payload: that of the last link that moves, not the tip's."""
    last = str(model.joints[-1]["child"])
    if last == tip:
        return f"the frame of '{last}', the last link"
    xyz, rpy = ([round(v, 4) for v in model.tip[key]] for key in ("xyz", "rpy"))
    return f"the frame of '{last}', the last link that moves ('{tip}': xyz {xyz}, rpy {rpy} in it)"


def copied_stopping(robot: str) -> dict[str, Any]:
    """Return the stopping table of another robot file; its source states that it was copied.

    Raises:
        ConfigError: the robot file does not exist or is invalid.
    """
    table = read_robot_file(robot, None).stopping.model_dump()
    table["source"] = f"COPIED FROM {robot}, NOT MEASURED ON THIS ROBOT. {table['source']}"
    return table


def decelerated(deceleration: float, delay_s: float, payload_kg: float) -> dict[str, Any]:
    """Return the stopping table for full speed v during a delay T and then uniform deceleration d:
    time ``T + v / d``, distance ``v T + v^2 / (2 d)``; both rounded up.

    Args:
        deceleration: deceleration of the fastest point, m/s^2, 0.05 to 100.
        delay_s: from the brake command until the brakes bite, 0 to 10 s.
        payload_kg: heaviest load with which the robot reaches this deceleration.

    Raises:
        RobotError: a value is out of range.
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
            f"then uniform deceleration of {deceleration:g} m/s2, as given when the URDF was "
            "converted. Measure your own robot, with its own load, before relying on any of it."
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


def write(found: Converted, out: Path, margin_m: float) -> None:
    """Write the robot file; ``margin_m`` is named in its remarks.

    Raises:
        RobotError: ``out`` already exists, or cannot be written.
    """
    if os.path.lexists(out):
        raise RobotError(f"--out {out}: already exists; name another, or remove it")
    with OsErrorAs(RobotError, f"--out {out}: cannot be written"):
        atomic_write(out, _text(found, 1000 * margin_m).encode())


def _text(found: Converted, margin_mm: float) -> str:
    """Return the text of the robot file, with a remark on its capsules."""
    radii = ", ".join(f"{link} {1000 * radius:.1f}" for link, radius in found.needed.items())
    about = (
        f"One capsule for each link with a shape, fitted to hold all of it: its collision geometry "
        f"or, where it has no other, its visual one. Radii needed, in mm: {radii}; {margin_mm:g} "
        f"mm were added, rounded up to a whole millimetre. Not covered: "
        f"{', '.join(found.omitted) or 'nothing'}. Are these shapes as large as the robot with its "
        f"cables? What it holds belongs under tool: and payload: (configs/robots/ur5e.yaml shows "
        f"how), in {found.hand}."
    )
    lines = textwrap.fill(about, 98, initial_indent="# ", subsequent_indent="# ")
    body = yaml.safe_dump(found.data, sort_keys=False, default_flow_style=None, width=100)
    return f"# Metres, radians, kilograms, seconds.\n{lines}\n{body}"


GENERATIONS = 150
CANDIDATES = 32
DIRECTIONS = 400  # whose outermost points steer the search


@dataclass(frozen=True, slots=True, eq=False)
class FittedCapsule:
    """Two ends (3,) and a radius, metres, in the frame of the points."""

    a: Floats
    b: Floats
    radius: float

    @property
    def volume(self) -> float:
        """Cubic metres."""
        return float(_volume(np.asarray(np.linalg.norm(self.b - self.a)), self.radius))


def needed_radius(points: Floats, radii: Floats, a: Floats, b: Floats) -> float:
    """Return the radius with which the capsule ``a b`` contains every sphere, metres.

    Args:
        points: (N, 3) centres.
        radii: (N,) radii of the spheres, 0 for points.
        a, b: (3,) ends.
    """
    return float(np.max(segment_distance(points, points, a, b) + radii))


def fit_capsule(points: Floats, radii: Floats | None = None) -> FittedCapsule:
    """A capsule that contains every sphere, of about the minimum volume and never above that of the
    sphere about the mean of the centres.

    The search minimises the volume over the six coordinates of the capsule's two ends. The radius
    is not searched; it follows from the farthest point, so every candidate contains the whole body.
    The search is an elitist evolution strategy, (1 + 32) in the words of H.-G. Beyer, H.-P.
    Schwefel, "Evolution strategies", Natural Computing 1 (2002) 3-52, whose step grows while it
    gains and shrinks when it does not: gradients mislead, because the volume has kinks wherever the
    farthest point changes. It starts from capsules along the body's three principal axes and from a
    sphere, and is seeded: the same body gives the same capsule.

    Args:
        points: (N, 3) centres, metres, N >= 1; a mesh's vertices (it lies in their convex hull).
        radii: (N,) radii of the spheres; ``None``: all are points.

    Raises:
        ValueError: no points, or one that is not finite.
    """
    points = np.asarray(points, float)
    radii = np.zeros(len(points)) if radii is None else np.asarray(radii, float)
    if len(points) == 0 or not (np.isfinite(points).all() and np.isfinite(radii).all()):
        raise ValueError("a capsule needs at least one point, and all of them finite")
    mean, axes = points.mean(axis=0), _principal_axes(points)
    local = (points - mean) @ axes
    outermost = _outermost(local, radii)
    rng = np.random.default_rng(0)
    size = float(np.max(np.linalg.norm(local, axis=1) + radii))
    starts = _starts(local, radii)
    found = [
        _search(start, local[outermost], radii[outermost], size=size, rng=rng) for start in starts
    ]
    ends = np.array([*found, np.zeros(6)])  # the last: the sphere about the mean
    best = ends[np.argmin(_volumes(ends, local, radii))]
    a, b = (axes @ end + mean for end in (best[:3], best[3:]))
    return FittedCapsule(a, b, needed_radius(points, radii, a, b))


def _volume(length: Floats, radius: Floats | float) -> Floats:
    volume: Floats = np.pi * radius**2 * (length + 4 / 3 * radius)
    return volume


def _volumes(ends: Floats, points: Floats, radii: Floats) -> Floats:
    """Return volumes (K,) of the capsules with ``ends`` (K, 6) that contain all spheres."""
    a, b = ends[:, None, :3], ends[:, None, 3:]
    radius = np.max(segment_distance(points, points, a, b) + radii, axis=-1)
    return _volume(np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=-1), radius)


def _principal_axes(points: Floats) -> Floats:
    """Return (3, 3) axes as columns, longest last. The skewness fixes each one's sense: a body that
    was turned gets the axes turned likewise, and so the same capsule."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    skewness = ((centred @ axes) ** 3).sum(axis=0)
    turned: Floats = axes * np.where(skewness < 0, -1.0, 1.0)
    return turned


def _outermost(points: Floats, radii: Floats) -> Floats:
    """Return indices of the outermost spheres in even directions (Fibonacci lattice)."""
    i = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * i / DIRECTIONS, np.pi * (1 + 5**0.5) * i
    flat = np.sqrt(1 - z * z)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    # one direction at a time: a mesh may have a million vertices
    return np.unique([np.argmax(points @ direction + radii) for direction in directions])


def _starts(points: Floats, radii: Floats) -> list[Floats]:
    """Return ends (6,) of a sphere and of a capsule along each axis, around the box centre."""
    low, high = (points - radii[:, None]).min(axis=0), (points + radii[:, None]).max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    starts = [np.tile(middle, 2)]
    for axis in range(3):
        reach = np.zeros(3)
        reach[axis] = max(half[axis] - np.delete(half, axis).max(), 0.0)
        starts.append(np.concatenate([middle - reach, middle + reach]))
    return starts


def _search(
    start: Floats, points: Floats, radii: Floats, *, size: float, rng: np.random.Generator
) -> Floats:
    """Return ends (6,) of a capsule with at most the volume of ``start``."""
    best, least, step = start, float(_volumes(start[None], points, radii)[0]), 0.2 * size
    for _ in range(GENERATIONS):
        tries = best + step * rng.standard_normal((CANDIDATES, 6))
        volumes = _volumes(tries, points, radii)
        first = int(np.argmin(volumes))
        gained = float(volumes[first]) < least
        if gained:
            best, least = tries[first], float(volumes[first])
        step *= 1.2 if gained else 0.85
    return best
