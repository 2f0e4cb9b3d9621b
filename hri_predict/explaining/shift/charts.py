"""Bars as SVG inside the page: nothing is loaded, no script runs."""

from collections.abc import Mapping, Sequence

from hri_predict.base.markup import LEVEL_COLOURS, Markup, join, tag

_WIDTH, _BAR, _LEFT = 640.0, 18.0, 64.0
_TALL = 120.0


def level_bars(rows: Sequence[tuple[str, Mapping[str, float]]]) -> Markup:
    """A bar for each row, divided by the seconds at each level; as long as its seconds."""
    most = max((sum(seconds.values()) for _, seconds in rows), default=0.0) or 1.0
    parts: list[Markup] = []
    for k, (name, seconds) in enumerate(rows):
        top, left = k * (_BAR + 4), _LEFT
        parts.append(_text(_LEFT - 6, top + 13, name, "end"))
        for level, colour in LEVEL_COLOURS.items():
            wide = (_WIDTH - _LEFT) * seconds.get(level, 0.0) / most
            if wide > 0:
                title = f"{name} {level}: {seconds[level]:.1f} s"
                parts.append(_rect((left, top), (wide, _BAR), colour, title))
            left += wide
    return _svg(parts, len(rows) * (_BAR + 4))


def legend() -> Markup:
    """The colours of the levels, with their names."""
    spans = [
        tag("span", tag("i", style=f"background:{colour}"), name, class_="key")
        for name, colour in LEVEL_COLOURS.items()
    ]
    return tag("p", *spans, class_="legend")


def histogram(rows: Sequence[Sequence[float]], unit: str) -> Markup:
    """Columns of (lower edge, weight); the last column holds all beyond."""
    most = max((weight for _, weight in rows), default=0.0) or 1.0
    wide = (_WIDTH - _LEFT) / max(1, len(rows))
    parts: list[Markup] = []
    for k, (edge, weight) in enumerate(rows):
        tall = (_TALL - 6) * weight / most
        left = _LEFT + k * wide
        if tall > 0:
            title, size = f"from {edge:.1f} {unit}: {weight:.1f} s", (max(0.5, wide - 1), tall)
            parts.append(_rect((left, _TALL - tall), size, "#0072B2", title))
        if k % 5 == 0:
            parts.append(_text(left, _TALL + 14, f"{edge:.1f}", "middle"))
    parts.append(_text(_WIDTH, _TALL + 28, f"{unit}; the last column holds all beyond", "end"))
    parts.append(_text(_LEFT - 6, 12, f"{most:.0f} s", "end"))
    return _svg(parts, _TALL + 34)


def _svg(parts: Sequence[Markup], tall: float) -> Markup:
    return tag(
        "svg",
        join(parts),
        viewBox=f"0 0 {_WIDTH:.0f} {tall:.0f}",
        width="100%",
        xmlns="http://www.w3.org/2000/svg",
        role="img",
    )


def _rect(at: tuple[float, float], size: tuple[float, float], colour: str, title: str) -> Markup:
    return tag(
        "rect",
        tag("title", title),
        x=f"{at[0]:.1f}",
        y=f"{at[1]:.1f}",
        width=f"{size[0]:.2f}",
        height=f"{size[1]:.2f}",
        fill=colour,
    )


def _text(x: float, y: float, words: str, anchor: str) -> Markup:
    return tag("text", words, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor, font_size="11")
