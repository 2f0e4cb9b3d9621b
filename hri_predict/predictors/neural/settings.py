"""Settings of the trained predictors. They need no torch, so that the node's process needs none."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field

from hri_predict.base.files import package_path
from hri_predict.contracts.predictor import PredictorSettings

EngineName = Literal["auto", "torch", "onnxruntime"]


class NeuralSettings(PredictorSettings):
    """Settings of the trained predictors."""

    weights: str | None = Field(
        None, min_length=1, description="file of weights; by default the shipped one"
    )
    threads: int = Field(1, ge=1, le=64, description="CPU threads that the network may use")
    engine: EngineName = Field(
        "auto",
        description="engine of the network: torch; onnxruntime (an exported copy, up to twice"
        " as fast for one person); or auto, the copy where it agrees with torch",
    )

    @property
    def takes_long(self) -> bool:
        """True: a network takes milliseconds."""
        return True

    def resolved(self, base_dir: Path) -> Self:
        """Copy with the path ``weights`` resolved against the configuration's folder."""
        if self.weights is None:
            return self
        return self.model_copy(update={"weights": str(base_dir / self.weights)})

    def files(self) -> tuple[Path, ...]:
        """The weights file."""
        return (shipped_weights(self.name) if self.weights is None else Path(self.weights),)


class AggregatedSettings(NeuralSettings):
    """Settings of the aggregated predictor."""

    inner: str = Field(
        "trajectorycnn", description="trained predictor whose network is applied repeatedly"
    )
    steps: int = Field(5, ge=1, le=1000, description="steps used from each application")

    def files(self) -> tuple[Path, ...]:
        """The inner predictor's weights, unless ``weights`` names others."""
        return (shipped_weights(self.inner) if self.weights is None else Path(self.weights),)

    def runs(self) -> tuple[str, ...]:
        """The inner predictor."""
        return (self.inner,)


def shipped_weights(method: str) -> Path:
    """Path of the shipped weights of a method; the file may be missing."""
    return package_path("predictors", "weights", f"{method}.safetensors")
