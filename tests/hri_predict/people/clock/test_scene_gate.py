"""Which scenes pass the gate, and what a restart of the source means."""

import pytest

from hri_predict.contracts.scene import Scene
from hri_predict.people.clock.clock_alignment import JUMPED_SCENES
from hri_predict.people.clock.scene_gate import SceneGate

PERIOD_NS = 40_000_000
START_NS = 10**12


@pytest.mark.parametrize("ours", [True, False])
def test_a_restart_is_a_jump_of_the_sources_clock_alone_and_passes(ours):
    gate = SceneGate(PERIOD_NS, 0, stamps_are_ours=ours)
    jumped = []
    for k in range(100 + 3 * JUMPED_SCENES):
        now_ns = START_NS + k * PERIOD_NS
        gate.admit(Scene(now_ns, k if k < 100 else k - 100, True, ()), now_ns)
        jumped.append(gate.alignment.jumped)
    assert gate.counts()["source_restarts"] == 1
    assert any(jumped[100:]) is not ours
    assert not jumped[-1]
