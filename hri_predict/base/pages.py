"""HTML pages from templates.

Every value is escaped, whatever its origin. A template has the name and folder of the module that
renders it. ``base/page.html`` is the frame of a report: one file without scripts or external
resources. ``base/parts.html`` has tables and lists.
"""

from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


def printable(value: Any) -> Any:
    """Return a value for a page: ``None`` is empty, and unprintable characters are escaped.

    They could reverse the text around them, or be invisible.
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
    """Return a rendered template.

    Args:
        template: its path in ``hri_predict``.
        values: values of its names, including functions that format values.
    """
    return Markup(_templates().get_template(template).render(values))


def macros(template: str) -> Any:
    """Return the macros of a template as functions that return markup."""
    return _templates().get_template(template).module
