"""Any network with the joints of COCO-17 or BlazePose-33, used through its description.

A file describes a network, in YAML::

    network: yolo11n-pose.onnx    # beside this file, .onnx or .tflite
    layout: coco17                # or mediapipe33
    input: {order: nchw, channels: rgb, scale: 255}
    people: {output: output0, along: columns, first: 5, score: 4}
    joints: {values: [x, y, score], units: pixels}
"""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from hri_drivers.camera.network.found import (
    JOINTS,
    Finding,
    Found,
    distinct,
    logistic,
    without_outside,
)
from hri_drivers.camera.network.package import read_model
from hri_drivers.camera.network.roi import Roi, whole
from hri_drivers.camera.network.runtime import Net, load_net
from hri_drivers.camera.seen import Float32, UInt8
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import read_yaml
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import Settings, validated

MAX_CANDIDATES = 200
"""Number of people in an image that are checked for duplicates, most confident first."""


class DescribedNetwork:
    """A ``Finder``: one run of a network for each image.

    Args:
        path: path of the description.
        people: maximum number of people.
        threads: maximum number of threads.

    Attributes:
        layout: see ``Finder``.
        has_world: whether the network gives landmarks in metres.
        room_for: number of people that the network's output has room for; 0 if that depends on the
            image. If the output is full, there may be more people than were found. The output of
            a network for one person is full as soon as it finds one.

    Raises:
        ConfigError: the description or the network is wrong, the two do not fit each other, or the
            network cannot compute an image.
    """

    def __init__(self, path: Path, people: int, threads: int = 1) -> None:
        self._where = f"model {path}"
        self._about = validated(Description, read_yaml(path, "model"), self._where)
        self._check()
        file = path.parent / self._about.network
        self._net = load_net(read_model(file), str(file), threads)
        self.layout: str = self._about.layout
        self._people = people
        self._side = self._square(self._net)
        self._at = self._index(self._about.people.output, 0)
        world = self._about.people.world
        self._world_at = None if world is None else self._index(world, 0)
        self.has_world = world is not None
        nothing = np.zeros((self._side, self._side, 3), np.uint8)
        _, _, sure, _ = self._outputs(nothing)  # a mistake shows now
        self.room_for = len(sure)

    def find(self, pixels: UInt8) -> Finding:
        """See ``Finder``.

        Raises:
            ConfigError: the outputs are not shaped as described.
        """
        square = whole(pixels)
        places, scores, sure, worlds = self._outputs(square.crop(pixels, self._side))
        likely = np.flatnonzero(sure >= self._about.people.least)
        is_full = len(likely) > MAX_CANDIDATES or 0 < self.room_for <= len(likely)
        likely = likely[np.argsort(-sure[likely], kind="stable")][:MAX_CANDIDATES]
        found = [
            self._found((places[k], scores[k], None if worlds is None else worlds[k]), sure[k],
                        square, pixels)
            for k in likely
        ]  # fmt: skip
        people = distinct([each for each in found if np.isfinite(each.pixels).any()])
        is_whole = len(people) <= self._people and not is_full
        return Finding(tuple(people[: self._people]), is_whole)

    def _outputs(self, crop: UInt8) -> tuple[Floats, Floats, Floats, Floats | None]:
        """Return the output for a square image: places, joint scores, person scores, metres."""
        outputs = self._computed(crop)
        try:
            if self._about.joints.heatmaps:
                places, scores, sure = self._peaks(outputs[self._at])
            else:
                places, scores, sure = self._rows(outputs[self._at])
            worlds = self._worlds(outputs, len(places))
        except (ValueError, IndexError) as error:
            raise ConfigError(
                f"{self._where}: output '{self._net.names[self._at]}' of shape "
                f"{outputs[self._at].shape} does not fit the description ({error}); correct "
                f"'people' or 'joints'"
            ) from error
        return places, scores, sure, worlds

    def _computed(self, crop: UInt8) -> list[Float32]:
        try:
            return self._net.run(self._tensor(crop))
        except Exception as error:  # of every kind, from another's runtime
            reason = " ".join(str(error).split())[:120]
            raise ConfigError(
                f"{self._where}: the network cannot compute an image of {self._side} x "
                f"{self._side} pixels ({reason}); set input.side to the size that it was exported "
                f"for"
            ) from error

    def _check(self) -> None:
        values = self._about.joints.values
        if not self._about.joints.heatmaps and (values.count("x"), values.count("y")) != (1, 1):
            raise ConfigError(f"{self._where}: joints.values: must name x and y, each once")
        if values.count("score") > 1:
            raise ConfigError(f"{self._where}: joints.values: may name score only once")
        has_score = "score" in values or self._about.people.score is not None
        if not self._about.joints.heatmaps and not has_score:
            raise ConfigError(
                f"{self._where}: joints.values: without 'score', give people.score: the score "
                f"decides whether a person is there"
            )

    def _square(self, net: Net) -> int:
        """Return the side of the network's input."""
        nhwc = self._about.input.order == "nhwc"
        _, *rest = net.shape
        channels, sides = (rest[2], rest[:2]) if nhwc else (rest[0], rest[1:])
        if channels not in (3, -1):
            raise ConfigError(
                f"{self._where}: the network takes {net.shape}, which contradicts input.order "
                f"{self._about.input.order}; set the other order"
            )
        side = self._about.input.side
        fixed = {each for each in sides if each != -1}
        if len(fixed) > 1 or (side is not None and fixed - {side}):
            raise ConfigError(
                f"{self._where}: the network takes {net.shape}; its input must be square and match "
                f"input.side"
            )
        if not fixed and side is None:
            raise ConfigError(f"{self._where}: give input.side; the network does not define it")
        return int(fixed.pop()) if fixed else int(side or 0)

    def _index(self, name: str | None, default: int) -> int:
        names = self._net.names
        if name is not None and name not in names:
            raise ConfigError(
                f"{self._where}: the network has no output '{name}' ({', '.join(names)})"
            )
        return default if name is None else names.index(name)

    def _tensor(self, crop: UInt8) -> Float32:
        how = self._about.input
        colours = crop[:, :, ::-1] if how.channels == "rgb" else crop
        scaled = (colours / how.scale - how.mean) / how.deviation
        ordered = scaled if how.order == "nhwc" else scaled.transpose(2, 0, 1)
        return np.ascontiguousarray(ordered[np.newaxis], np.float32)

    def _rows(self, output: Float32) -> tuple[Floats, Floats, Floats]:
        """Return (N, J, 2) places in 0..1, (N, J) scores of joints, (N,) scores of people."""
        about, joints = self._about.people, JOINTS[self.layout]
        values = self._about.joints.values
        width = about.first + joints * len(values)
        flat = np.asarray(output, np.float64)
        if about.along == "columns":
            flat = np.swapaxes(flat, -1, -2)
        if flat.ndim > 2 and flat.shape[-2:] == (joints, len(values)):
            flat = flat.reshape(-1, joints * len(values))
        rows = flat.reshape(-1, flat.shape[-1])
        if rows.shape[1] < width:
            raise ValueError(f"a person has {rows.shape[1]} values, expected {width} or more")
        body = rows[:, about.first : width].reshape(len(rows), joints, len(values))
        places = body[:, :, [values.index("x"), values.index("y")]]
        if self._about.joints.units == "pixels":
            places = (places + 0.5) / self._side
        scores = np.ones(places.shape[:2])
        if "score" in values:
            scores = self._activated(body[:, :, values.index("score")])
        people = scores.mean(axis=1)
        if about.score is not None:
            people = self._activated(rows[:, about.score])
        return places, np.clip(scores, 0.0, 1.0), people

    def _peaks(self, output: Float32) -> tuple[Floats, Floats, Floats]:
        """Return the positions of the maxima in one person's maps, in the form of ``_rows``."""
        joints = JOINTS[self.layout]
        maps = np.asarray(output, np.float64)[0]
        if self._about.input.order == "nhwc":
            maps = np.moveaxis(maps, -1, 0)
        if maps.ndim != 3 or len(maps) != joints:
            raise ValueError(f"expected {joints} maps")
        height, width = maps.shape[1:]
        flat = maps.reshape(joints, -1)
        row, column = np.divmod(flat.argmax(axis=1), width)
        places = np.stack([(column + 0.5) / width, (row + 0.5) / height], axis=1)
        scores = np.clip(self._activated(flat.max(axis=1)), 0.0, 1.0)
        return places[np.newaxis], scores[np.newaxis], np.array([scores.mean()])

    def _worlds(self, outputs: list[Float32], people: int) -> Floats | None:
        if self._world_at is None:
            return None
        world = np.asarray(outputs[self._world_at], np.float64)
        joints = JOINTS[self.layout]
        points = world.reshape(people, -1, 3)
        if points.shape[1] < joints:
            raise ValueError(f"world has {points.shape[1]} points, expected {joints} or more")
        return points[:, :joints]

    def _activated(self, scores: Floats) -> Floats:
        return logistic(scores) if self._about.joints.logits else scores

    def _found(
        self, body: tuple[Floats, Floats, Floats | None], sure: float, square: Roi, picture: UInt8
    ) -> Found:
        places, scores, world = body
        visibility = scores.copy()
        pixels = without_outside(square.in_picture(places), visibility, picture)
        return Found(pixels, visibility, world, min(1.0, float(sure)))


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
