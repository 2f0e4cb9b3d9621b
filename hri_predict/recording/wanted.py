"""The user's choices for files that do not state these things themselves."""

from collections.abc import Sequence
from dataclasses import dataclass

from hri_predict.contracts.joint_map import JointMap


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Options of reading a recording; see ``open_recording``.

    Attributes:
        person: id of the body, for formats with a single one.
        unit_m: metres per unit; ``None``: as the file or its format states.
        axes: axes that are forward, left and up; ``None``: as the file or its format states.
        topic: topic of the people in a bag; ``None``: the only one that there is.
        frame: frame in which the people of a bag are wanted; ``None``: the topmost above theirs.
        joint_map: the user's own map; only bags need it to be read.
    """

    person: int = 1
    unit_m: float | None = None
    axes: Sequence[str] | None = None
    topic: str | None = None
    frame: str | None = None
    joint_map: JointMap | None = None

    def of_file(
        self, joint_map: JointMap, unit_m: float | None, axes: Sequence[str] | None = None
    ) -> JointMap:
        """The map of a motion file; what is not wanted is as the file or its format states.

        Raises:
            ConfigError: impossible units or axes.
        """
        unit_m = unit_m if self.unit_m is None else self.unit_m
        axes = axes if self.axes is None else self.axes
        joint_map = joint_map if unit_m is None else joint_map.with_units(unit_m)
        return joint_map if axes is None else joint_map.with_axes(axes)
