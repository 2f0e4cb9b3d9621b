"""Joint maps: how a source's joints, units and axes become the canonical skeleton.

A map is a YAML file (maps in ``configs/skeletons/`` are known by name)::

    name: arms                     # of the map
    reference: where the facts about this source come from
    units: mm                      # m, cm, mm, inch, ft, or metres per unit
    axes: [z, -x, -y]              # the source's axes that point forward, left and up
    left_handed: false             # true if the source's own axes are left-handed
    joints: [LShoulder, RShoulder] # the source's joints in order
    map:                           # canonical joint: source joint, or source joints with weights
      l_shoulder: LShoulder
      r_shoulder: RShoulder
      neck: {LShoulder: 0.5, RShoulder: 0.5}
    rigid:                         # joints that move with a rigid body of markers
      torso: {at: chest, left: [rib_r, rib_l], up: [belly, chest], offset_m: [-0.1, 0, 0.05]}

Only anatomical midpoints (``waist`` of the hips, ``neck`` of the shoulders, ``head`` of the ears)
may be averaged of several joints. A joint of several sources is observed if all of them are. A
source joint maps to at most one canonical joint. A canonical joint missing from the map is never
measured. The node infers it, with its uncertainty, where the map's joints allow
(``people/body/inferred.py``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.files import YAML_ENDINGS, data_path, read_yaml
from hri_predict.base.settings import Settings, validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.rigid_joint import RigidJoint

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "ft": 0.3048}
_EXAMPLE = "such as l_wrist: LeftHand or neck: {LShoulder: 0.5, RShoulder: 0.5}"
DERIVED = ("waist", "neck", "head")

Axes = Annotated[list[str], Field(min_length=3, max_length=3)]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointMap:
    """Mapping of a source's joints to the canonical ones.

    Attributes:
        name: name of the map.
        source_joints: the source's joints in its order.
        scale_to_m: metres per unit of the source.
        rotation: (3, 3) from the source's axes to forward, left, up.
        weights: (J, J_source) weight of each source joint in each canonical one; a row of zeros if
            the source has no such joint.
        rigid: canonical joints attached to a rigid body of the source; they have no weights.
        mapped: (J,) whether this source can deliver each canonical joint.
    """

    name: str
    source_joints: tuple[str, ...]
    scale_to_m: float
    rotation: Floats
    weights: Floats
    rigid: Mapping[str, RigidJoint] = field(default_factory=dict)
    mapped: Bools = field(init=False)
    _needed: Floats = field(init=False)

    def __post_init__(self) -> None:
        needed = self.weights > 0
        for joint, rigid in self.rigid.items():
            of = [self.source_joints.index(name) for name in rigid.sources]
            needed[CANONICAL.index(joint), of] = True
        object.__setattr__(self, "mapped", np.asarray(needed.any(axis=1)))
        object.__setattr__(self, "_needed", needed.T.astype(np.float64))

    @property
    def used(self) -> Bools:
        """(J_source,) whether each source joint is used by any canonical joint."""
        used: Bools = np.asarray(self._needed.any(axis=1))
        return used

    def to_metres_z_up(self, points: Floats) -> Floats:
        """Convert raw (..., 3) from the source's units and axes to metres, x forward, y left, z
        up.
        """
        result: Floats = np.asarray(points, np.float64) @ (self.rotation.T * self.scale_to_m)
        return result

    def map(self, positions: Floats, observed: Bools) -> tuple[Floats, Bools]:
        """Map source joints to canonical ones, in any frame.

        Args:
            positions: (..., J_source, 3) metres, right-handed where the map has rigid joints.
            observed: (..., J_source); a joint with a non-finite coordinate is always unobserved.

        Returns:
            (..., J, 3) and (..., J) of the canonical skeleton. Positions are finite: zero where
            unobserved.
        """
        good = observed & np.isfinite(positions).all(axis=-1)
        clean = np.where(good[..., np.newaxis], positions, 0.0)
        missing = (~good).astype(np.float64) @ self._needed
        seen: Bools = (missing == 0.0) & self.mapped
        mapped: Floats = self.weights @ clean
        for joint, rigid in self.rigid.items():
            place, spans = rigid.place(clean, self.source_joints)
            mapped[..., CANONICAL.index(joint), :] = place
            seen[..., CANONICAL.index(joint)] &= spans
        return np.where(seen[..., np.newaxis], mapped, 0.0), seen

    def with_units(self, scale_to_m: float) -> "JointMap":
        """Return this map for a file in other units: metres per unit.

        Raises:
            ConfigError: the scale is not a positive number.
        """
        if not (np.isfinite(scale_to_m) and scale_to_m > 0):
            raise ConfigError(f"units of {self.name}: must be positive; got {scale_to_m}")
        return replace(self, scale_to_m=float(scale_to_m))

    def with_axes(self, axes: Sequence[str], *, left_handed: bool = False) -> "JointMap":
        """Return this map for a file with other axes, which point forward, left and up.

        Raises:
            ConfigError: the axes are not three different ones, or have the wrong handedness.
        """
        try:
            return replace(self, rotation=axes_rotation(axes, left_handed))
        except ValueError as error:
            raise ConfigError(f"axes of {self.name}: {error}; got {list(axes)}") from None


def axes_rotation(axes: Sequence[str], left_handed: bool = False) -> Floats:
    """(3, 3) from a source's axes to forward, left, up.

    Raises:
        ValueError: they are not three different axes, or not of the declared handedness.
    """
    rotation = np.zeros((3, 3))
    for row, axis in enumerate(axes[:3]):
        letter = axis.removeprefix("-")
        if letter not in ("x", "y", "z"):
            raise ValueError(f"'{axis}' is not an axis; use x, y, z, -x, -y or -z")
        rotation[row, "xyz".index(letter)] = -1.0 if axis.startswith("-") else 1.0
    determinant = round(float(np.linalg.det(rotation)))
    if determinant == 0 or len(axes) != 3:
        raise ValueError("forward, left and up must be three different axes, such as [z, x, y]")
    if determinant != (-1 if left_handed else 1):
        hand = "left" if determinant < 0 else "right"
        raise ValueError(
            f"these axes are {hand}-handed; change a sign, or set left_handed: "
            f"{str(determinant < 0).lower()}"
        )
    return rotation


class SourceFrame(Settings):
    """Facts about the source that every map file must state."""

    name: str
    reference: str = Field(
        description="publication or document that this description of the source is taken from"
    )
    units: float = Field(ge=1e-6, le=1000, description="a unit's name, or metres per unit")
    axes: Axes
    left_handed: bool = False

    @field_validator("units", mode="before")
    @classmethod
    def _unit(cls, value: Any) -> Any:
        if isinstance(value, str) and value not in METRES_PER_UNIT:
            raise ValueError(f"use one of {', '.join(METRES_PER_UNIT)}, or metres per unit")
        return METRES_PER_UNIT[value] if isinstance(value, str) else value

    @model_validator(mode="after")
    def _handed(self) -> Self:
        axes_rotation(self.axes, self.left_handed)
        return self

    def joint_map(
        self,
        source_joints: Sequence[str],
        weights: Floats,
        rigid: Mapping[str, RigidJoint] | None = None,
    ) -> JointMap:
        """Return the map of these joints with the file's name, units and axes."""
        return JointMap(
            name=self.name,
            source_joints=tuple(source_joints),
            scale_to_m=self.units,
            rotation=axes_rotation(self.axes, self.left_handed),
            weights=weights,
            rigid=rigid or {},
        )


