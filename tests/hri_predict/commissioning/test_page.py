"""The page: whatever came from outside stays text, and nothing is loaded from anywhere."""

from html.parser import HTMLParser
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.commissioning.folder import page_of
from hri_predict.commissioning.identity import File
from hri_predict.commissioning.report import (
    Curve,
    Echo,
    GridResult,
    LinkEcho,
    Registration,
    Report,
    RobotAdvice,
    Signature,
    Stop,
    Stopping,
    Times,
    TouchedPoint,
    Walk,
)
from tests.hri_predict.commissioning.test_report import IDENTITY, report, step

TAGS = {
    "html", "head", "meta", "title", "style", "body", "h1", "h2", "h3", "p", "span", "table",
    "thead", "tbody", "tr", "th", "td", "ul", "li", "div", "figure", "figcaption", "strong",
    "svg", "rect", "line", "text", "circle", "polyline",
}  # fmt: skip
EVIL = "<script>alert('x')</script>\"'><img src=x onerror=alert(1)>&amp;\x00\u202e"


class Read(HTMLParser):
    """The elements, attributes and texts of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.texts: list[str] = []
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        if tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def whole(evil: str = "arm") -> Report:
    """A report with every step, and this text wherever a text can come from outside."""
    times = Times(count=3, p50_ms=1, p99_ms=2, max_ms=3, bins=[0, 1, 2])
    link = LinkEcho(
        link=evil, states=3, echoes=3, in_node=times, round_trip=times,
        measured_by="controller", both_ways_ms=1.0, allowed_ms=10.0,
    )  # fmt: skip
    stop = Stop(
        robot=evil, stated_m_s=0.5, speed_m_s=0.5, total_s=0.2, total_m=0.1, braking_s=0.15,
        braking_m=0.05, table_s=0.2, table_m=0.1, allowed_s=0.3, allowed_m=0.2, resolution_s=0.02,
        measured_by="node", stood=True, passed=True,
    )  # fmt: skip
    curve = Curve(robot=evil, speed_m_s=[0.5, 1.0], time_s=[0.2, 0.3], distance_m=[0.1, 0.2])
    grid = GridResult(
        cell_m=0.25, origin=[-1, -1], columns=8, rows=8, area=[1, 2, 3], outside=[5],
        seen={2: 4, 9: 1}, lost={3: 1},
    )  # fmt: skip
    advice = RobotAdvice(
        robot=evil, ticks_at={"stop": 3}, stops=1, first_stop_s=0.1, least_separation_m=None,
        least_limit_m_s=0.0, mean_limit_m_s=0.0,
    )  # fmt: skip
    point = TouchedPoint(
        point=[0, 0, 0], seen=[0, 0, 0], spread_m=0.01, error_m=0.01, residual_m=0.01
    )
    results = {
        "registration": Registration(
            joint=evil, tolerance_m=0.05, points=[point], scale=1.0, written=True
        ),
        "echo": Echo(seconds=3, links=[link]),
        "stopping": Stopping(stops=[stop], curves=[curve]),
        "walk": Walk(
            recording="walk.mcap", recording_sha256="0" * 64, advices="advices.jsonl",
            advices_sha256=evil, seconds=3, least_coverage=0.5, exclude=[], grid=grid,
            robots=[advice], people_lost=1,
        ),
    }  # fmt: skip
    identity = IDENTITY.model_copy(
        update={"config": {evil: evil}, "files": {evil: File(path=evil, sha256=evil)}}
    )
    made = report(
        steps={
            name: step("failed", by=evil, note=evil, why=[evil], simulated=True, result=result)
            for name, result in results.items()
        },
        notes=[evil],
        signatures=[Signature(role=evil, name=evil, date=evil)],
    )
    return made.model_copy(update={"cell": evil, "identity": identity})


@pytest.mark.parametrize("made", [whole(), report(), report(steps={"walk": None})])
def test_it_is_well_formed_and_loads_nothing(made):
    read = Read(page_of(made, "0" * 64))
    assert read.open == []
    assert read.tags <= TAGS
    assert not {"src", "href", "style", "srcset", "action"} & read.attributes
    assert "default-src 'none'" in page_of(made, "").replace("&#x27;", "'")


@given(st.text(max_size=40) | st.just(EVIL))
def test_a_text_from_outside_adds_no_element_and_no_attribute(evil):
    plain, read = Read(page_of(whole(), "")), Read(page_of(whole(evil), evil))
    assert read.tags == plain.tags
    assert read.attributes == plain.attributes
    assert read.open == []


def test_a_text_from_outside_can_be_read_and_controls_are_shown():
    read = Read(page_of(whole(EVIL), ""))
    assert sum("<script>alert('x')</script>" in each for each in read.texts) > 10
    page = page_of(whole(EVIL), "")
    assert "\x00" not in page
    assert "\u202e" not in page


def test_what_matters_is_on_it():
    page = page_of(whole(), "f" * 64)
    for word in ("SIMULATED", "failed", "f" * 64, IDENTITY.config_hash, "Signatures", "33 %"):
        assert word in page


def test_settings_that_are_less_safe_have_a_place_for_who_accepts_them():
    line = "people.found_within_s: 2 (default 0.5): a body may end a lost person"
    page = page_of(whole().model_copy(update={"less_safe": [line]}), "")
    assert "less safe than their defaults" in page
    assert "people.found_within_s" in page
    assert "accepted by" in page
    assert "accepted by" not in page_of(whole(), "")
