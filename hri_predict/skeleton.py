"""The canonical skeleton, body segments with their radii, and joint maps from other skeletons."""

from dataclasses import dataclass

from hri_predict.scene import Bools, Floats

JOINTS = (
    "waist", "torso", "neck", "head", "head_top",
    "l_shoulder", "l_elbow", "l_wrist", "l_hand",
    "r_shoulder", "r_elbow", "r_wrist", "r_hand",
    "l_hip", "l_knee", "l_ankle", "l_foot",
    "r_hip", "r_knee", "r_ankle", "r_foot",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 3, 2, 5, 6, 7, 2, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19)


@dataclass(frozen=True, slots=True)
class Segment:
    """A body segment as a capsule between two joints."""

    name: str
    joint_a: int
    joint_b: int
    radius: float
    part: str


@dataclass(frozen=True, slots=True, eq=False)
class Skeleton:
    """Joints, their tree, and the segments between them."""

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    segments: tuple[Segment, ...]
    left_right_pairs: tuple[tuple[int, int], ...]
    parts: dict[str, tuple[int, ...]]
    reach: Floats  # (J, J) metres: the longest possible distance between two joints


class JointMap:
    """How a source's joints become canonical ones."""

    source_joints: tuple[str, ...]

    def to_metres_z_up(self, points: Floats) -> Floats:
        """Raw (..., 3) in the source's units and axes to metres, x forward, y left, z up."""
        raise NotImplementedError

    def map(self, positions: Floats, observed: Bools) -> tuple[Floats, Bools]:
        """(..., J_source, 3) and (..., J_source) to canonical (..., J, 3) and (..., J)."""
        raise NotImplementedError
