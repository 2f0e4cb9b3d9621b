"""Read joints, and collision geometry as spheres, from a URDF's chain with Pinocchio.

Pinocchio (J. Carpentier et al., "The Pinocchio C++ library", SII 2019) merges rigidly fixed links
and places all geometry; its mesh loader is Assimp.
"""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RobotError
from hri_predict.base.quantities.units import meant
from hri_predict.robots.file import MAX_PART_M, MAX_SLIDE_M_S, MAX_TURN_RAD, MAX_TURN_RAD_S
from hri_predict.robots.urdf.reading import numbers
from hri_predict.robots.urdf.tree import UrdfChain

CONTINUOUS_RAD = 8.0  # for a joint without limits: about the range of RobotState on CAN
MIN_BODY_M = 0.001  # no link is smaller; what is was scaled away
CIRCLE = 48  # corners of the polygon around a cylinder's circle: 0.2 % wider


@dataclass(frozen=True, slots=True, eq=False)
class LinkBody:
    """A URDF link's collision geometry, as spheres whose convex hull contains it.

    Attributes:
        carrier: the moving link to which it is fixed.
        points: (N, 3) centres in the carrier's frame, metres.
        radii: (N,) radii, 0 for the corners of meshes and boxes.
    """

    carrier: str
    points: Floats
    radii: Floats


@dataclass(frozen=True, slots=True)
class UrdfModel:
    """A chain as a robot file describes it.

    Attributes:
        joints: the joints in the format of a robot file.
        bodies: every URDF link with collision geometry.
        tip: place of the tip in the frame of the last moving link, in the format of an ``origin``.
    """

    joints: list[dict[str, Any]]
    bodies: dict[str, LinkBody]
    tip: dict[str, list[float]]


def read_model(chain: UrdfChain, base: str, tip: str) -> UrdfModel:
    """Read a chain.

    Raises:
        RobotError: Pinocchio is not installed or refuses the file, a limit is missing, a number is
            not finite, a moving link has no geometry.
    """
    try:
        import pinocchio
    except ImportError as error:
        raise RobotError(
            "reading it needs Pinocchio; install it with: pip install 'hri-predict[robot]'"
        ) from error
    with _kept_quiet() as printed:
        try:
            model = pinocchio.buildModelFromXML(chain.text)
            collision = pinocchio.GeometryType.COLLISION
            geometry = pinocchio.buildGeomFromUrdfString(model, chain.text, collision)
        except (ValueError, RuntimeError) as error:
            raise RobotError(_reason(printed(), str(error))) from None
    joints, carriers = [], {0: base}
    for element in chain.joints:
        name, child = element.get("name", ""), element.find("child")
        assert child is not None  # the tree was checked
        link = child.get("link", "")
        index = model.getJointId(name)
        joints.append(
            {"name": name, "parent": [*carriers.values()][-1], "child": link}
            | _origin(model.jointPlacements[index], pinocchio, name)
            | {"axis": _axis(element, name)}
            | ({"type": "prismatic"} if element.get("type") == "prismatic" else {})
            | _limits(element, name)
        )
        carriers[index] = link
    read = [model.frames[item.parentFrame].name for item in geometry.geometryObjects]
    for body in ElementTree.fromstring(chain.text).findall("link"):
        if len(body.findall("collision")) != read.count(body.get("name", "")):
            raise RobotError(
                f"link '{body.get('name')}': a <collision> or <visual> has no shape that "
                f"URDF knows (box, cylinder, sphere, mesh); correct it"
            )
    at_tip = _origin(model.frames[model.getFrameId(tip)].placement, pinocchio, f"at {tip}")
    return UrdfModel(joints, _bodies(model, geometry, carriers), at_tip["origin"])


def _bodies(model: Any, geometry: Any, carriers: dict[int, str]) -> dict[str, LinkBody]:
    """Return the geometry by URDF link; ``carriers``: the link moved by each Pinocchio joint."""
    bodies: dict[str, LinkBody] = {}
    for item in geometry.geometryObjects:
        name = model.frames[item.parentFrame].name
        points, radii = _spheres(item.geometry, name)
        if not len(points):
            raise RobotError(f"link '{name}': its mesh has no points; export it again")
        points = points @ item.placement.rotation.T + item.placement.translation
        far = float(np.abs(points).max() + radii.max())  # NaN stays NaN
        if not (far <= MAX_PART_M and radii.min() >= 0):
            hint = meant(far, "m")
            raise RobotError(
                f"link '{name}': collision geometry is negative, beyond {MAX_PART_M:g} m, or "
                f"not a number; {hint or 'correct it'}"
            )
        size = float(np.linalg.norm(np.ptp(points, axis=0)) + 2 * radii.max())
        if size < MIN_BODY_M:
            raise RobotError(
                f"link '{name}': collision geometry of {size:.2g} m is smaller than "
                f"{MIN_BODY_M:g} m; is the mesh in metres, and its scale right?"
            )
        if name in bodies:
            points = np.vstack([bodies[name].points, points])
            radii = np.concatenate([bodies[name].radii, radii])
        bodies[name] = LinkBody(carriers[item.parentJoint], points, radii)
    covered = {body.carrier for body in bodies.values()}
    bare = [link for link in carriers.values() if link not in covered]
    if bare:
        raise RobotError(
            f"link '{bare[0]}' has no shape, so no distance would be kept from it; add a "
            "<collision>, such as a small sphere for a tiny link"
        )
    return bodies


