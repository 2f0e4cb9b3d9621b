"""Attacks drawn at random against the whole node: ``python -m tests.attacks --count 200``.

From the checkout's root, with the developers' packages. A line for each attack that ends in a touch
by a moving robot or in *clear* beside a person, and for each control after which the robot stands;
then a table of all kinds. Ends with status 1 if there is such a line.
"""

import argparse
import itertools
import logging
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from tests.attacks.kinds import KINDS
from tests.attacks.play import Outcome, play

MODES = ("predictive", "iso", "fixed")


def attack(kind: str, seed: int, index: int, mode: str) -> tuple[str, Outcome]:
    """Draw and play one attack; return its name and what came of it."""
    logging.disable(logging.CRITICAL)
    drawn = KINDS[kind](np.random.default_rng([seed, index]))
    return drawn.name, play(drawn, mode)


def main() -> int:
    """Run; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.attacks", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="number of attacks")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="kinds whose name contains this")
    parser.add_argument("--mode", choices=MODES, help="default: one after another")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    asked = parser.parse_args()
    kinds = [kind for kind in KINDS if asked.only in kind]
    if not kinds:
        print(f"error: --only {asked.only}: no kind's name contains this", file=sys.stderr)
        return 2
    drawn = [
        (kind, asked.seed, index, asked.mode or MODES[(index + index // len(kinds)) % 3])
        for index, kind in zip(range(asked.count), itertools.cycle(kinds), strict=False)
    ]
    played, bad, contacts = Counter[str](), Counter[str](), 0
    with ProcessPoolExecutor(asked.jobs) as pool:
        for (kind, _, index, mode), (name, outcome) in zip(
            drawn, pool.map(attack, *zip(*drawn, strict=True)), strict=True
        ):
            played[kind] += 1
            contacts += outcome.contacts
            if not outcome.fine:
                bad[kind] += 1
                print(
                    f"{kind} {index} ({mode}): {outcome.contacts} contacts, "
                    f"{outcome.clear_near} ticks of clear nearby, stood {outcome.stood}: {name}",
                    flush=True,
                )
    for kind in kinds:
        print(f"{kind:34} {played[kind]:4} played, {bad[kind]:4} wrong")
    print(f"{sum(played.values())} attacks, {sum(bad.values())} wrong, {contacts} contacts")
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
