"""Maximum speed at which a robot may touch each body segment (ISO/TS 15066:2016, Annex A; ISO
10218-2:2025).

The robot and the body region are modelled as two masses connected by a spring. At a relative speed
v the contact stores the energy mu v^2 / 2 = F^2 / (2 k), so a force F is reached at v = F / sqrt(mu
k), with 1 / mu = 1 / m_H + 1 / m_R (A.3.5, A.3.6) and m_R = M / 2 + m_L of the robot's moving mass
M and its load m_L. A pressure p on the area A corresponds to the force p A. The lower of the two
limits applies.

A clamped body part cannot move away, so its mass is taken as infinite (mu = m_R), and the
quasi-static limits apply.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from pydantic import Field, field_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import YAML_ENDINGS, data_path, read_yaml
from hri_predict.base.settings import Settings, validated

Region = Literal[
    "skull", "face", "neck", "back_and_shoulders", "chest", "abdomen", "pelvis", "upper_arm",
    "forearm", "hand", "thigh", "lower_leg",
]  # fmt: skip
NEVER: frozenset[Region] = frozenset({"skull", "face", "neck"})
"""Regions with which contact is never permitted."""

REGIONS: dict[str, tuple[Region, ...]] = {
    "head": ("skull", "face", "neck"),
    "shoulders": ("back_and_shoulders", "chest"),
    "thorax": ("back_and_shoulders", "chest"),
    "abdomen": ("back_and_shoulders", "abdomen"),
    "pelvis": ("pelvis", "abdomen"),
    "upper_arm": ("upper_arm",),
    "forearm": ("forearm",),
    "hand": ("hand",),
    "thigh": ("thigh",),
    "shank": ("lower_leg",),
    "foot": ("lower_leg",),
}
"""The regions in each body segment's capsule, without left and right. The most sensitive region
applies; a segment not listed here may not be touched."""

FOLLOWS = 1.1
"""Factor on limits, because a robot may exceed its speed limit by up to a tenth unnoticed."""

_CM2_PER_M2 = 1e4


class RegionLimits(Settings):
    """Load limits and stiffness of one body region."""

    force_n: float = Field(ge=1, le=1000, description="F, quasi-static")
    pressure_n_cm2: float = Field(ge=1, le=1000, description="p, quasi-static")
    transient: float = Field(ge=1, le=2, description="factor on the limit in transient contact")
    spring_n_mm: float = Field(ge=1, le=1000, description="k")
    mass_kg: float = Field(ge=0.1, le=150, description="m_H, effective")

    def speed_m_s(self, robot_kg: float, area_cm2: float, *, clamped: bool = False) -> float:
        """Return the highest relative speed at which force and pressure stay within the limits.

        Args:
            robot_kg: m_R.
            area_cm2: A.
            clamped: the region cannot move away, so quasi-static limits and infinite m_H apply.
        """
        force_n = min(self.force_n, self.pressure_n_cm2 * area_cm2)
        if clamped:
            reduced_kg = robot_kg
        else:
            force_n *= self.transient
            reduced_kg = self.mass_kg * robot_kg / (self.mass_kg + robot_kg)
        return force_n / math.sqrt(reduced_kg * self.spring_n_mm * 1000.0)


class ContactTable(Settings):
    """The limits of all regions; ``configs/contact/iso_ts_15066.yaml`` is the shipped table."""

    source: str = Field(min_length=1)
    regions: dict[Region, RegionLimits]

    @field_validator("regions")
    @classmethod
    def _complete(cls, value: dict[Region, RegionLimits]) -> dict[Region, RegionLimits]:
        missing = [region for region in get_args(Region) if region not in value]
        if missing:
            raise ValueError(f"{', '.join(missing)} missing; list every region")
        return value


@dataclass(frozen=True, slots=True, eq=False)
class SegmentLimits:
    """Maximum speeds at which one robot may touch the S segments of a body, m/s; 0: never.

    Attributes:
        transient_m_s: (S,) relative speed between the robot and a body part that is free to move
            away.
        clamped_m_s: (S,) speed of the robot towards a fixture behind the body part.
        region: (S,) name of the region with the lowest limit.
    """

    transient_m_s: Floats
    clamped_m_s: Floats
    region: tuple[str, ...]

    @classmethod
    def of(
        cls, table: ContactTable, segments: Sequence[str], robot_kg: float, area_cm2: float
    ) -> "SegmentLimits":
        """Return the limits for a robot with effective mass m_R and this smallest contact area."""
        free, clamped, names = [], [], []
        for segment in segments:
            regions = REGIONS.get(segment.removeprefix("l_").removeprefix("r_"), ())
            if not regions or NEVER.intersection(regions):
                free.append(0.0)
                clamped.append(0.0)
                names.append(" or ".join(regions) or segment)
                continue
            speeds = {r: table.regions[r].speed_m_s(robot_kg, area_cm2) for r in regions}
            worst = min(regions, key=lambda r: speeds[r])
            free.append(speeds[worst])
            clamped.append(
                min(table.regions[r].speed_m_s(robot_kg, area_cm2, clamped=True) for r in regions)
            )
            names.append(worst)
        return cls(np.array(free), np.array(clamped), tuple(names))


def load_table(path: str | None, base_dir: Path | None) -> ContactTable:
    """Read and check a table; ``None``: the shipped one.

    Raises:
        ConfigError: one line that names the file, the mistake, and the remedy.
    """
    file = data_path("contact", "iso_ts_15066.yaml")
    if path is not None:
        file = (base_dir or Path()) / path
        if file.suffix not in YAML_ENDINGS:
            raise ConfigError(f"risk.contact.table: {path} is not a .yaml file")
    return validated(ContactTable, read_yaml(file, "contact table"), f"contact table {file}")
