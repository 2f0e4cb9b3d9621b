"""Pages of HTML from templates. Every value is escaped, wherever it came from.

A template has the name and folder of the module that fills it. ``base/page.html`` is the frame of a
report: one file that loads nothing and runs no script. ``base/parts.html`` has tables and lists.
"""

from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


def printable(value: Any) -> Any:
    """A value for a page: ``None`` is empty, characters that cannot be printed are shown as such.

    They could turn the words around them, or hide.
    """
    if value is None:
        return ""
    if isinstance(value, Markup) or not isinstance(value, str):
        return value
    return "".join(c if c.isprintable() or c == "\n" else f"\\u{ord(c):04x}" for c in value)


@cache
def _templates() -> Environment:
    return Environment(
        loader=PackageLoader("hri_predict", ""),
        autoescape=True,
        finalize=printable,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render(template: str, **values: Any) -> Markup:
    """A template filled in.

    Args:
        template: its path in ``hri_predict``.
        values: what its names stand for; functions among them format values.
    """
    return Markup(_templates().get_template(template).render(values))


def macros(template: str) -> Any:
    """The macros of a template, as functions that return markup."""
    return _templates().get_template(template).module
