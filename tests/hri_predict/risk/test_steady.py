"""A tick leaves nothing behind that grows."""

import gc
import tracemalloc

import pytest

from hri_sim.bench import parts

TICKS, TIMES, SETTLING = 60, 4, 16


@pytest.mark.long
def test_judging_leaves_nothing_behind_that_grows():
    _, judge = parts.risk_calls()

    def ticks() -> tuple[int, int]:
        for _ in range(TICKS):
            judge()
        gc.collect()
        return len(gc.get_objects()), tracemalloc.get_traced_memory()[0]

    tracemalloc.start()  # before all: memory that is only replaced must not look like growth
    try:
        for _ in range(SETTLING):  # the first ones fill what is bounded
            ticks()
        found = [ticks() for _ in range(TIMES)]
    finally:
        tracemalloc.stop()
    objects, held = zip(*found, strict=True)
    # This test keeps a few objects of its own each time; one kept by each tick would be 60 more.
    assert max(objects) - min(objects) <= 2 * TIMES
    # Less than a number (24 bytes or more) for each tick; what else runs keeps some bytes too.
    assert max(held) - min(held) < (TIMES - 1) * TICKS * 16
