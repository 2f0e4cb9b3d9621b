"""A robot's capsules by link: of the arm, of tool and load, and of a moving base."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.errors import RobotError
from hri_predict.robots.file import CapsuleFile, RobotFile
from hri_predict.robots.settings import MobileBaseSettings, ToolSettings

MAX_CAPSULES = 62
"""Maximum number of capsules: Advice has six bits for the deciding capsule."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """C capsules, each fixed to a link.

    Attributes:
        names: C names.
        link: (C,) index of the link in the chain.
        ends: (C, 2, 3) in the link's frame, metres.
        radius: (C,) metres.
    """

    names: tuple[str, ...]
    link: Ints
    ends: Floats
    radius: Floats

    @classmethod
    def of(
        cls,
        file: RobotFile,
        *,
        lead: int,
        tools: Sequence[ToolSettings],
        with_payload: bool,
        base: MobileBaseSettings | None,
    ) -> "Shape":
        """Return all relevant capsules.

        Args:
            file: the robot file.
            lead: number of joints before the arm's joints.
            tools: tools that may be mounted; if empty, the file's tool is used.
            with_payload: whether the file's payload is included.
            base: a moving base; its body turns with the arm's first link.

        Raises:
            RobotError: more capsules than Advice can name.
        """
        links = {link: lead + i for i, link in enumerate(file.links())}
        found: list[tuple[int, str, CapsuleFile]] = sorted(
            ((links[c.link], c.name, c) for c in file.capsules), key=lambda each: each[0]
        )
        last = lead + len(file.joints)
        if tools:
            found += [(last, f"{t.name}/{c.name}", c) for t in tools for c in (*t.tool, *t.payload)]
        else:
            found += [(last, c.name, c) for c in file.tool]
            found += [(last, c.name, c) for c in file.payload if with_payload]
        ends = [(np.array(c.a), np.array(c.b)) for _, _, c in found]
        if base is not None:
            robot_from_base = np.linalg.inv(base.base_from_robot.matrix())
            turn, shift = robot_from_base[:3, :3], robot_from_base[:3, 3]
            found += [(lead, f"base/{c.name}", c) for c in base.capsules]
            ends += [(turn @ c.a + shift, turn @ c.b + shift) for c in base.capsules]
        if len(found) > MAX_CAPSULES:
            what = "tools: with all of them the robot" if tools else f"model: robot {file.name}"
            raise RobotError(
                f"{what} has {len(found)} capsules, but Advice can identify only {MAX_CAPSULES}; "
                f"use fewer, larger capsules"
            )
        return cls(
            tuple(name for _, name, _ in found),
            np.array([link for link, _, _ in found]),
            np.array(ends),
            np.array([capsule.radius for _, _, capsule in found]),
        )
