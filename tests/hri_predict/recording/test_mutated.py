"""Damaged files of every format: read, or refused in one line; nothing else, and soon."""

import random
import warnings
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.format_table import BY_NAME
from hri_predict.recording.naming import map_of_names
from tests.hri_predict.recording.made import of_scenes

TOKENS = (b"nan", b"1e999", b"-1", b"99999999999", b"\t", b",", b"\n", b"", b"\0", b"\xff", b'"')
EACH = 40


def _seed_file(folder: Path, kind: str) -> Path:
    rng = np.random.default_rng(1)
    joints = rng.uniform(-1, 1, (3, len(JOINTS), 3))
    scenes = [
        Scene(k * 20_000_000, k, True, (Person(1, row, np.ones(len(JOINTS), bool)),))
        for k, row in enumerate(joints)
    ]
    recording = of_scenes(scenes, map_of_names(JOINTS), 50.0)
    path = folder / f"seed{BY_NAME[kind].ending}"
    write_recording(recording, path, kind)
    return path


def mutated(data: bytes, rng: random.Random) -> bytes:
    """One to sixteen changes, half of them near the beginning, where headers are."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at = rng.randrange(len(out) if rng.random() < 0.5 else min(len(out), 1200))
        match rng.randrange(6):
            case 0:
                out[at] = rng.randrange(256)
            case 1:
                out[at] ^= 1 << rng.randrange(8)
            case 2:
                del out[at : at + rng.choice((1, 8, 64))]
            case 3:
                token = rng.choice(TOKENS)
                out[at : at + len(token)] = token
            case 4:
                out[at : at + 4] = rng.choice((b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\0"))
            case _:
                other = rng.randrange(len(out))
                out[at:at] = out[other : other + 32]
        if not out:
            break
    return bytes(out)


def _opened(path: Path) -> tuple[Recording | None, str]:
    try:
        return open_recording(path, any_joints=True), ""
    except RecordingError as error:
        return None, str(error)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[] if kind == "csv" else [pytest.mark.long])
        for kind in BY_NAME
        if kind != "pack"
    ],
)
def test_every_damage_ends_in_a_recording_or_one_line(tmp_path, kind):
    path = _seed_file(tmp_path, kind)
    data = path.read_bytes()
    rng = random.Random(kind)
    read = 0
    for _ in range(EACH):
        path.write_bytes(mutated(data, rng))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            recording, error = _opened(path)
        assert "\n" not in error
        read += not error
        for scene in recording.scenes if recording else ():
            for person in scene.people:
                seen = person.positions[person.observed]
                assert np.isfinite(seen).all()
    assert read < EACH  # some damage was found
