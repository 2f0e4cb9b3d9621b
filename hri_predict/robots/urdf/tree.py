"""Read the part of a URDF for a robot file, as untrusted input.

A URDF comes from a third party: its XML is refused if it declares entities (which can grow without
bound or refer to other files), nothing is fetched from a network, and every mesh must be a local
file. The result is a URDF with only links, joints and collision geometry, with absolute mesh paths,
for a URDF library. Specification: wiki.ros.org/urdf/XML (joint, link).
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from hri_predict.base.errors import RobotError, nearest
from hri_predict.base.files import read_text
from hri_predict.base.quantities.units import meant
from hri_predict.robots.file import MAX_JOINTS, MAX_PART_M
from hri_predict.robots.urdf.reading import (
    EXPAND,
    check_expanded,
    check_known,
    check_numbers,
    numbers,
)

MAX_LINKS = 1000
MAX_MESH_BYTES = 100_000_000
MIN_SIZE_M = 1e-4
"""Minimum side of a shape, about a film of paint; a smaller value suggests a wrong unit."""
MESHES = (".stl", ".obj", ".dae")  # the first two have no units of their own: metres
MOVING = ("revolute", "continuous", "prismatic")
SIZES = {  # number of numbers of each
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}


@dataclass(frozen=True, slots=True)
class UrdfChain:
    """Parts attached to the base link: one chain of moving joints, and links rigidly fixed to it.

    Attributes:
        name: name of the robot.
        joints: the moving joints' elements, from the base outwards.
        text: a URDF of these links and joints with collision geometry only; a link without
            collision geometry gets its visual geometry.
        omitted: links with a shape that are not in the text: left out, or not beyond the base.
        unread: extensions of URDF for other programs, with their number.
    """

    name: str
    joints: list[ElementTree.Element]
    text: str
    omitted: list[str]
    unread: list[str]


class _Plain(ElementTree.TreeBuilder):
    """Builds XML without a document type, because only a document type can declare entities."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise RobotError("it has a DOCTYPE, which no URDF needs and which can hide an attack")


def read_chain(
    path: Path, base: str, tip: str, *, left_out: list[str], packages: list[Path]
) -> UrdfChain:
    """Read the chain from ``base`` to ``tip`` and everything fixed to it.

    Args:
        path: the URDF file.
        base: link that does not move in the room.
        tip: link moved by the last moving joint, or a link fixed to it.
        left_out: links to drop, with everything beyond them.
        packages: folders to look for ``package://NAME/...`` in, besides the URDF's own parents.

    Raises:
        ConfigError: the file cannot be read.
        RobotError: one line that names the file, the link, joint or mesh, and the remedy.
    """
    text = read_text(path, "URDF file")
    try:
        return _chain(_parse(text), path, base=base, tip=tip, left_out=left_out, packages=packages)
    except RobotError as error:
        raise RobotError(f"URDF file {path}: {error}") from None
    except RecursionError:
        raise RobotError(f"URDF file {path}: its elements are nested too deeply") from None


def _chain(
    root: ElementTree.Element,
    path: Path,
    *,
    base: str,
    tip: str,
    left_out: list[str],
    packages: list[Path],
) -> UrdfChain:
    check_expanded(root)
    unread = check_known(root)
    links = _by_name(root.findall("link"))
    _by_name(root.findall("joint"))
    if not 0 < len(links) <= MAX_LINKS:
        raise RobotError(f"it has {len(links)} links; a robot has 1 to {MAX_LINKS}")
    for link in (base, tip, *left_out):
        if link not in links:
            raise RobotError(f"there is no link '{link}'{nearest(link, links)}")
    above = _joints_by_child(root, links)
    way = list(reversed(_way_up(tip, above, base)))
    on_way = [link for link in left_out if link in way]
    if on_way:
        raise RobotError(f"--leave-out {on_way[0]}: the chain from '{base}' to '{tip}' needs it")
    dropped = set(left_out)
    kept = [
        link for link in links if base in (up := _way_up(link, above)) and not dropped & set(up)
    ]
    _check_base(base, above)
    moving = [above[link] for link in way[1:] if above[link].get("type") != "fixed"]
    _check_moving(moving, base, tip)
    slim = ElementTree.Element("robot", name=root.get("name") or "robot")
    for link in kept:
        if link != base:
            joint = above[link]
            if joint.get("type") != "fixed" and joint not in moving:
                raise RobotError(
                    f"joint '{_name(joint)}' moves link '{link}', which is not between '{base}' "
                    f"and '{tip}'; a robot file has one chain: --leave-out {link} and describe it "
                    f"under tool: by hand, or make the joint fixed"
                )
            check_numbers(joint, f"joint '{_name(joint)}'")
            slim.append(joint)
        slim.append(_shaped(links[link], path, packages))
    omitted = [link for link in links if link not in kept and _has_shape(links[link])]
    text = ElementTree.tostring(slim, encoding="unicode")
    return UrdfChain(slim.get("name", ""), moving, text, omitted, unread)


