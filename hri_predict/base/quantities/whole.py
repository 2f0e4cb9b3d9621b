"""Whole numbers in external text: indices in keys, environment variables."""

MAX_DIGITS = 18
"""Maximum number of digits that fits 64 bits; ``int`` raises above 4,300 digits."""


def whole(text: str) -> int | None:
    """Return the number in ``text``, which may contain only digits; ``None`` if it does not, or is
    too long.
    """
    return int(text) if text.isdecimal() and len(text) <= MAX_DIGITS else None
