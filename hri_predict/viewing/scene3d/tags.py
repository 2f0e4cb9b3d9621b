"""Draws labels and lines: people's numbers, robots' levels, the separation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from viser import LabelHandle, LineSegmentsHandle, ViserServer

from hri_predict.viewing.levels import GREY, Rgb, colour
from hri_predict.viewing.picture import Picture, Shapes
from hri_predict.viewing.scene3d.solids import linear

ABOVE_M = 0.18
"""Height of labels above the labelled object."""
RING_M = 0.32
"""Radius of the ring on the floor around a robot's base."""
_TURNS = np.linspace(0.0, 2 * np.pi, 49)
_RING = RING_M * np.stack((np.cos(_TURNS), np.sin(_TURNS), np.zeros(49)), axis=-1)
_NOWHERE = np.array([[[0, 0, -50], [0, 0, -50]]], np.float32)
_BLACK: Rgb = (0, 0, 0)
Words = dict[str, tuple[str, Sequence[float]]]
"""Labels and their positions, by labelled object."""


class Tags:
    """Labels and lines of one server's scene."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._labels: dict[str, LabelHandle] = {}
        self._lines = self._batch("separation", 3.0)
        self._rings = self._batch("rings", 4.0)

    def draw(self, picture: Picture, known: bool) -> None:
        """Show the labels and lines of a picture; grey if it is not ``known`` to be current."""
        words = {**_of_people(picture), **_of_robots(picture), **_of_pairs(picture)}
        for name, label in self._labels.items():
            label.visible = name in words
        for name, (text, at) in words.items():
            self._word(name, text, at)
        robots = picture.facts["robots"]
        paired = [robot for robot in robots if robot["line"] is not None]
        ends = np.array([robot["line"] for robot in paired], np.float32).reshape(-1, 2, 3)
        _set(self._lines, ends, [_rgb(robot, known) for robot in paired])
        based = [(robot, rows) for robot, rows in _parts(picture) if len(rows)]
        rings = [_RING + np.array([*rows[0, :2], 0.01]) for _, rows in based]
        edges = [np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings]
        each = len(_TURNS) - 1
        colours = [_rgb(robot, known) for robot, _ in based for _ in range(each)]
        _set(self._rings, np.array(edges, np.float32).reshape(-1, 2, 3), colours)

    def _word(self, name: str, text: str, at: Sequence[float]) -> None:
        if name not in self._labels:
            path = f"/tags/{len(self._labels)}"
            self._labels[name] = self._server.scene.add_label(path, text, anchor="bottom-center")
        label = self._labels[name]
        label.text, label.position = text, (float(at[0]), float(at[1]), float(at[2]))

    def _batch(self, name: str, pixels: float) -> LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            f"/{name}", _NOWHERE, GREY, thickness=pixels, thickness_units="screen"
        )


def _set(lines: LineSegmentsHandle, points: Shapes, colours: list[Rgb]) -> None:
    """Show these (N, 2, 3) lines, one colour each; nothing if there are none."""
    if not len(points):
        points, colours = _NOWHERE, [_BLACK]
    rgb = linear(colours)[:, None]
    lines.points, lines.colors = points, np.repeat(rgb, 2, axis=1)


def _of_people(picture: Picture) -> Words:
    """Each person's number above the head."""
    words: Words = {}
    for row, id_ in enumerate(picture.facts["people"]):
        ends = picture.bodies[row][:, :6].reshape(-1, 3)
        ends = ends[np.isfinite(ends).all(axis=1)]
        if len(ends):
            lost = " (lost)" if row >= picture.facts["tracked"] else ""
            top = ends[ends[:, 2].argmax()]
            words[f"person {id_}"] = (f"person {id_}{lost}", (*top[:2], top[2] + ABOVE_M))
    return words


def _of_robots(picture: Picture) -> Words:
    """Each robot's name and level above it."""
    words: Words = {}
    for robot, rows in _parts(picture):
        if len(rows):
            ends = rows[:, :6].reshape(-1, 3)
            top = [*ends[0, :2], ends[:, 2].max() + ABOVE_M]
            words[f"robot {robot['name']}"] = (f"{robot['name']}: {robot['level']}", top)
    return words


def _of_pairs(picture: Picture) -> Words:
    """Return the distances of the deciding pairs, in the middle of their lines."""
    return {
        f"separation {robot['name']}": (
            robot["apart"].partition(",")[0],  # the panel has all of it
            np.mean(robot["line"], axis=0),
        )
        for robot in picture.facts["robots"]
        if robot["line"] is not None
    }


def _parts(picture: Picture) -> list[tuple[dict[str, Any], Shapes]]:
    """Each robot with its (C, 7) capsules."""
    parts, start = [], 0
    for robot in picture.facts["robots"]:
        parts.append((robot, picture.robots[start : start + robot["capsules"]]))
        start += robot["capsules"]
    return parts


def _rgb(robot: dict[str, Any], known: bool) -> Rgb:
    return colour(robot["level"]) if known else GREY