def _parse(text: str) -> ElementTree.Element:
    parser = ElementTree.XMLParser(target=_Plain())
    try:
        parser.feed(text)
        root = parser.close()
    except ElementTree.ParseError as error:
        remedy = EXPAND if "<xacro:" in text else "correct it there"
        raise RobotError(f"not valid XML ({error}); {remedy}") from None
    if root.tag != "robot":
        raise RobotError(
            f"its outermost element is <{root.tag}>, not <robot>; if it is a xacro file, {EXPAND}"
        )
    return root


def _name(element: ElementTree.Element) -> str:
    name = element.get("name")
    if not name:
        raise RobotError(f"a <{element.tag}> has no name; give it one")
    return name


def _by_name(elements: list[ElementTree.Element]) -> dict[str, ElementTree.Element]:
    named: dict[str, ElementTree.Element] = {}
    for element in elements:
        name = _name(element)
        if name in named:
            raise RobotError(f"there are two <{element.tag}> named '{name}'; rename one")
        named[name] = element
    return named


def _joints_by_child(
    root: ElementTree.Element, links: dict[str, ElementTree.Element]
) -> dict[str, ElementTree.Element]:
    """Return the joint above each link except the first."""
    above: dict[str, ElementTree.Element] = {}
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            link = _end(joint, end)
            if link not in links:
                raise RobotError(
                    f"joint '{_name(joint)}': its {end} link '{link}' does not exist"
                    f"{nearest(link, links)}"
                )
        child = _end(joint, "child")
        if child in above:
            raise RobotError(
                f"link '{child}' is the child of joints '{_name(above[child])}' and "
                f"'{_name(joint)}'; a link has one parent joint: remove the other"
            )
        above[child] = joint
    return above


