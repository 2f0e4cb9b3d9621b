"""Feeds decoders; what fails names the input that did it."""

import faulthandler
import random
import resource
import time
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.mutate import mutated
from tests.fuzz.targets import Target

HANG_S = 60.0  # ten thousand inputs never take so long
BATCH = 10_000


class Broken(Exception):
    """A decoder did not survive an input."""


@dataclass(frozen=True)
class Survived:
    """What a decoder survived; memory from after the first tenth to the end."""

    name: str
    inputs: int
    seconds: float
    growth_mib: float


def fuzz(target: Target, inputs: int, seed: int) -> Survived:
    """Feed ``inputs`` mutations; the same seed gives the same ones.

    Raises:
        Broken: the decoder raised, or gave what is no scene; the message has the input.
    """
    rng = random.Random(f"{seed} {target.name}")
    began, early_mib = time.monotonic(), resident_mib()
    try:
        for count in range(inputs):
            if count % BATCH == 0:
                faulthandler.dump_traceback_later(HANG_S, exit=True)
            if count == inputs // 10:
                early_mib = resident_mib()
            data = mutated(rng, target.seeds)
            if target.repaired is not None and rng.random() < 0.5:
                data = target.repaired(data)
            try:
                target.feed(data)
            except Exception as error:
                what = f"{type(error).__name__}: {error}"
                raise Broken(
                    f"{target.name}, input {count} of seed {seed}: {what}; hex {data.hex()}"
                ) from error
    finally:  # armed, it would end the process later
        faulthandler.cancel_dump_traceback_later()
    seconds = time.monotonic() - began
    return Survived(target.name, inputs, seconds, resident_mib() - early_mib)


def resident_mib() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20
