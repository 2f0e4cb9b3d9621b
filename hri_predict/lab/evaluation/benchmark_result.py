"""Measurements under one benchmark protocol, and the values published in papers for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.lab.evaluation.benchmark import Protocol, Score
from hri_predict.lab.evaluation.published import Published, comparable

MEAN = "mean"


@dataclass(frozen=True, slots=True)
class BenchmarkResult:
    """Measurements under one protocol.

    Attributes:
        scores: by method and action; the requested methods come first.
        asked: the requested methods; the others are baselines.
        cards: cards of the evaluated weights by method; baselines have none.
    """

    protocol: Protocol
    scores: Mapping[str, Mapping[str, Score]]
    asked: tuple[str, ...]
    cards: Mapping[str, Mapping[str, Any]]

    @property
    def actions(self) -> tuple[str, ...]:
        """Actions that were evaluated."""
        return tuple(next(iter(self.scores.values())))

    @property
    def averaged(self) -> tuple[str, ...]:
        """Actions of the mean, all with the same weight."""
        return tuple(self.protocol.of.mean_over) or self.actions

    @property
    def printed(self) -> list[Published]:
        """Values published in papers for exactly this protocol."""
        protocol, file = self.protocol, self.protocol.of.published
        if file is None:
            return []
        return comparable(
            file, protocol.windows, n_in=protocol.n_in, n_out=protocol.n_out, error=protocol.error
        )


def printed_at(entry: Published, action: str, frame: int, averaged: Sequence[str]) -> float | None:
    """Return the published error of an action, or of the mean if all its actions are published."""
    if action != MEAN:
        return entry.at(action, frame)
    values = [entry.at(name, frame) for name in averaged]
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if len(known) == len(values) else None
