"""Fixtures: tables, machines, walls and floors against which a robot may clamp a body part."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, norm
from hri_predict.base.settings import Name, Pose, Settings, Vector3

PIECE_M = 0.1
"""Maximum length of the pieces of a capsule's axis that are compared with a box."""


class PlaneFixture(Settings):
    """The half-space behind a plane; ``normal`` points to the free side."""

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
        """Return the distance (...,) of points (..., 3) from the plane; negative behind it."""
        normal = np.array(self.normal)
        result: Floats = (points - np.array(self.point)) @ (normal / np.linalg.norm(normal))
        return result


class BoxFixture(Settings):
    """A box with its centre at ``pose``, and ``size`` along the axes of ``pose``."""

    kind: Literal["box"] = Field(description="a box")
    name: Name = Field(description="its own name")
    pose: Pose = Field(description="position of its centre in the room")
    size: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="full lengths along the axes of its pose, m"
    )

    @model_validator(mode="after")
    def _has_volume(self) -> Self:
        if not all(0.001 <= side <= 100 for side in self.size):
            raise ValueError("size: each side must be at least 0.001 and at most 100 m")
        return self

    def distance(self, points: Floats) -> Floats:
        """Return the distance (...,) of points (..., 3) from the box surface; 0 inside."""
        matrix = self.pose.matrix()
        inside = (points - matrix[:3, 3]) @ matrix[:3, :3]
        result: Floats = norm(np.maximum(np.abs(inside) - np.array(self.size) / 2, 0.0))
        return result


Fixture = Annotated[PlaneFixture | BoxFixture, Field(discriminator="kind")]


def floor(z_m: float, name: str) -> PlaneFixture:
    """The half-space below a height."""
    return PlaneFixture(kind="plane", name=name, point=[0.0, 0.0, z_m], normal=[0.0, 0.0, 1.0])


def gaps(capsules: Capsules, fixtures: Sequence[Fixture]) -> Floats:
    """Return distances (..., F) of capsules (...) from each fixture, metres, or a lower bound.

    For a box the distance is a lower bound, at most ``PIECE_M`` / 2 too small, because no point of
    the axis is farther than that from the centre of its piece. For a plane it is exact. It is minus
    infinity if a value is not finite.
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
