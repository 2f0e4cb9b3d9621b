"""Settings of a merged source (``source:`` of ``kind: merged``)."""

from typing import Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_predict.base.errors import ConfigError
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Name, Pose, validated
from hri_predict.contracts import registry
from hri_predict.contracts.source import SourceSettings

MAX_SENSORS = 4
OF_THE_ROOM = ("field_of_view", "keeps_ids", "sees_free_space", "shadows", "viewpoints")
"""Keys that do not apply to a single sensor of a merged source."""
_REFUSED = {
    "keeps_ids": "the merge assigns its own ids, which can change for a person",
    "sees_free_space": "free space is not merged: an exit or an Acknowledge clears lost people",
    "declares_noise": "each sensor has its own; write it there",
    "min_latency_s": "each sensor has its own; write it there",
    "clock_wander_s": "each sensor has its own; write it there",
    "even_captures": "each sensor has its own; write it there",
}


class MergedSettings(SourceSettings):
    """``source:`` of ``kind: merged``: two to four sensors that see the same room.

    Each sensor is a ``source:`` block of any other kind, with its own pose, joint map, latency and
    clock. Their people are merged in the canonical skeleton.
    """

    kind: Literal["merged"]
    room_from_source: Pose = Field(
        Pose(), description="always the room's own frame; each sensor has its own pose"
    )
    sensors: dict[Name, dict[str, Any]] = Field(
        min_length=2,
        max_length=MAX_SENSORS,
        description="sensors by name, each a block like source:; the first sensor that is heard "
        "sets the times of the merged scenes",
    )
    same_m: float = Field(
        0.15,
        ge=0.02,
        le=0.25,
        description="maximum median distance of common joints at which bodies of two sensors "
        "become one person",
    )
    apart_m: float = Field(
        0.25,
        ge=0.05,
        le=0.4,
        description="distance beyond which one person becomes two again; two people are not "
        "merged while a sensor sees another body within this distance",
    )
    joint_apart_m: float = Field(
        0.25,
        ge=0.05,
        le=0.4,
        description="maximum distance between two sensors' positions of a joint; beyond it, the "
        "joint counts as not observed",
    )
    moved_m: float = Field(
        0.12,
        ge=0.03,
        le=0.5,
        description="minimum steady distance between two sensors' bodies of one person that "
        "counts as disagreement",
    )
    moved_s: float = Field(
        10.0,
        ge=2,
        le=600,
        description="seconds of observation by both sensors before moved_m is applied",
    )

    safety: ClassVar[Safety] = harmless("sensors") | {
        "same_m": LessSafe(
            above="two people {value:g} m apart, each hidden from one sensor, become one"
        ),
        "apart_m": LessSafe(
            above="two people {value:g} m apart who were merged into one stay one",
            below="two bodies become one despite another body {more:.2g} m nearer",
        ),
        "joint_apart_m": LessSafe(
            above="a joint counts as seen although two sensors see it {value:g} m apart"
        ),
        "moved_m": LessSafe(above="a sensor that was moved by {value:g} m is not detected"),
        "moved_s": LessSafe(above="a sensor that was moved is detected {more:.2g} s later"),
    }

    @property
    def stamps_are_ours(self) -> bool:
        """Merged scenes are stamped with capture times on the node's clock."""
        return True

    @property
    def judges_bodies(self) -> bool:
        """Each sensor's own captures are judged, because merged bodies are interpolated."""
        return True

    @property
    def known_places(self) -> list[list[float]]:
        """Places of all sensors."""
        return [place for sensor in self.parts.values() for place in sensor.known_places]

    @property
    def notes(self) -> list[str]:
        """Notes of all sensors, with their names."""
        return [f"sensor {name}: {n}" for name, part in self.parts.items() for n in part.notes]

    @property
    def parts(self) -> dict[str, SourceSettings]:
        """The sensors' blocks, each validated by the model of its kind.

        Raises:
            ConfigError: one of them is wrong; one line with its key and the remedy.
        """
        return {name: _part(name, data) for name, data in self.sensors.items()}

    def default_stale_s(self, rate_hz: float) -> float:
        """Default of ``stale_after_s``: the largest value of the sensors, plus one period.

        The merge waits for a sensor until the input of that sensor is stale.
        """
        waits = (
            part.stale_after_s(getattr(part, "rate_hz", None) or rate_hz)
            for part in self.parts.values()
        )
        return max(waits) + 1.0 / rate_hz

    @model_validator(mode="before")
    @classmethod
    def _not_here(cls, data: Any) -> Any:
        for key, why in _REFUSED.items():
            if isinstance(data, dict) and key in data and _is_set(cls, key, data[key]):
                raise ValueError(f"{key} has no effect for a merged source: {why}")
        return data

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.room_from_source != Pose():
            raise ValueError(
                "room_from_source has no effect for a merged source: each sensor has its own"
            )
        if self.apart_m < self.same_m:
            raise ValueError(
                f"apart_m {self.apart_m:g} is below same_m {self.same_m:g}; raise it, or a person "
                "would be split as soon as joined"
            )
        if self.joint_apart_m < self.apart_m:
            raise ValueError(
                f"joint_apart_m {self.joint_apart_m:g} is below apart_m {self.apart_m:g}; raise "
                "it, or a person may be left without any joint"
            )
        try:
            _ = self.parts
        except ConfigError as error:
            raise ValueError(str(error)) from None
        return self


def _is_set(model: type[SourceSettings], key: str, value: Any) -> bool:
    """Return whether a key differs from its default: a dumped block contains all keys."""
    field = model.model_fields.get(key)
    return field is None or value != field.default


def _part(name: str, data: dict[str, Any]) -> SourceSettings:
    where = f"sensors.{name}"
    kind = data.get("kind")
    if not isinstance(kind, str) or kind == "merged":
        kinds = ", ".join(k for k in registry.names("sources") if k != "merged")
        raise ConfigError(f"{where}.kind: use one of: {kinds}")
    for key in OF_THE_ROOM:
        if key in data:
            raise ConfigError(
                f"{where}.{key}: has no effect on one of several sensors; "
                f"{'set it in source' if key == 'field_of_view' else 'remove it'}"
            )
    try:
        model = registry.load("sources", kind).settings_model
    except ConfigError as error:
        raise ConfigError(f"{where}.kind: {error}") from None
    return validated(model, data, where)
