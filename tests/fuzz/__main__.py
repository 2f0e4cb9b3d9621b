"""All decoders under mutated, truncated and random bytes: ``python -m tests.fuzz``.

From the checkout's root, with the developers' packages. A line for each decoder; ends with status 1
at the first that breaks, with the input in hexadecimal.
"""

import argparse
import logging
import sys

from tests.fuzz.run import Broken, fuzz
from tests.fuzz.targets import targets

GROWTH_MIB = 8.0  # Python's own pools move by as much


def main() -> int:
    """Run; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000, help="for each decoder")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="decoders whose name contains this")
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)
    chosen = [target for target in targets() if asked.only in target.name]
    if not chosen:
        print(f"error: --only {asked.only}: no decoder's name contains this", file=sys.stderr)
        return 2
    total = 0
    for target in chosen:
        try:
            done = fuzz(target, asked.inputs, asked.seed)
        except Broken as broken:
            print(f"BROKEN {broken}", file=sys.stderr)
            return 1
        total += done.inputs
        fine = done.growth_mib <= GROWTH_MIB
        print(
            f"{'ok  ' if fine else 'GREW'} {done.name:18} {done.inputs:>10} inputs "
            f"{done.seconds:7.1f} s  memory {done.growth_mib:+.1f} MiB",
            flush=True,
        )
        if not fine:
            return 1
    print(f"{total} inputs, no crash, no hang, memory flat")
    return 0


if __name__ == "__main__":
    sys.exit(main())