def _end(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _way_up(link: str, above: dict[str, ElementTree.Element], base: str | None = None) -> list[str]:
    """Return the links from ``link`` up to ``base``, or up to the topmost link."""
    way = [link]
    while way[-1] in above and way[-1] != base:
        way.append(_end(above[way[-1]], "parent"))
        if len(way) > len(above) + 1:
            raise RobotError(f"the joints above link '{link}' form a loop; a URDF is a tree")
    if base is not None and way[-1] != base:
        raise RobotError(
            f"link '{link}' is not attached to '{base}', but to '{way[-1]}'; "
            f"give --base and --tip in this order, from the floor to the hand"
        )
    return way


def _check_base(base: str, above: dict[str, ElementTree.Element]) -> None:
    """Refuse a base that a joint above it moves: the robot file would leave out that motion."""
    for link in _way_up(base, above):
        joint = above.get(link)
        if joint is not None and joint.get("type") != "fixed":
            raise RobotError(
                f"joint '{_name(joint)}' moves '{base}': start above it, with --base "
                f"{_end(joint, 'parent')}, or make the joint fixed where it will stand"
            )


def _check_moving(joints: list[ElementTree.Element], base: str, tip: str) -> None:
    for joint in joints:
        name, kind = _name(joint), joint.get("type", "")
        if kind not in MOVING:
            raise RobotError(
                f"joint '{name}' is of type '{kind}'; only {', '.join(MOVING)} joints can be "
                f"described: choose a --base beyond it, or make it fixed where it will stand"
            )
        if joint.find("mimic") is not None:
            raise RobotError(
                f"joint '{name}' mimics another, which a robot file cannot say; make it fixed, "
                f"or drop <mimic> if the controller reports its position, too"
            )
    if not 1 <= len(joints) <= MAX_JOINTS:
        raise RobotError(
            f"{len(joints)} joints move between '{base}' and '{tip}'; RobotState carries 1 to "
            f"{MAX_JOINTS}: choose another --base or --tip"
        )


def _shaped(link: ElementTree.Element, urdf: Path, packages: list[Path]) -> ElementTree.Element:
    """Return the link with collision geometry only, taken from visual geometry if missing."""
    slim = ElementTree.Element("link", name=_name(link))
    for shape in link.findall("collision") or link.findall("visual"):
        collision = ElementTree.SubElement(slim, "collision")
        collision.extend(part for part in shape if part.tag in ("origin", "geometry"))
        if [len(part) for part in shape.findall("geometry")] != [1]:
            raise RobotError(
                f"link '{_name(link)}': a <{shape.tag}> must have one <geometry> with one shape; "
                f"split it"
            )
    _check_sizes(slim)
    check_numbers(slim, f"link '{_name(link)}'")
    for mesh in slim.iter("mesh"):
        try:
            mesh.set("filename", str(_mesh(mesh.get("filename", ""), urdf, packages)))
        except RobotError as error:
            raise RobotError(f"link '{_name(link)}': {error}") from None
    return slim


def _check_sizes(link: ElementTree.Element) -> None:
    """Refuse shapes with zero or negative size, from which the robot would keep no distance."""
    for kind, names in SIZES.items():
        for shape, name in ((shape, name) for shape in link.iter(kind) for name in names):
            where = f"link '{_name(link)}': the {name} of a <{kind}>"
            for value in numbers(shape.get(name, ""), where, names[name]):
                if not MIN_SIZE_M <= value <= MAX_PART_M:
                    hint = f"; {meant(value, 'm')}" if value > MAX_PART_M else ""
                    raise RobotError(
                        f"{where} must be {MIN_SIZE_M:g} to {MAX_PART_M:g} m; got {value:g}{hint}"
                    )


def _has_shape(link: ElementTree.Element) -> bool:
    return link.find("visual") is not None or link.find("collision") is not None


def _mesh(filename: str, urdf: Path, packages: list[Path]) -> Path:
    """Return the mesh file on this machine."""
    scheme, _, rest = filename.rpartition("://")
    if scheme not in ("", "file", "package"):
        raise RobotError(f"mesh '{filename}' is not a file; nothing is fetched: download it")
    if Path(filename).suffix.lower() not in MESHES:
        raise RobotError(f"mesh '{filename}': only {', '.join(MESHES)} are read; convert it")
    if scheme == "package":
        package, _, inside = rest.partition("/")
        parents = urdf.resolve().parents
        folders = [p / package for p in packages] + [p for p in packages if p.name == package]
        folders += [p for p in parents if p.name == package] + [p / package for p in parents]
        places = [folder / inside for folder in folders]
        hint = f"; give --package-dir the folder that '{package}' is in"
    else:
        places, hint = [urdf.resolve().parent / rest], "; check its path in the URDF"
    path = next((p for p in places if os.path.isfile(p)), None)
    if path is None:
        raise RobotError(f"mesh '{filename}' is not there{hint}")
    if path.stat().st_size > MAX_MESH_BYTES:
        raise RobotError(f"mesh '{filename}' is larger than {MAX_MESH_BYTES} bytes; simplify it")
    unit = _unit(path)
    if unit != "1" and path.suffix.lower() == ".dae":
        raise RobotError(f"mesh '{filename}' has a unit of {unit} m; export it in metres")
    return path.resolve()


def _unit(path: Path) -> str:
    """Return the unit in a COLLADA file's <asset>, which the mesh loader ignores."""
    with path.open("rb") as file:
        head = file.read(65_536).decode(errors="replace")
    found = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)", head)
    try:
        return f"{float(found[1]):g}" if found else "1"  # the schema's default
    except ValueError:
        return "unknown"
