"""What tests of the scene stream share: scenes, keys, and the sender that users copy."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.contracts.joint_map import JointMap

ROOT = Path(__file__).resolve().parents[3]
CORPUS = ROOT / "tests" / "corpus" / "scene_stream"
SECRET = b"0123456789abcdef0123456789abcdef"
KEY = Key(SECRET, "test.key")
UTC = 1_767_225_600_000_000_000  # 2026-01-01
MS = 1_000_000
S = 1000 * MS


def hri_sender() -> Any:
    """The sender's module, loaded from its file as a user's copy is."""
    path = ROOT / "drivers" / "python" / "hri_sender.py"
    spec = importlib.util.spec_from_file_location("hri_sender", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names(count: int) -> list[str]:
    return [f"joint{i}" for i in range(count)]


def joint_map(count: int) -> JointMap:
    return JointMap(
        name="mine",
        source_joints=tuple(names(count)),
        scale_to_m=1.0,
        rotation=np.eye(3),
        weights=np.zeros((21, count)),
    )


def person(number: int, joints: int, hidden: int = 0) -> SentPerson:
    """Somebody whose first ``hidden`` joints are not observed."""
    rng = np.random.default_rng([number, joints])
    observed = np.arange(joints) >= hidden
    positions = rng.normal(size=(joints, 3)).astype(np.float32).astype(np.float64)
    positions[~observed] = np.nan
    return SentPerson(number, positions, observed)


def scene(
    sequence: int = 0,
    people: int = 1,
    joints: int = 4,
    stamp_ns: int = UTC,
    *,
    session: int = UTC,
) -> SentScene:
    everybody = tuple(person(i, joints) for i in range(people))
    return SentScene(
        stamp_ns=stamp_ns, sequence=sequence, sees_room=True, people=everybody, session=session
    )


def same(a: SentScene, b: SentScene) -> bool:
    """Whether two scenes are equal to the last bit."""
    return (
        (a.stamp_ns, a.sequence, a.sees_room) == (b.stamp_ns, b.sequence, b.sees_room)
        and [p.id for p in a.people] == [p.id for p in b.people]
        and all(
            np.array_equal(p.observed, q.observed)
            and np.array_equal(p.positions, q.positions, equal_nan=True)
            and p.error_m == q.error_m
            for p, q in zip(a.people, b.people, strict=True)
        )
    )
