"""Affix that a tracker adds to the names of all joints: ``K4ABT_JOINT_``, ``Bob_``.

It ends (or begins) at a separator and is shared by nearly all names: a file may hold a root or a
tool besides. A side of the body does not count: of a file with left joints alone, all names may
begin with ``Left_``.
"""

import re
from collections import Counter
from collections.abc import Sequence

SHARE = 0.75
"""Share of the names that must be exceeded by those with the affix."""
_SEPARATORS = re.compile(r"[ _.:|-]+")
_SIDES = ("left", "right", "l", "r")


def without_shared(names: Sequence[str]) -> list[str]:
    """Return the names without their shared affix; unchanged if two would become equal."""
    before = _longest(names, [_heads(name) for name in names])
    rest = [name.removeprefix(before) for name in names]
    after = _longest(rest, [_tails(name) for name in rest])
    bare = [name.removesuffix(after) for name in rest]
    return bare if len(set(bare)) == len(set(names)) else list(names)


def _longest(names: Sequence[str], parts: Sequence[Sequence[str]]) -> str:
    """Return the longest part shared by enough names; "" if there is none."""
    count = Counter(part for own in parts for part in own)
    shared = [part for part, times in count.items() if times > max(1.0, SHARE * len(names))]
    return max(shared, key=len, default="")


def _heads(name: str) -> list[str]:
    """Each beginning of a name that a separator ends, unless its last word is a side."""
    ends = [(name[: gap.start()], name[: gap.end()]) for gap in _SEPARATORS.finditer(name)]
    return [
        head
        for words, head in ends
        if head != name and _SEPARATORS.split(words.lower())[-1] not in _SIDES
    ]


def _tails(name: str) -> list[str]:
    """Each end of a name that a separator begins, unless its first word is a side."""
    starts = [(name[gap.end() :], name[gap.start() :]) for gap in _SEPARATORS.finditer(name)]
    return [
        tail
        for words, tail in starts
        if tail != name and _SEPARATORS.split(words.lower())[0] not in _SIDES
    ]