def _origin(placement: Any, pinocchio: Any, joint: str) -> dict[str, Any]:
    rpy = pinocchio.rpy.matrixToRpy(placement.rotation)
    far = float(np.abs(placement.translation).max())
    if not (np.isfinite(rpy).all() and far <= MAX_PART_M):
        raise RobotError(
            f"joint '{joint}': its origin, with its parents', is beyond {MAX_PART_M:g} m or "
            f"not a number; {meant(far, 'm') or 'correct it'}"
        )
    xyz, rpy = (np.round(v, 12) + 0.0 for v in (placement.translation, rpy))
    return {"origin": {"xyz": xyz.tolist(), "rpy": rpy.tolist()}}


def _axis(joint: ElementTree.Element, name: str) -> list[float]:
    element = joint.find("axis")
    text = "1 0 0" if element is None else element.get("xyz", "1 0 0")  # URDF's default
    axis = np.array([_number(word, f"joint '{name}': axis") for word in text.split()])
    if axis.shape != (3,) or not 1e-6 < np.abs(axis).max() < 1e6:
        raise RobotError(
            f"joint '{name}': axis '{text}' is not a direction; give three numbers, not all zero"
        )
    return [round(float(v), 15) for v in axis / np.linalg.norm(axis)]


def _limits(joint: ElementTree.Element, name: str) -> dict[str, Any]:
    limit = joint.find("limit")
    given = {} if limit is None else limit.attrib
    velocity = _number(given.get("velocity", "0"), f"joint '{name}': velocity")
    slides = joint.get("type") == "prismatic"
    most, unit = (MAX_SLIDE_M_S, "m/s") if slides else (MAX_TURN_RAD_S, "rad/s")
    if not 0 < velocity <= most:
        hint = f"; {meant(velocity, unit)}" if velocity > most else ""
        raise RobotError(
            f"joint '{name}': <limit velocity> must be above 0 (and up to {most:g}) {unit}, "
            f"as the robot's data sheet says; got {velocity:g}{hint}"
        )
    position = [-CONTINUOUS_RAD, CONTINUOUS_RAD]
    if joint.get("type") != "continuous":
        position = [_number(given.get(k, "0"), f"joint '{name}': {k}") for k in ("lower", "upper")]
        far = max(position, key=abs)
        if not slides and abs(far) > MAX_TURN_RAD:
            raise RobotError(
                f"joint '{name}': its limit {far:g} is beyond {MAX_TURN_RAD:g} rad; "
                f"{meant(far, 'rad')}"
            )
    return {"position": position, "velocity": velocity}


def _number(text: str, where: str) -> float:
    return numbers(text, where, 1)[0]


def _spheres(shape: Any, link: str) -> tuple[Floats, Floats]:
    """Return spheres (N, 3), (N,) in the shape's frame; their convex hull contains the shape."""
    kind = type(shape).__name__
    if kind.startswith("BVHModel") or kind == "Convex":
        points = np.array(shape.vertices() if kind.startswith("BVH") else shape.points(), float)
        return points, np.zeros(len(points))
    if kind == "Box":
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        return corners * shape.halfSide, np.zeros(8)
    if kind == "Sphere":
        return np.zeros((1, 3)), np.array([shape.radius])
    if kind == "Capsule":
        return np.array([[0, 0, s * shape.halfLength] for s in (-1, 1)]), np.full(2, shape.radius)
    if kind == "Cylinder":
        angle = np.arange(CIRCLE) * 2 * np.pi / CIRCLE
        radius = shape.radius / np.cos(np.pi / CIRCLE)  # the polygon is around the circle
        circle = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        ends = [np.column_stack([circle, np.full(CIRCLE, s * shape.halfLength)]) for s in (-1, 1)]
        return np.vstack(ends), np.zeros(2 * CIRCLE)
    raise RobotError(f"link '{link}': collision geometry {kind} has an unknown type; use a mesh")


@contextlib.contextmanager
def _kept_quiet() -> Iterator[Callable[[], str]]:
    """Capture the standard error of C++ libraries; yield a function that returns the text."""
    with tempfile.TemporaryFile() as file:
        kept = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:

            def printed() -> str:
                file.seek(0)
                return file.read().decode(errors="replace")

            yield printed
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _reason(printed: str, raised: str) -> str:
    """Return one line of Pinocchio's message, without source file names."""
    lines = [line.strip() for line in printed.splitlines() if line.strip().startswith("Error:")]
    if lines:
        return lines[0].removeprefix("Error:").strip()
    lines = raised.partition("message: ")[2].splitlines() or raised.splitlines() or ["unreadable"]
    return " ".join(line.strip() for line in lines if not line.startswith("Hint"))
