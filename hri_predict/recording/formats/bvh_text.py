"""The text of a BVH file: its hierarchy, and one row of numbers for each frame.

A value in the wrong column would turn another joint. So channels are identified by name, and a file
is rejected if a row does not have one value per channel.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import HriPredictError
from hri_predict.recording.bounded import MAX_BYTES, READING, watched
from hri_predict.recording.formats.cells import Numbers

CHANNEL = re.compile(r"([xyz])(position|rotation)", re.IGNORECASE)
_SCALE = re.compile(r"([xyz])?_?scale", re.IGNORECASE)
_HEADER = re.compile(r"(frames|frame\s+time)\s*:?\s*(\S*)", re.IGNORECASE)


class BvhError(HriPredictError):
    """Not a valid BVH file; the message gives place and cause, without the file's name."""


@dataclass
class BvhNode:
    """A joint or an End Site.

    Attributes:
        name: as in the file, with its spaces; ``<joint>_End`` for an End Site.
        parent: index of the joint that carries it; -1 for a root.
        offset: (3,) from its parent; every node of a valid file has one.
        channels: names of its channels, in the order of their columns.
        column: column of the first channel.
    """

    name: str
    parent: int
    offset: tuple[float, ...] = ()
    channels: list[str] = field(default_factory=list)
    column: int = 0


@dataclass(eq=False)
class Bvh:
    """A file's content.

    Attributes:
        nodes: joints and End Sites; each after its parent.
        frame_time_s: seconds from frame to frame.
        values: (F, channels), degrees and the file's own unit.
        notes: notes for the user.
    """

    nodes: list[BvhNode]
    frame_time_s: float
    values: Floats
    notes: list[str]


def parse_bvh(text: str) -> Bvh:
    """Read the text of a file.

    Raises:
        BvhError: it is not BVH, or truncated, or a row has too many or too few values.
    """
    lines = [line for line in enumerate(text.split("\n"), start=1) if line[1].strip()]
    if not lines or lines[0][1].split()[0].upper() != "HIERARCHY":
        raise BvhError("not a BVH file; it must begin with HIERARCHY")
    motion = next((k for k, (_, line) in enumerate(lines) if line.strip().upper() == "MOTION"), 0)
    if not motion:
        raise BvhError("truncated (no MOTION part); export it again")
    numbers = Numbers(text)
    nodes = _hierarchy(lines[1:motion], numbers)
    promised, frame_time_s = _header([line for _, line in lines[motion + 1 : motion + 3]], numbers)
    channels = sum(len(node.channels) for node in nodes)
    values = _values(lines[motion + 3 :], channels, numbers)
    notes = []
    if promised != len(values):
        notes.append(
            f"'Frames:' is {promised}, but there are {len(values)} frames: all of them are read"
        )
    return Bvh(nodes, frame_time_s, values, [*notes, *_without_scale(nodes, values)])


def _hierarchy(lines: list[tuple[int, str]], numbers: Numbers) -> list[BvhNode]:
    nodes: list[BvhNode] = []
    path: list[int] = []  # of the joints whose braces are open
    opened, columns = False, 0
    for number, word, rest in _statements(lines):
        if word in ("ROOT", "JOINT", "END"):
            if (word == "ROOT") == bool(path) or (nodes and not opened and path):
                raise BvhError(f"line {number}: {word} is out of place; export it again")
            if word != "END" and not rest:
                raise BvhError(f"line {number}: {word} has no name; export it again")
            parent = path[-1] if path else -1
            nodes.append(_end_site(parent, nodes) if word == "END" else BvhNode(rest, parent))
            opened = False
        elif word == "{" and nodes and not opened:
            path.append(len(nodes) - 1)
            opened = True
        elif word == "}" and path:
            path.pop()
            opened = True
        elif word in ("OFFSET", "CHANNELS") and path and _given(nodes[path[-1]], word):
            raise BvhError(
                f"line {number}: '{nodes[path[-1]].name}' has a second {word}; export it again"
            )
        elif word == "OFFSET" and path:
            nodes[path[-1]].offset = _offset(number, nodes[path[-1]].name, rest, numbers)
        elif word == "CHANNELS" and path:
            node = nodes[path[-1]]
            node.channels, node.column = _channels(number, node.name, rest), columns
            columns += len(node.channels)
        else:
            raise BvhError(f"line {number}: '{word[:20]}' is not expected here; export it again")
    if path or not nodes or not opened:
        raise BvhError("truncated: its hierarchy does not end before MOTION; export it again")
    bare = next((node.name for node in nodes if not node.offset), None)
    if bare is not None:
        raise BvhError(f"'{bare}' has no OFFSET; export it again")
    return nodes


def _given(node: BvhNode, word: str) -> bool:
    return bool(node.offset if word == "OFFSET" else node.channels)


