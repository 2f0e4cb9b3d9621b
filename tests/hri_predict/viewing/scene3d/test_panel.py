from hri_predict.viewing.levels import COLOURS, GREY, css, worst
from hri_predict.viewing.scene3d.panel import details, head, legend, strip

ROBOT = {"name": "<arm>", "level": "CLEAR", "reason": "nothing & nobody", "clears": ""} | {
    "detail": "",
    "limit_m_s": 1.0,
    "separation_m": None,
    "speed_m_s": 0.25,
    "pair": "",
}
FACTS = {"robots": [ROBOT], "state": "RUNNING", "people": [3, 7], "tracked": 1, "age_s": 0.02} | {
    "rate_hz": 25.0,
    "coverage": "99% of each joint",
    "reasons": [],
}


def test_names_and_reasons_are_text():
    html = head(FACTS) + details(FACTS)
    assert "<arm>" not in html
    assert "&lt;arm&gt;: CLEAR" in html
    assert "nothing &amp; nobody" in html


def test_why_a_node_is_degraded_stands_beside_it():
    facts = FACTS | {"state": "DEGRADED", "reasons": ["the predictor was late", "no room"]}
    assert ">degraded: the predictor was late; no room<" in details(facts)
    assert ">running<" in details(FACTS)


def test_the_detail_repeats_neither_the_reason_nor_its_note():
    reason = "no person is too close; note: a person is fast"
    detail = f"<arm>: {reason}; person 1 is fast: left hand 2.7 m/s"
    html = details(FACTS | {"robots": [ROBOT | {"reason": reason, "detail": detail}]})
    assert html.count("no person is too close") == 1
    assert ">person 1 is fast: left hand 2.7 m/s<" in html


def test_lost_people_are_named():
    assert "1, lost: 7" in details(FACTS)


def test_the_legend_says_that_parts_of_a_body_may_be_inferred():
    assert "person as captured; parts that no sensor sees are inferred" in legend()


def test_a_picture_that_is_not_of_now_is_grey():
    assert css(COLOURS["CLEAR"]) in head(FACTS)
    stale = head(FACTS, stale="nothing for 3 s")
    assert css(COLOURS["CLEAR"]) not in stale
    assert css(GREY) in stale
    assert "nothing for 3 s" in stale


def test_what_is_of_now_is_covered_unless_it_comes_again():
    assert head(FACTS, beat=1) != head(FACTS, beat=2)  # only what differs starts the time anew
    assert "animation" in head(FACTS)
    assert "animation" not in head(FACTS, stale="the node ended") + head(FACTS, when="12:00:00")


def test_a_timeline_has_a_part_for_each_level():
    html = strip(["CLEAR", "CLEAR", "STOP", ""])
    assert f"{css(COLOURS['CLEAR'])} 0.00% 50.00%" in html
    assert f"{css(COLOURS['STOP'])} 50.00% 75.00%" in html
    assert f"{css(GREY)} 75.00% 100.00%" in html


def test_unknown_is_worse_than_stop_and_nobody_is_unknown():
    assert worst(["CLEAR", "STOP", "UNKNOWN"]) == "UNKNOWN"
    assert worst(["WARN", "CLEAR"]) == "WARN"
    assert worst(["odd"]) == worst([]) == "UNKNOWN"
