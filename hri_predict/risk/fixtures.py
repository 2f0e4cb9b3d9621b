"""Fixtures: tables, machines, walls and floors against which a robot may clamp a body part."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, norm
from hri_predict.base.settings import Name, Pose, Settings, Vector3

PIECE_M = 0.1
"""A capsule's axis is compared with a box piece by piece, each no longer than this."""


class PlaneFixture(Settings):
    """Everything behind a plane; ``normal`` points to the free side."""

    kind: Literal["plane"] = Field(description="an unbounded plane")
    name: Name = Field(description="its own name")
    point: Vector3 = Field(description="a point on the plane, room frame, m")
    normal: Vector3 = Field(description="unit normal that points out of the material, room frame")

    @model_validator(mode="after")
    def _unit(self) -> Self:
        if not 0.99 < float(np.linalg.norm(self.normal)) < 1.01:
            raise ValueError("normal must have length 1")
        return self

    def distance(self, points: Floats) -> Floats:
        """Distance (...,) of points (..., 3) in front of it; negative behind it."""
        normal = np.array(self.normal)
        result: Floats = (points - np.array(self.point)) @ (normal / np.linalg.norm(normal))
        return result


class BoxFixture(Settings):
    """A box: ``size`` along the axes of ``pose``, which is at its middle."""

    kind: Literal["box"] = Field(description="a box")
    name: Name = Field(description="its own name")
    pose: Pose = Field(description="position of its centre in the room")
    size: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="full lengths along its own axes, m"
    )

    @model_validator(mode="after")
    def _has_volume(self) -> Self:
        if not all(0.001 <= side <= 100 for side in self.size):
            raise ValueError("size: each side must be at least 0.001 and at most 100 m")
        return self

    def distance(self, points: Floats) -> Floats:
        """Distance (...,) of points (..., 3) from its surface; 0 within it."""
        matrix = self.pose.matrix()
        inside = (points - matrix[:3, 3]) @ matrix[:3, :3]
        result: Floats = norm(np.maximum(np.abs(inside) - np.array(self.size) / 2, 0.0))
        return result


Fixture = Annotated[PlaneFixture | BoxFixture, Field(discriminator="kind")]


def floor(z_m: float, name: str) -> PlaneFixture:
    """Everything below a height."""
    return PlaneFixture(kind="plane", name=name, point=[0.0, 0.0, z_m], normal=[0.0, 0.0, 1.0])


def gaps(capsules: Capsules, fixtures: Sequence[Fixture]) -> Floats:
    """(..., F) how far capsules (...) are from each fixture, metres; at least this far, see below.

    Of a box the distance is a lower bound, at most ``PIECE_M`` / 2 too small: a point of the axis
    is no farther than that from the middle of its piece. Of a plane it is exact. It is minus
    infinity where something is not finite.
    """
    result = np.empty((*capsules.radius.shape, len(fixtures)))
    with np.errstate(invalid="ignore"):
        for i, fixture in enumerate(fixtures):
            if isinstance(fixture, PlaneFixture):
                ends = np.minimum(fixture.distance(capsules.a), fixture.distance(capsules.b))
                result[..., i] = ends - capsules.radius
            else:
                result[..., i] = _from_box(capsules, fixture)
    return np.where(np.isfinite(result), result, -np.inf)


def _from_box(capsules: Capsules, box: BoxFixture) -> Floats:
    along = capsules.b - capsules.a
    length = norm(along)
    finite = length[np.isfinite(length)]
    pieces = max(1, int(np.ceil(finite.max(initial=0.0) / PIECE_M)))
    parts = (np.arange(pieces) + 0.5) / pieces
    middles = capsules.a[..., None, :] + parts[:, None] * along[..., None, :]
    return box.distance(middles).min(-1) - length / (2 * pieces) - capsules.radius