def _statements(lines: list[tuple[int, str]]) -> Iterator[tuple[int, str, str]]:
    """Line number, first word in capitals, and the rest; braces stand alone."""
    for number, line in lines:
        text = line.strip()
        ends = text.endswith("{") and text != "{"
        word, _, rest = (text[:-1].strip() if ends else text).partition(" ")
        if "\t" in word:
            word, _, tail = word.partition("\t")
            rest = f"{tail} {rest}"
        yield number, word.upper(), rest.strip()
        if ends:
            yield number, "{", ""


def _end_site(parent: int, nodes: list[BvhNode]) -> BvhNode:
    taken = sum(node.parent == parent and node.name.endswith("_End") for node in nodes)
    return BvhNode(f"{nodes[parent].name}_End{taken + 1 if taken else ''}", parent)


def _offset(number: int, name: str, rest: str, numbers: Numbers) -> tuple[float, ...]:
    try:
        offset = tuple(numbers.read(cell) for cell in rest.split())
    except ValueError as error:
        raise BvhError(f"line {number}: OFFSET of '{name}': {rest[:40]!r} {error}") from None
    if len(offset) != 3:
        raise BvhError(f"line {number}: OFFSET of '{name}' has {len(offset)} numbers; expected 3")
    return offset


def _channels(number: int, name: str, rest: str) -> list[str]:
    count, *channels = rest.split() or [""]
    if count != str(len(channels)):
        raise BvhError(
            f"line {number}: CHANNELS of '{name}': {len(channels)} names, but the number "
            f"{count[:20]!r}; export it again"
        )
    for channel in channels:
        if not (CHANNEL.fullmatch(channel) or _SCALE.fullmatch(channel)):
            raise BvhError(
                f"line {number}: joint '{name}' has an unknown channel '{channel[:40]}'; export "
                f"it with positions and rotations only"
            )
    if len({channel.lower() for channel in channels}) < len(channels):
        raise BvhError(f"line {number}: a channel of '{name}' is there twice; export it again")
    return channels


def _header(lines: list[str], numbers: Numbers) -> tuple[int, float]:
    """Return the number of frames and the interval between them in seconds, as stated."""
    found: dict[str, str] = {}
    for line in lines:
        if match := _HEADER.fullmatch(line.strip()):
            found[" ".join(match[1].lower().split())] = match[2]
    for key, what in (("frames", "Frames:"), ("frame time", "Frame Time:")):
        if key not in found:
            raise BvhError(f"truncated (no '{what}' line); export it again")
    try:
        promised = int(found["frames"])
    except ValueError:
        raise BvhError(
            f"'Frames:' is {found['frames'][:20]!r}; expected their number; correct it"
        ) from None
    try:
        time_s = numbers.read(found["frame time"])
    except ValueError as error:
        raise BvhError(f"'Frame Time' is {found['frame time'][:20]!r}, which {error}") from None
    if not 0 < time_s < float("inf"):
        raise BvhError(
            f"'Frame Time' is {found['frame time'][:20] or 'missing'}; it must be above 0 s; "
            f"correct the file"
        )
    return promised, time_s


def _values(rows: list[tuple[int, str]], channels: int, numbers: Numbers) -> Floats:
    if not rows:
        raise BvhError("is empty (no frames); choose another")
    if len(rows) * channels * 8 > MAX_BYTES:
        raise BvhError(f"{len(rows)} frames of {channels} values are too many; cut it into parts")
    values = np.empty((len(rows), channels))
    for k, (number, row) in enumerate(watched(rows, READING, len(rows))):
        cells = row.split()
        if len(cells) != channels:
            cut = "truncated: " if k == len(rows) - 1 and len(cells) < channels else ""
            raise BvhError(
                f"{cut}line {number}: frame {k + 1} has {len(cells)} values for {channels} "
                f"channels; export it again"
            )
        try:
            values[k] = cells
            plain = "_" not in row  # NumPy, too, reads 1_0 as 10
        except ValueError:
            plain = False
        if not plain:
            values[k] = [_value(number, k + 1, cell, numbers) for cell in cells]
    return values


def _value(number: int, frame: int, cell: str, numbers: Numbers) -> float:
    try:
        return numbers.read(cell)
    except ValueError as error:
        raise BvhError(f"line {number}: frame {frame}: {cell[:20]!r} {error}") from None


def _without_scale(nodes: list[BvhNode], values: Floats) -> list[str]:
    """Return a note on scale channels, which have no effect if all values are 1.

    Raises:
        BvhError: a scale is not 1, so bone lengths differ from the file's offsets.
    """
    scaled = [
        (node.name, channel, values[:, node.column + k])
        for node in nodes
        for k, channel in enumerate(node.channels)
        if _SCALE.fullmatch(channel)
    ]
    for name, channel, column in scaled:
        if not np.allclose(column, 1.0, rtol=0, atol=1e-4):
            raise BvhError(
                f"joint '{name}' is scaled by channel '{channel}' ({column.min():g} to "
                f"{column.max():g}); export it without scale"
            )
    names = list(dict.fromkeys(f"'{name}'" for name, _, _ in scaled))
    return [f"scale channels are skipped, all are 1: {', '.join(names[:8])}"] if names else []
