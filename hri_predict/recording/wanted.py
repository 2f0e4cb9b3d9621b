"""The user's choices for files that do not state these things themselves."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.recording.recording import converted_by


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Options of reading a recording; see ``open_recording``.

    Attributes:
        person: id of the body, for formats that hold a single body.
        unit_m: metres per unit; ``None``: as the file or its format states.
        axes: axes that are forward, left and up; ``None``: as the file or its format states.
        rate_hz: frames per second of a file without times.
        topic: topic of the people in a bag; ``None``: the only one.
        frame: frame in which the people of a bag are wanted; ``None``: the topmost above theirs.
        joint_map: the user's own map; only bags need it to be read.
    """

    person: int = 1
    unit_m: float | None = None
    axes: Sequence[str] | None = None
    rate_hz: float | None = None
    topic: str | None = None
    frame: str | None = None
    joint_map: JointMap | None = None

    def rate_of(self, path: Path) -> float:
        """Return the frame rate of a file without times, in Hz.

        Raises:
            RecordingError: no rate was given; the error names the command that gives it.
        """
        if self.rate_hz is None:
            raise RecordingError(
                f"recording {path}: does not say when its frames were taken; "
                f"{converted_by(path, '--fps 30')} (for 30 frames per second)"
            )
        return self.rate_hz

    def of_file(
        self, joint_map: JointMap, unit_m: float | None, axes: Sequence[str] | None = None
    ) -> JointMap:
        """The map of a motion file; choices not made follow the file or its format.

        Raises:
            ConfigError: impossible units or axes.
        """
        unit_m = unit_m if self.unit_m is None else self.unit_m
        axes = axes if self.axes is None else self.axes
        joint_map = joint_map if unit_m is None else joint_map.with_units(unit_m)
        return joint_map if axes is None else joint_map.with_axes(axes)
