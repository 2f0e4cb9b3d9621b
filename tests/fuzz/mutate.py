"""Inputs from seeds: bits flipped, bytes changed, cut, doubled, joined, or nothing but chance."""

import random
from collections.abc import Sequence

INTERESTING = (
    b"\0",
    b"\xff",
    b"\x7f",
    b"\x80",
    b"\xff\xff",
    b"\0\0\xc0\x7f",
    b"\0\0\x80\x7f",
    b"1e999",
)
"""Ends of ranges, a NaN, an infinity, and a number that is none."""
LONGEST = 3000


def mutated(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One input: a seed after one to four changes, or now and then bytes by chance alone."""
    if rng.random() < 0.05:
        return rng.randbytes(rng.choice((0, 1, 8, 64, 71, 73, 200, 1400)))
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 4))):
        _change(rng, data, seeds)
    return bytes(data[:LONGEST])


def _change(rng: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    at = rng.randrange(len(data)) if data else 0
    match rng.randrange(8):
        case 0 if data:
            data[at] ^= 1 << rng.randrange(8)
        case 1 if data:
            data[at] = rng.randrange(256)
        case 2:
            data[at : at + rng.choice((1, 2, 4))] = rng.choice(INTERESTING)
        case 3:
            del data[at:]
        case 4:
            del data[at : at + rng.randrange(1, 9)]
        case 5:
            data[at:at] = rng.randbytes(rng.randrange(1, 9))
        case 6:
            data[at:at] = data[at : at + rng.randrange(1, 65)]
        case 7:
            other = rng.choice(seeds)
            data[at:] = other[rng.randrange(len(other) + 1) :]
