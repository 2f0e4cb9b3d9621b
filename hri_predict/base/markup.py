"""HTML and SVG as text. Every value is escaped, wherever it came from."""

from collections.abc import Iterable, Sequence
from html import escape


class Markup(str):
    """Text that is HTML already. Only this module makes it."""

    __slots__ = ()


LEVEL_COLOURS = {
    "CLEAR": "#2ea043", "WARN": "#f0be14", "SLOW": "#f58214", "STOP": "#d72626",
    "UNKNOWN": "#963cc8", "FAULT": "#5a1e87",
}  # fmt: skip
"""Of levels by name: the same on screens, pages, pictures, and in recordings."""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"

Content = str | Markup | int | float | None


def text(value: Content) -> Markup:
    """A value as HTML: escaped, characters that cannot be printed shown as such."""
    if isinstance(value, Markup):
        return value
    raw = "" if value is None else str(value)
    safe = "".join(c if c.isprintable() or c == "\n" else f"\\u{ord(c):04x}" for c in raw)
    return Markup(escape(safe, quote=True))


def tag(name: str, *content: Content, **attributes: Content) -> Markup:
    """``<name ...>content</name>``; ``stroke_width`` becomes ``stroke-width``, ``class_`` class."""
    pairs = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{text(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Markup(f"<{name}{pairs}>{join(content)}</{name}>")


def join(parts: Iterable[Content]) -> Markup:
    """All parts, one after the other."""
    return Markup("".join(text(part) for part in parts))


def table(head: Sequence[Content], rows: Iterable[Sequence[Content]]) -> Markup:
    """A table; columns after the first hold numbers, so they are aligned to the right."""
    top = tag("tr", *(tag("th", cell) for cell in head))
    body = [tag("tr", *(tag("td", cell) for cell in row)) for row in rows]
    return tag("table", tag("thead", top), tag("tbody", *body))


def document(title: str, style: str, *body: Content) -> str:
    """A whole page in one file: it loads nothing, and no script runs in it.

    Args:
        title: of the window.
        style: CSS, trusted.
        body: its content.
    """
    head = tag(
        "head",
        Markup('<meta charset="utf-8">'),
        Markup(f'<meta http-equiv="Content-Security-Policy" content="{text(_POLICY)}">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        tag("title", title),
        tag("style", Markup(style)),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', *body), lang='en')}\n"
