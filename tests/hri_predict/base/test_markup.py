"""HTML as text, read back by Python's own parser."""

from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.markup import document, tag


class _Read(HTMLParser):
    """What a reader finds: elements with their attributes, and the text between them."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words += data


hostile = st.one_of(
    st.text(),
    st.sampled_from(["</p><script>alert(1)</script>", '" onload="x', "&lt;", "]]>", "<!--"]),
)


@given(content=hostile, attribute=hostile)
def test_a_value_stays_a_value(content, attribute):
    read = _Read(tag("p", content, title=attribute))
    assert [name for name, _ in read.elements] == ["p"]
    assert list(read.elements[0][1]) == ["title"]
    shown = "".join(c if c.isprintable() or c == "\n" else f"\\u{ord(c):04x}" for c in content)
    assert read.words == shown


@given(title=hostile, words=hostile)
def test_a_document_runs_and_loads_nothing(title, words):
    html = document(title, "p { color: black; }", tag("p", words))
    read = _Read(html)
    names = [name for name, _ in read.elements]
    assert names == ["html", "head", "meta", "meta", "meta", "title", "style", "body", "p"]
    policy = next(a["content"] for _, a in read.elements if a.get("http-equiv"))
    assert policy == "default-src 'none'; style-src 'unsafe-inline'"
