"""Description of a predictor in another process: all its attributes, without its forecasts."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from hri_predict.base.skeleton import CANONICAL, Segment, Skeleton, make_skeleton
from hri_predict.contracts.predictor import Predictor


@dataclass(frozen=True, slots=True)
class Description:
    """The attributes of a predictor; see ``contracts.predictor.Predictor``.

    Attributes:
        digest: digest of the files and the third parties' code that the forecasts depend on; a
            restarted worker must have read the same.
    """

    skeleton: Skeleton
    history_steps: int
    horizon_steps: int
    rate_hz: float
    digest: str

    @classmethod
    def of(cls, predictor: Predictor, files: Sequence[Path], code: str | None = None) -> Self:
        """Describe ``predictor``, which depends on ``files`` and runs ``code`` (its hash)."""
        whole = hashlib.sha256((code or "").encode())
        for path in files:
            whole.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"-")
        return cls(
            predictor.skeleton,
            predictor.history_steps,
            predictor.horizon_steps,
            float(predictor.rate_hz),
            whole.hexdigest(),
        )

    def as_data(self) -> dict[str, Any]:
        """As plain data for JSON."""
        return {
            "skeleton": _skeleton_data(self.skeleton),
            "history_steps": self.history_steps,
            "horizon_steps": self.horizon_steps,
            "rate_hz": self.rate_hz,
            "digest": self.digest,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The description that ``as_data`` gave. The canonical skeleton is the node's own object.

        Raises:
            KeyError, TypeError, ValueError: the data is not a description.
        """
        return cls(
            _skeleton(data["skeleton"]),
            int(data["history_steps"]),
            int(data["horizon_steps"]),
            float(data["rate_hz"]),
            str(data["digest"]),
        )

    def is_like(self, other: "Description") -> bool:
        """Whether another worker's forecasts can replace this worker's."""
        return json.dumps(self.as_data()) == json.dumps(other.as_data())


def _skeleton_data(skeleton: Skeleton) -> dict[str, Any]:
    return {
        "name": skeleton.name,
        "joints": skeleton.joints,
        "parents": skeleton.parents,
        "segments": [
            [each.name, each.joint_a, each.joint_b, each.radius, each.part]
            for each in skeleton.segments
        ],
        "left_right_pairs": skeleton.left_right_pairs,
        "parts": skeleton.parts,
        "bone_lengths": [
            0.0 if parent < 0 else float(skeleton.reach[joint, parent])
            for joint, parent in enumerate(skeleton.parents)
        ],
    }


def _skeleton(data: dict[str, Any]) -> Skeleton:
    if json.dumps(data) == json.dumps(_skeleton_data(CANONICAL)):
        return CANONICAL
    return make_skeleton(
        data["name"],
        data["joints"],
        data["parents"],
        segments=[
            Segment(name=name, joint_a=a, joint_b=b, radius=radius, part=part)
            for name, a, b, radius, part in data["segments"]
        ],
        left_right_pairs=[(left, right) for left, right in data["left_right_pairs"]],
        parts={name: tuple(joints) for name, joints in data["parts"].items()},
        bone_lengths=data["bone_lengths"],
    )