class JointMapSettings(SourceFrame):
    """A joint map as written in YAML."""

    joints: Annotated[list[str], Field(min_length=1, max_length=1000)]
    map: dict[str, dict[str, float]]
    rigid: dict[str, RigidJoint] = {}

    @field_validator("joints", mode="before")
    @classmethod
    def _texts(cls, value: Any) -> Any:
        for name in value if isinstance(value, list) else []:
            if not isinstance(name, str):
                raise ValueError(f"write every name as text: '{name}', in quotes")
        return value

    @field_validator("joints")
    @classmethod
    def _unique(cls, joints: list[str]) -> list[str]:
        for joint in joints:
            if joints.count(joint) > 1:
                raise ValueError(f"'{joint}' is listed twice")
        return joints

    @field_validator("map", mode="before")
    @classmethod
    def _single_source(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            raise ValueError(f"give canonical joints and their sources, {_EXAMPLE}")
        for joint, own in value.items():
            if not isinstance(own, str | dict):
                raise ValueError(
                    f"{joint}: give the name of a source joint, in quotes if it is a number, or "
                    f"source joints with weights; {_EXAMPLE}"
                )
        return {k: {v: 1.0} if isinstance(v, str) else v for k, v in value.items()}

    @model_validator(mode="after")
    def _known_joints(self) -> Self:
        if not self.map:
            raise ValueError("map is empty; map at least one joint")
        for joint, sources in self.map.items():
            _check_canonical(joint)
            for source in sources:
                if source not in self.joints:
                    raise ValueError(
                        f"map.{joint}: the source has no joint '{source}'"
                        f"{nearest(source, self.joints)}"
                    )
            _check_weights(joint, sources)
        _check_used_once(self.map)
        for joint, rigid in self.rigid.items():
            _check_rigid(joint, rigid, self)
        return self

    def to_joint_map(self) -> JointMap:
        """Return the described map."""
        weights = np.zeros((len(CANONICAL.joints), len(self.joints)))
        for joint, sources in self.map.items():
            for source, weight in sources.items():
                weights[CANONICAL.index(joint), self.joints.index(source)] = weight
        return self.joint_map(self.joints, weights, self.rigid)


def _check_canonical(joint: str, key: str = "map") -> None:
    if joint not in CANONICAL.joints:
        raise ValueError(
            f"{key}: no canonical joint '{joint}'{nearest(joint, CANONICAL.joints)} "
            f"(known: {', '.join(CANONICAL.joints)})"
        )


def _check_weights(joint: str, sources: dict[str, float]) -> None:
    if not sources or min(sources.values()) <= 0 or abs(sum(sources.values()) - 1) > 1e-6:
        raise ValueError(f"map.{joint}: weights must be positive and sum to 1")
    if len(sources) > 1 and joint not in DERIVED:
        raise ValueError(
            f"map.{joint}: only {', '.join(DERIVED)} may be derived from several joints; "
            "name one source joint or leave it out (unobserved)"
        )


def _check_rigid(joint: str, rigid: RigidJoint, settings: JointMapSettings) -> None:
    _check_canonical(joint, "rigid")
    if joint in settings.map:
        raise ValueError(f"rigid.{joint}: also occurs in map; give it once")
    for source in sorted(rigid.sources - set(settings.joints)):
        raise ValueError(
            f"rigid.{joint}: the source has no joint '{source}'{nearest(source, settings.joints)}"
        )


def _check_used_once(joints: dict[str, dict[str, float]]) -> None:
    """Refuse two canonical joints at one point: a hand of length 0 would be treated as measured."""
    used: dict[frozenset[tuple[str, float]], str] = {}
    for joint, sources in joints.items():
        point = frozenset((source, round(weight, 6)) for source, weight in sources.items())
        if point in used:
            names = " and ".join(f"'{source}'" for source in sources)
            are = "is" if len(sources) == 1 else "with these weights are"
            raise ValueError(
                f"map.{joint}: {names} {are} {used[point]} already; two canonical joints cannot "
                f"share a point; omit joints that the tracker lacks (the node infers them)"
            )
        used[point] = joint


def map_names() -> list[str]:
    """Names of the shipped maps."""
    return sorted(path.stem for path in data_path("skeletons").glob("*.yaml"))


def load_joint_map(name_or_path: str) -> JointMap:
    """Load a map by its shipped name (``cmu38``, ``coco17``, ...) or from a YAML file.

    Raises:
        ConfigError: the map does not exist, or its file is wrong; one line names the key.
    """
    if name_or_path == "bvh":
        raise ConfigError(
            "joint map 'bvh' is built from a file's own joint names; give the BVH file as recording"
        )
    path = _find_map(name_or_path)
    data = read_yaml(path, "joint map")
    return validated(JointMapSettings, data, f"joint map {path}").to_joint_map()


def _find_map(name_or_path: str) -> Path:
    names = map_names()
    if name_or_path in names:
        return data_path("skeletons", f"{name_or_path}.yaml")
    path = Path(name_or_path)
    if path.suffix not in YAML_ENDINGS:
        raise ConfigError(
            f"no joint map '{name_or_path}'{nearest(name_or_path, names)} "
            f"(known: {', '.join(names)}; or give a .yaml file)"
        )
    return path
