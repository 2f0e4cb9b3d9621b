"""Allowed content of a URDF; other content would be ignored, so it is refused or reported.

A URDF library skips unknown content. So a part to be inserted by xacro, a misspelt element or an
attribute of another dialect would silently be missing from the robot.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from xml.etree import ElementTree

from hri_predict.base.errors import RobotError, nearest
from hri_predict.base.quantities.units import meant
from hri_predict.base.settings import MAX_ANGLE_RAD
from hri_predict.robots.file import MAX_PART_M

EXPAND = "expand it first: xacro robot.urdf.xacro > robot.urdf"
SHAPES = ("box", "sphere", "cylinder", "capsule", "mesh")
CHILDREN = {
    "robot": "link joint material transmission gazebo ros2_control sensor verbose",
    "link": "inertial visual collision sensor contact self_collision_checking verbose gravity",
    "joint": "parent child origin axis limit dynamics calibration mimic safety_controller "
    "hardwareInterface",
    "collision": "origin geometry material verbose",
    "visual": "origin geometry material",
    "geometry": " ".join(SHAPES),
    "origin": "", "axis": "", "limit": "", "parent": "", "child": "",
    "box": "", "sphere": "", "cylinder": "", "capsule": "", "mesh": "",
}  # fmt: skip
ATTRIBUTES = {
    "origin": "xyz rpy",
    "axis": "xyz",
    "limit": "lower upper velocity effort acceleration deceleration jerk",
    "parent": "link",
    "child": "link",
    "box": "size",
    "sphere": "radius",
    "cylinder": "radius length",
    "capsule": "radius length",
    "mesh": "filename scale",
}
ONCE = ("origin", "axis", "limit", "parent", "child", "mimic")
_PLACEHOLDER = re.compile(r"\$[({]|\{\{|@\w+@")
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
MIN_SCALE, MAX_SCALE = 1e-4, 100.0
"""Scale of a mesh: 0.001 is usual for millimetres, 0.0254 for inches."""


def check_expanded(root: ElementTree.Element) -> None:
    """Refuse unexpanded content of xacro or another template.

    Raises:
        RobotError: one line that names it.
    """
    for element in root.iter():
        if "/xacro" in element.tag or element.tag.startswith("xacro"):
            raise RobotError(f"<xacro:{element.tag.rpartition('}')[2]}> is left in it; {EXPAND}")
    parts = [root, *(e for part in root if part.tag in ("link", "joint") for e in part.iter())]
    for element in parts:
        for text in (*element.attrib.values(), element.text or ""):
            if _PLACEHOLDER.search(text):
                raise RobotError(
                    f"'{text.strip()}' in <{element.tag}> is a placeholder of xacro or another "
                    f"template; {EXPAND}"
                )


def check_known(root: ElementTree.Element) -> list[str]:
    """Refuse unknown content of links and joints; return the names of other extensions.

    Elements with a namespace extend URDF for other programs; they are returned, too.

    Raises:
        RobotError: one line that names the element or attribute, its place, and the remedy.
    """
    unread = Counter(_unknown(root, "the robot"))
    for part in root:
        if part.tag in ("link", "joint"):
            where = f"{part.tag} '{part.get('name', '')}'"
            for element in _read(part):
                unread.update(_unknown(element, where))
                _check_attributes(element, where)
    return [f"{name} ({count})" for name, count in sorted(unread.items())]


def _read(part: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Return the elements within a link or joint that have known content."""
    waiting = [part]
    while waiting:
        element = waiting.pop()
        yield element
        waiting += [child for child in element if child.tag in CHILDREN]


def _unknown(element: ElementTree.Element, where: str) -> Iterable[str]:
    """Return the names of the extensions in ``element``."""
    known = CHILDREN[element.tag].split()
    if (element.text or "").strip() or any((child.tail or "").strip() for child in element):
        raise RobotError(f"{where}: text in <{element.tag}> is not read; use URDF's attributes")
    found = []
    for child in element:
        if not isinstance(child.tag, str) or child.tag in known:
            continue
        namespace, closed, name = child.tag.rpartition("}")
        if closed and element.tag != "geometry":
            found.append(f"<{name}> of {namespace[1:]}")
            continue
        raise RobotError(
            f"{where}: <{element.tag}> has <{name}>, which is not part of URDF and would be "
            f"ignored{nearest(name, known)}; correct it, or remove it if it is not a part of the "
            "robot"
        )
    for name in ONCE:
        if len(element.findall(name)) > 1:
            raise RobotError(f"{where}: <{element.tag}> has two <{name}>; remove one")
    return found


def _check_attributes(element: ElementTree.Element, where: str) -> None:
    if element.tag not in ATTRIBUTES:
        return
    known = ATTRIBUTES[element.tag].split()
    for name in element.attrib:
        if name not in known and "}" not in name:
            raise RobotError(
                f"{where}: <{element.tag}> has the attribute '{name}', which is not read"
                f"{nearest(name, known)}; it may have: {', '.join(known)}"
            )


def check_numbers(part: ElementTree.Element, where: str) -> None:
    """Check that every origin and mesh scale in a link or joint has three plausible numbers.

    Raises:
        RobotError: one line that names the part, the value and the expected unit.
    """
    for origin in part.iter("origin"):
        for name, most, unit in (("xyz", MAX_PART_M, "m"), ("rpy", MAX_ANGLE_RAD, "rad")):
            for value in numbers(origin.get(name, "0 0 0"), f"{where}: origin's {name}", 3):
                if abs(value) > most * (1 + 1e-6):  # 2 pi with few digits
                    raise RobotError(
                        f"{where}: origin's {name} {value:g} is beyond {most:.4g} {unit}; "
                        f"{meant(value, unit) or 'correct it'}"
                    )
    for mesh in part.iter("mesh"):
        for value in numbers(mesh.get("scale", "1 1 1"), f"{where}: a mesh's scale", 3):
            if not MIN_SCALE <= abs(value) <= MAX_SCALE:
                raise RobotError(
                    f"{where}: a mesh's scale {value:g} would make it vanish or fill the hall; "
                    f"give {MIN_SCALE:g} to {MAX_SCALE:g}, such as 0.001 for millimetres"
                )


def numbers(text: str, where: str, count: int) -> list[float]:
    """Return ``count`` finite numbers separated by blanks.

    Raises:
        RobotError: the numbers are missing or invalid; starts with ``where``.
    """
    words = text.split()
    if len(words) != count:
        raise RobotError(f"{where} '{text}' has {len(words)} numbers, not {count}; correct it")
    for word in words:
        if not _NUMBER.fullmatch(word) or not math.isfinite(float(word)):
            raise RobotError(f"{where} '{text}': {word} is not a finite number; correct it")
    return [float(word) for word in words]
