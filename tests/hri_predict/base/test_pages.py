"""HTML from templates, read back by Python's own parser."""

from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.charts import Drawing, Plot, level_bars
from hri_predict.base.pages import render

hostile = st.one_of(
    st.text(),
    st.sampled_from(["</p><script>alert(1)</script>", '" onload="x', "&lt;", "]]>", "<!--"]),
)


class Read(HTMLParser):
    """What a reader finds: elements with their attributes, and the text between them."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def shown(text: str) -> str:
    """A text as a page has it: what cannot be printed is shown as its number."""
    return "".join(c if c.isprintable() or c == "\n" else f"\\u{ord(c):04x}" for c in text)


@given(title=hostile)
def test_a_page_runs_and_loads_nothing_and_a_value_stays_a_value(title):
    read = Read(render("base/page.html", title=title))
    names = [name for name, _ in read.elements]
    assert names == ["html", "head", "meta", "meta", "meta", "title", "style", "body"]
    policy = next(a["content"] for _, a in read.elements if a.get("http-equiv"))
    assert policy == "default-src 'none'; style-src 'unsafe-inline'"
    assert shown(title).strip() in "".join(read.words)


@given(words=hostile, title=hostile, look=hostile)
def test_a_drawing_holds_only_what_was_drawn(words, title, look):
    drawing = Drawing()
    drawing.rect(0, 0, 1, 1, title=title, fill=look)
    drawing.text(0, 0, words)
    read = Read(drawing.svg(left=0, top=0, width=10, height=10, label="x"))
    names = [name for name, _ in read.elements if name != "title"]
    assert names == ["svg", "rect", "text"]
    assert read.elements[1][1].keys() == {"x", "y", "width", "height", "fill"}
    assert shown(words) in read.words or not words


def test_a_plot_shows_larger_values_farther_up_and_right():
    plot = Plot(x_label="x", y_label="y", xs=[0, 4], ys=[0, 2])
    assert plot.x(0) < plot.x(3) < plot.x(4) < 330
    assert 205 > plot.y(0) > plot.y(1) > plot.y(2) > 0
    plot.bar(0, 1, 2, "red")
    plot.bar(1, 1, 0, "red")
    bars = [look for name, look in Read(plot.drawn()).elements if name == "rect"]
    assert len(bars) == 1


def test_bars_of_levels_are_as_long_as_their_seconds():
    svg = level_bars([("10:00", {"CLEAR": 30.0, "STOP": 10.0}), ("11:00", {"CLEAR": 20.0})])
    wide = [float(look["width"] or 0) for name, look in Read(svg).elements if name == "rect"]
    assert wide == [432.0, 144.0, 288.0]
