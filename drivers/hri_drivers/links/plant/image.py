"""The register image: what a PLC reads at this moment.

It is computed when it is read. Values that are no longer renewed are therefore *unknown* in the
next reply, whether the node's loop, the link's thread or both hang.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.protocol.fields import MAX_ROBOTS
from hri_predict.protocol.messages import Level
from hri_predict.protocol.registers import (
    NEAREST,
    NODE,
    NOT_AVAILABLE,
    READ_WORDS,
    ROBOT,
    SETS,
    SETS_BASE,
    Register,
    nearest_address,
    offset_of,
    packed,
    placed,
    robot_address,
    words_of,
)

_AGES = ("NODE_AGE", "AGE", "NEAREST_AGE")
_LEVEL_AT = offset_of(ROBOT, "LEVEL")
_MOVING = frozenset(int(level) for level in Level if level.may_move)
_JUDGED = (ROBOT, NEAREST)
"""Blocks that become stale if their capture is old; NODE only shows its age."""


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive big-endian words that start at an address: one unit of the link."""

    address: int
    data: bytes

    @staticmethod
    def of(address: int, words: Sequence[int]) -> "Block":
        """Make one of words."""
        return Block(address, b"".join(word.to_bytes(2, "big") for word in words))

    @property
    def words(self) -> list[int]:
        """The words; an incomplete word at the end is left out."""
        return [
            int.from_bytes(self.data[k : k + 2], "big") for k in range(0, len(self.data) - 1, 2)
        ]


PLACES: dict[int, tuple[Register, ...]] = {
    0: NODE,
    SETS_BASE: SETS,
    **{robot_address(r): ROBOT for r in range(MAX_ROBOTS)},
    **{nearest_address(r): NEAREST for r in range(MAX_ROBOTS)},
}
"""Address -> registers of each block that the node writes."""


class Image:
    """Keeps the newest blocks and their arrival times; thread-safe.

    Args:
        silence_s: a block that is older than this is stale.
        max_age_s: an advice or distance from an older capture is stale.

    Attributes:
        timeouts: number of times that a robot's registers were read as stale although its last
            advice permits motion.
    """

    def __init__(self, silence_s: float, max_age_s: float) -> None:
        self._silence_ns = round(silence_s * 1e9)
        self._max_age_ms = round(max_age_s * 1e3)
        self.timeouts = 0
        self._timed_out: set[int] = set()  # addresses counted, until the next read that is fresh
        self._lock = threading.Lock()
        self._blocks: dict[int, tuple[list[int], int]] = {}

    def put(self, block: Block, now_ns: int) -> None:
        """Replace the block at this address; a block that does not fit the map is ignored."""
        words, registers = block.words, PLACES.get(block.address)
        if registers is not None and len(words) == words_of(registers):
            with self._lock:
                self._blocks[block.address] = (words, now_ns)

    def forget(self) -> None:
        """Make everything stale."""
        with self._lock:
            self._blocks.clear()

    def words(self, now_ns: int) -> list[int]:
        """Return all ``READ_WORDS`` words."""
        image = [0] * READ_WORDS
        for address, (words, _) in self.blocks(now_ns).items():
            image[address : address + len(words)] = words
        return image

    def blocks(self, now_ns: int) -> dict[int, tuple[list[int], bool]]:
        """Return address -> current words, and whether they are stale."""
        with self._lock:
            blocks = dict(self._blocks)
        found = {}
        for address, registers in PLACES.items():
            words, came_ns = blocks.get(address, (packed(registers, {}), None))
            if address == 0 and came_ns is None:
                words[0] = 0  # not even the map's version, before the first Status
            found[address] = self._aged(registers, words, came_ns, now_ns)
            if registers is ROBOT and came_ns is not None:
                self._count(address, words[_LEVEL_AT] in _MOVING, found[address][1])
        return found

    def _count(self, address: int, may_move: bool, stale: bool) -> None:
        """Count a timeout of a robot's advice once, until it is read fresh again."""
        if not stale:
            self._timed_out.discard(address)
        elif may_move and address not in self._timed_out:
            self._timed_out.add(address)
            self.timeouts += 1

    def _aged(
        self,
        registers: tuple[Register, ...],
        words: list[int],
        came_ns: int | None,
        now_ns: int,
    ) -> tuple[list[int], bool]:
        """Return the words with their current ages, or stale words if they are too old."""
        words = list(words)
        since_ns = self._silence_ns if came_ns is None else max(0, now_ns - came_ns)
        stale = since_ns >= self._silence_ns
        for at, register in placed(registers):
            if register.name in _AGES and words[at] != NOT_AVAILABLE:
                words[at] = min(words[at] + since_ns // 1_000_000, NOT_AVAILABLE - 1)
            old = register.name in _AGES and words[at] >= self._max_age_ms
            stale = stale or (old and registers in _JUDGED)
        if stale:
            for at, register in placed(registers):
                if register.stale is not None:
                    words[at : at + register.words] = packed((register,), {})
        return words, stale
