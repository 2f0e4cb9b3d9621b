"""Numbers and rows of text files, in the notation of any country.

A shifted cell puts a joint metres away, so rows are taken only if all have the same number of
cells. A comma is a decimal sign only if the file has no decimal points.
"""

import math
import re
from collections.abc import Sequence

_NOT_A_NUMBER = re.compile(r"[-+]?(?:n/?a|nan|null|none|[-+]?1[.,]#\w+)", re.IGNORECASE)
"""Missing numbers as written by Python, R, MATLAB, databases and Microsoft's C library."""
_POINT = re.compile(r"\d\.\d")


class Numbers:
    """Reads the numbers of one file.

    Args:
        text: the part of the file that has the numbers.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        self._comma: bool | None = None  # whether a comma can be the decimal sign

    def read(self, cell: str) -> float:
        """Return the number in a cell; NaN for an empty cell or one that says "missing".

        Raises:
            ValueError: the cell is not a number; the message gives the reason without the cell's
                text.
        """
        if "_" in cell:  # Python reads 1_0 as 10; a program that writes numbers never does
            raise ValueError("is not a number")
        try:
            return float(cell)
        except ValueError:
            pass
        cell = cell.strip()
        if not cell or _NOT_A_NUMBER.fullmatch(cell):
            return math.nan
        if cell.count(",") == 1 and "." not in cell:
            if self._comma is None:
                self._comma = _POINT.search(self._text) is None
            if not self._comma:
                raise ValueError("has a comma, while other numbers have a decimal point")
            cell = cell.replace(",", ".")
        try:
            return float(cell)
        except ValueError:
            raise ValueError("is not a number") from None


class RowLengths:
    """Checks that all rows have the same number of cells, at least as many as the first row names.

    Args:
        named: number of cells that the first row names; rows may have further cells, all empty.
    """

    def __init__(self, named: int) -> None:
        self._named = named
        self._first: int | None = None

    def wrong(self, cells: Sequence[str]) -> str:
        """Return the error in this row, such as "has 78 cells; expected 79"; "" if none."""
        if wrong := wrong_length(cells, self._named):
            return wrong
        if self._first is None:
            self._first = len(cells)
        if len(cells) != self._first:
            return f"has {len(cells)} cells; expected {self._first} as in the rows before it"
        return ""


def wrong_length(cells: Sequence[str], expected: int) -> str:
    """Return the error in a row that may end with empty cells; "" if there is none."""
    if len(cells) < expected or any(cell.strip() for cell in cells[expected:]):
        return f"has {len(cells)} cells; expected {expected}"
    return ""
