"""The file that describes a network, in YAML::

    network: yolo11n-pose.onnx    # beside this file, .onnx or .tflite
    layout: coco17                # or mediapipe33
    input: {order: nchw, channels: rgb, scale: 255}
    people: {output: output0, along: columns, first: 5, score: 4}
    joints: {values: [x, y, score], units: pixels}

See ``docs/guides/camera.md``.
"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import Settings

Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class InputSettings(Settings):
    """The input: a pixel becomes (pixel / scale - mean) / deviation."""

    order: Literal["nhwc", "nchw"] = Field("nhwc", description="axes: channels last, or first")
    side: int | None = Field(
        None,
        ge=32,
        le=2048,
        description="side of the square in pixels, if the network does not define it",
    )
    channels: Literal["rgb", "bgr"] = Field("rgb", description="order of the colours")
    scale: float = Field(255.0, gt=0, description="divisor of the pixel values, 0..255")
    mean: Three = Field(
        [0.0, 0.0, 0.0], description="mean of each channel, subtracted after scaling"
    )
    deviation: Three = Field(
        [1.0, 1.0, 1.0], description="standard deviation of each channel, applied after the mean"
    )

    safety: ClassVar[Safety] = harmless("side", "scale")


class PeopleSettings(Settings):
    """The people in an output."""

    output: str | None = Field(None, description="name of the output; default: the first")
    world: str | None = Field(
        None,
        description="name of the output with metres around the hips (x, y, z), if there is one",
    )
    along: Literal["rows", "columns"] = Field(
        "rows", description="a person is a row of the output, or a column of it"
    )
    first: int = Field(0, ge=0, description="index of the first joint's first value in a person")
    score: int | None = Field(
        None, ge=0, description="index of a person's score; default: the mean of the joints' scores"
    )
    least: float = Field(0.3, gt=0, lt=1, description="a person with a lower score is left out")

    safety: ClassVar[Safety] = harmless("first", "score", "least")


class JointSettings(Settings):
    """The values of each joint."""

    values: list[Literal["x", "y", "z", "score", "-"]] = Field(
        ["x", "y", "score"],
        min_length=2,
        max_length=16,
        description="values of each joint, in order; '-': not used",
    )
    units: Literal["pixels", "fraction"] = Field(
        "pixels",
        description="unit of x and y: pixels of the network's input, or fractions of it, 0..1",
    )
    heatmaps: bool = Field(
        False, description="the output is a map for each joint; the joint is at its maximum"
    )
    logits: bool = Field(False, description="scores are raw: they become 1 / (1 + exp(-score))")


class Description(Settings):
    """A description file."""

    network: str = Field(min_length=1, description="file of the network, relative to this file")
    layout: Literal["mediapipe33", "coco17"] = Field(description="joint map of its joints")
    input: InputSettings = InputSettings()
    people: PeopleSettings = PeopleSettings()
    joints: JointSettings = JointSettings()
