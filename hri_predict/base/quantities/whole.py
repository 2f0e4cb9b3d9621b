"""Whole numbers in texts of others: indices in keys, variables of the environment."""

MAX_DIGITS = 18
"""Fit 64 bits; ``int`` raises for text of more than 4,300."""


def whole(text: str) -> int | None:
    """Return the number that ``text`` is: digits alone; ``None`` if it is none, or a longer one."""
    return int(text) if text.isdecimal() and len(text) <= MAX_DIGITS else None
