"""English: the counts of habits that make a native reader stop only fall."""

import pytest

from tests import english
from tests.english import OPENING, Text, counts, differences, paragraphs, read_table, texts_of


def habits_of(text: str, *, is_docstring: bool = False) -> list[str]:
    return [name for name, _ in Text(1, text, is_docstring).habits()]


def test_the_counts_are_those_of_the_table():
    """Lists the places of a room: ``python -m tests.english ROOM``; lowers: ``--write``."""
    assert differences(counts(), read_table()) == []


@pytest.mark.parametrize(
    ("habit", "text"),
    [
        ("so many", "So many windows are kept in memory."),
        ("so many", "The means of two parts may be so far apart."),
        ("whoever", "whoever has a class from the registry knows neither"),
        ("is no", "url: is no address"),
        ("somebody", "nobody asked"),
        ("told", "the loop tells the links"),
        ("beside", "errors beside those of links"),
        ("odd", "the cache is made anew"),
    ],
)
def test_a_habit_is_found_in_any_text(habit, text):
    assert habits_of(text) == [habit]


@pytest.mark.parametrize(
    "text",
    [
        "It is so long that it is cut.",
        "Packets received so far.",
        "There is no file.",
        "The robot is no longer in view.",
        "It cannot tell the two people apart.",
        "A person stands beside the robot.",
        "Every body has a torso.",
        "The option ``whatever`` is gone.",
    ],
)
def test_what_a_native_writes_is_not_counted(text):
    assert habits_of(text) == []


def test_a_docstring_that_opens_with_a_question_word_is_counted_and_an_error_is_not():
    assert habits_of("What a link sends.", is_docstring=True) == [OPENING]
    assert habits_of("Of a link, the newest.", is_docstring=True) == [OPENING]
    assert habits_of("Whether a link sends.", is_docstring=True) == []
    assert habits_of("What a link sends.") == []


def test_docstrings_and_strings_are_read_and_comments_are_not():
    source = '''"""A module."""
# anew
def f(x):
    """Return x."""
    raise ValueError(f"{x}: is "
                     "no number")
'''
    assert sorted((t.text, t.is_docstring) for t in texts_of(source)) == [
        (": is no number", False),
        ("A module.", True),
        ("Return x.", True),
    ]


def test_code_blocks_of_a_page_are_not_read():
    page = "# A page\n\n```sh\necho anew\n```\n\nThe end.\n"
    assert [(t.line, t.text) for t in paragraphs(page)] == [(1, "# A page"), (7, "The end.")]


def test_the_table_is_lowered_and_never_raised(tmp_path, monkeypatch, capsys):
    table = tmp_path / "english.txt"
    monkeypatch.setattr(english, "TABLE", table)
    monkeypatch.setattr(english, "counts", lambda: {("base", "told"): 2, ("cli", OPENING): 1})
    table.write_text("base told 3\ncli What ... 1\n", encoding="utf-8")
    assert english.main(["--write"]) == 0
    assert read_table() == {("base", "told"): 2, ("cli", OPENING): 1}
    table.write_text("base told 1\ncli What ... 1\n", encoding="utf-8")
    assert english.main(["--write"]) == 1
    assert "base: 'told' 1 -> 2" in capsys.readouterr().out
    assert read_table()[("base", "told")] == 1
