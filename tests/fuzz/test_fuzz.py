"""A short run of the fuzzer, and that it would notice."""

import pytest

from tests.fuzz.run import Broken, fuzz
from tests.fuzz.targets import Target, targets

INPUTS = 4000


@pytest.mark.parametrize("target", targets(), ids=lambda target: target.name)
def test_no_input_breaks_a_decoder(target):
    assert len(target.seeds) >= 4
    assert fuzz(target, INPUTS, seed=1).inputs == INPUTS


def test_a_decoder_that_breaks_is_named_with_its_input():
    def breaks(data: bytes) -> None:
        if len(data) == 3:
            raise IndexError("three")

    with pytest.raises(Broken, match=r"mine, input \d+ of seed 0: IndexError: three; hex "):
        fuzz(Target("mine", [b"abcdefgh"], breaks), INPUTS, seed=0)


@pytest.mark.parametrize("name", ["classic", "fd", "profile4", "scene_stream", "scene_stream_key"])
def test_repaired_inputs_get_behind_the_checksum(name):
    (target,) = (t for t in targets() if t.name == name)
    assert target.repaired
    for seed in target.seeds:
        assert target.repaired(target.repaired(seed)) == target.repaired(seed)
