"""A joint that moves with a rigid body of markers, such as a shoulder with the chest."""

from collections.abc import Mapping
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.settings import Settings

LEAST_SINE = 0.1
"""Directions within 6 degrees of each other do not define a frame."""
_LEAST_M = 0.01

Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
Offset = Annotated[float, Field(ge=-1.0, le=1.0)]


class RigidJoint(Settings):
    """A point on a rigid body of source joints."""

    at: str = Field(description="source joint from which the offset is measured")
    left: Pair = Field(description="two source joints; the second is to the left of the first")
    up: Pair = Field(description="two source joints; the second is roughly above the first")
    offset_m: Annotated[list[Offset], Field(min_length=3, max_length=3)] = Field(
        description="metres forward, left and up of the body's own axes"
    )

    @property
    def sources(self) -> frozenset[str]:
        """The required source joints."""
        return frozenset({self.at, *self.left, *self.up})

    @model_validator(mode="after")
    def _spans(self) -> Self:
        if len({*self.left, *self.up}) < 3 or len(set(self.left)) < 2 or len(set(self.up)) < 2:
            raise ValueError("left and up must name three or four different source joints")
        return self

    def renamed(self, names: Mapping[str, str]) -> "RigidJoint":
        """Return the same joint for a source with other joint names; maps old to new names."""
        left, up = ([names[name] for name in pair] for pair in (self.left, self.up))
        return RigidJoint(at=names[self.at], left=left, up=up, offset_m=self.offset_m)

    def place(self, positions: Floats, names: tuple[str, ...]) -> tuple[Floats, Bools]:
        """Return the joint's positions.

        Args:
            positions: (..., J_source, 3) metres, right-handed, in any frame; only those of its
                sources are used.
            names: names of the source joints, including all of its sources.

        Returns:
            (..., 3), and (...) whether the sources define a frame.
        """

        def point(name: str) -> Floats:
            found: Floats = positions[..., names.index(name), :]
            return found

        left, spans = _unit(point(self.left[1]) - point(self.left[0]))
        up = point(self.up[1]) - point(self.up[0])
        size = np.linalg.norm(up, axis=-1)
        up = up - np.einsum("...i,...i->...", up, left)[..., None] * left
        spans &= np.linalg.norm(up, axis=-1) > LEAST_SINE * size
        up, upright = _unit(up)
        axes = np.stack([np.cross(left, up), left, up], axis=-1)
        return point(self.at) + axes @ np.array(self.offset_m), spans & upright


def _unit(vectors: Floats) -> tuple[Floats, Bools]:
    size = np.linalg.norm(vectors, axis=-1)
    long: Bools = np.asarray(size > _LEAST_M)
    return vectors / np.where(long, size, 1.0)[..., None], long
