"""A table of texts, used by every report, and numbers as texts and for programs."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

HORIZONS_MS = (120, 200, 400, 600, 800, 1000, 1600, 2000)
"""Times ahead that tables of forecasts and of zones show, up to their own horizon: whole steps."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; the first column names the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """As a Markdown table under a heading."""
        lines = [f"## {self.title}", "", "| " + " | ".join(self.columns) + " |"]
        lines.append("|" + "|".join(["---"] + ["---:"] * (len(self.columns) - 1)) + "|")
        lines += ["| " + " | ".join(row) + " |" for row in self.rows]
        return "\n".join(lines) + "\n"


def percent(share: float) -> str:
    """A share as a percentage with one digit; a dash if it is not known."""
    return f"{100 * share:.1f}" if np.isfinite(share) else "–"


def plain(values: Iterable[float]) -> list[float | None]:
    """Numbers for JSON, to five digits; ``None`` for what is not finite."""
    return [round(float(v), 5) if np.isfinite(v) else None for v in values]
