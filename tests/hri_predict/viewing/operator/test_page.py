"""The operator's page over real HTTP, and in a real browser."""

import contextlib
import http.client
import json
import socket
import threading
import time
from datetime import UTC, datetime
from urllib.parse import urlsplit

import pytest

from hri_predict.viewing.feed import OPERATOR
from hri_predict.viewing.operator.server import MAX_BROWSERS, MAX_CONNECTIONS, Server
from hri_predict.viewing.operator.state import State
from hri_predict.viewing.picture import Picture, empty_shapes
from tests.browser import CHROMIUM, Browser, wait_for
from tests.hri_predict.viewing.shown import Shown


def picture(level: str, reason: str = "a person is too close", number: int = 1) -> Picture:
    robot = {"name": "arm", "level": level, "reason": reason, "clears": "they go", "latch": 0}
    robot |= {"near": "person 1's left hand, 0.67 m from the forearm"}
    robot |= {"limit_m_s": None, "separation_m": 0.5}
    change = {"number": number, "level": level, "robot": 0, "reason": reason, "utc_s": 1.7e9}
    facts = {"robots": [robot], "room": {"cell": "press-4"}, "tracked": 1, "people": [1, 2]}
    facts |= {"state": "RUNNING", "reasons": [], "age_s": 0.03, "changes": [change]}
    return Picture(facts, **empty_shapes())


@pytest.fixture
def server():
    made = Server(host="127.0.0.1", port=0, state=State(), request_s=0.5)
    threading.Thread(target=made.serve_forever, args=(0.05,), daemon=True).start()
    yield made
    made.state.end()
    made.shutdown()
    made.server_close()


def ask(server, method="GET", path="/", body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    return answer, answer.read() if path != "/events" else b""


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/", "html"),
        ("/page.js", "javascript"),
        ("/page.css", "css"),
        ("/common.js", "javascript"),
        ("/common.css", "css"),
        ("/looks.js", "javascript"),
        ("/looks.css", "css"),
    ],
)
def test_a_page_and_its_parts_come_from_here_alone(server, path, kind):
    answer, body = ask(server, path=path)
    assert answer.status == 200
    assert kind in answer.headers["Content-Type"]
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert b"://" not in body.replace(b"http://www.w3.org/2000/svg", b"")


@pytest.mark.parametrize("path", ["/nothing", "/../page.py", "/server.py", "/fleet.js", "//etc"])
def test_other_pages_are_not_there(server, path):
    assert ask(server, path=path)[0].status == 404


def test_a_name_of_another_server_is_refused(server):
    """Somebody else's page whose name leads here must not read where people are."""
    assert ask(server, Host="evil.example:80")[0].status == 403
    assert ask(server, path="/events", Host="evil.example")[0].status == 403
    assert ask(server, Host="localhost:1")[0].status == 200


def test_another_sites_page_marks_no_alert_as_read(server):
    server.state.take(picture("STOP"), time.monotonic())
    said = json.dumps({"number": 1})
    answer, _ = ask(server, "POST", "/acknowledge", said, Origin="http://evil.example")
    assert answer.status == 403
    assert not server.state.history.rows()[0]["read"]


def test_an_alert_is_marked_as_read_for_everybody(server):
    server.state.take(picture("STOP"), time.monotonic())
    said = json.dumps({"number": 1})
    assert ask(server, "POST", "/acknowledge", said)[0].status == 204
    assert server.state.told()["history"][0]["read"]
    assert server.state.told()["levels"][0]["level"] == "STOP"  # the stop stands


def test_all_alerts_that_somebody_saw_are_marked_and_no_later_one(server):
    for number in (1, 2, 3):
        server.state.take(picture("STOP", number=number), time.monotonic())
    assert ask(server, "POST", "/acknowledge", '{"up_to": 2}')[0].status == 204
    assert [row["read"] for row in server.state.history.rows()] == [False, True, True]


WRONG = ["", "{", "[]", "{}", '{"number": true}', '{"number": "1"}', 2000 * "[", '{"number": 1.5}']
WRONG += ['{"number": 1, "up_to": 1}', '{"others": 1}', '{"up_to": null}']


@pytest.mark.parametrize("body", WRONG)
def test_other_bodies_are_refused(server, body):
    assert ask(server, "POST", "/acknowledge", body)[0].status == 400


def test_an_alert_that_is_not_there_is_said_so(server):
    assert ask(server, "POST", "/acknowledge", '{"number": 9}')[0].status == 404


def test_events_tell_the_level_and_then_that_the_node_ended(server):
    server.state.take(picture("SLOW"), time.monotonic())
    answer, _ = ask(server, path="/events")
    first = json.loads(answer.fp.readline().removeprefix(b"data: "))
    assert first["known"]
    assert first["levels"][0]["level"] == "SLOW"
    assert (first["people"], first["lost"]) == (1, 1)
    server.state.end()
    last = [json.loads(line.removeprefix(b"data: ")) for line in answer.fp if line.strip()][-1]
    assert not last["known"]
    assert last["why"] == "the node has ended"


@pytest.mark.parametrize("host", ["[", "[::1", "a b"])
def test_what_is_no_host_is_refused_with_an_answer(server, host):
    assert ask(server, Host=host)[0].status == 403
    assert ask(server, Origin=f"http://{host}")[0].status == 403


def open_to(server):
    return socket.create_connection(("127.0.0.1", server.server_port), timeout=10)


def is_closed(connection):
    try:
        return connection.recv(1) == b""
    except OSError:
        return True


def test_a_client_that_sends_byte_after_byte_is_cut_off(server):
    with open_to(server) as slow:
        began = time.monotonic()
        slow.settimeout(0.05)
        while time.monotonic() - began < 8.0:
            try:
                slow.send(b"G")
                if slow.recv(1) == b"":
                    break
            except TimeoutError:
                continue
            except OSError:
                break
        assert time.monotonic() - began < 5.0


def test_connections_beyond_the_most_are_closed_and_browsers_find_room_afterwards(server):
    with contextlib.ExitStack() as held:
        silent = [held.enter_context(open_to(server)) for _ in range(MAX_CONNECTIONS)]
        with open_to(server) as one_more:
            assert is_closed(one_more)
        assert all(is_closed(each) for each in silent)  # their time is over, too
    assert ask(server)[0].status == 200


def test_a_browser_that_listens_is_not_cut_off(server):
    server.state.take(picture("CLEAR"), time.monotonic())
    answer, _ = ask(server, path="/events")
    began = time.monotonic()
    while time.monotonic() - began < 3 * server.request_s:
        assert answer.fp.readline()


def test_alerts_are_told_again_only_when_they_change(server):
    server.state.take(picture("SLOW"), time.monotonic())
    answer, _ = ask(server, path="/events")
    told = (json.loads(line.removeprefix(b"data: ")) for line in answer.fp if line.strip())
    assert "history" in next(told)
    server.state.take(picture("SLOW"), time.monotonic())
    assert "history" not in next(told)
    server.state.acknowledge(1)
    again = next(said for said in told if "history" in said)
    assert again["history"][0]["read"]


def test_an_alert_is_told_sooner_than_a_number(server):
    server.state.take(picture("SLOW"), time.monotonic())
    answer, _ = ask(server, path="/events")
    told = (json.loads(line.removeprefix(b"data: ")) for line in answer.fp if line.strip())
    next(told)
    since = time.monotonic()
    server.state.take(picture("STOP", number=2), time.monotonic())
    assert next(told)["levels"][0]["level"] == "STOP"
    assert time.monotonic() - since < State.told_s  # 0.05 s, and 0.15 s for a busy machine


def test_a_picture_that_waited_in_the_pipe_is_as_old_as_it_is():
    state, late = State(), picture("CLEAR")
    late.facts["made_s"] = time.monotonic() - 1.5
    state.take(late, time.monotonic())
    assert not state.told()["known"]


def test_of_a_silent_node_no_level_is_told():
    state = State()
    state.take(picture("CLEAR"), time.monotonic() - 1.5)
    said = state.told()
    assert not said["known"]
    assert "levels" not in said
    assert "nothing from the node" in said["why"]
    assert not State().told()["known"]


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_shows_the_level_and_turns_grey_when_the_node_is_lost():
    shape = "document.querySelector('.robot polygon, .robot circle').getAttribute('points')"
    colour = "getComputedStyle(document.querySelector('.robot')).backgroundColor"
    with Shown(OPERATOR) as page, Browser(1000, 600) as browser:
        page.show(picture("CLEAR", "nothing is near"))
        browser.open(page.url)
        browser.wait_for_text("CLEAR")
        green = browser.evaluate(colour)

        page.show(picture("STOP", "<img src=x onerror=alert(1)> & one", 2))
        browser.wait_for_text("<img src=x onerror=alert(1)> & one")  # as text
        assert "Clears when they go." in browser.text()
        assert browser.evaluate("document.querySelector('.word').textContent") == "STOP"
        assert len(browser.evaluate(shape).split(" ")) == 8  # the octagon
        assert browser.evaluate("document.images.length") == 0
        assert browser.evaluate(colour) != green

        unread = "document.querySelectorAll('li button').length"
        assert browser.evaluate(unread) == 1
        browser.evaluate("document.querySelector('li button').click()")
        deadline = time.monotonic() + 5
        while browser.evaluate(unread) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert browser.evaluate(unread) == 0
        assert browser.evaluate("document.querySelector('.word').textContent") == "STOP"

        page.show(picture("CLEAR", "nothing is near", 3))
        browser.wait_for_text("nothing is near")
        page.show(None)  # the node hangs
        since = time.monotonic()
        browser.wait_for_text("NO CONTACT", 10)
        assert time.monotonic() - since < 2.5  # two seconds, and the browser's answer
        assert browser.evaluate(colour) not in (green, "")

        page.show(picture("CLEAR", "nothing is near", 3))
        browser.wait_for_text("nothing is near")
        page.process.kill()  # the page's own process dies: the browser itself must notice
        since = time.monotonic()
        browser.wait_for_text("NO CONTACT", 10)
        assert time.monotonic() - since < 2.5
        assert browser.console == []


def test_why_the_node_is_degraded_and_how_old_the_picture_is_are_told():
    state, now = State(), picture("STOP")
    assert state.told()["silent_s"] is None  # none came
    now.facts.update({"state": "DEGRADED", "reasons": ["the predictor was late"]})
    state.take(now, time.monotonic() - 0.5)
    said = state.told()
    assert (said["state"], said["reasons"]) == ("degraded", ["the predictor was late"])
    assert said["levels"][0]["near"] == "person 1's left hand, 0.67 m from the forearm"
    assert 0.5 <= said["silent_s"] < 1.0


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_says_who_is_near_what_is_wrong_and_times_in_utc_too():
    when = "document.querySelector('li .when').textContent"
    command = "document.querySelector('li').title"
    now = picture("STOP")
    now.facts.update({"state": "DEGRADED", "reasons": ["the predictor was late"]})
    with Shown(OPERATOR) as page, Browser(1000, 600) as browser:
        browser.ask("Emulation.setTimezoneOverride", timezoneId="Europe/Berlin")
        page.show(now)
        browser.open(page.url)
        browser.wait_for_text("person 1's left hand, 0.67 m from the forearm")
        assert "node degraded: the predictor was late" in browser.text()
        assert browser.evaluate(when) == "23:13:20, 22:13:20 UTC"
        asked = "hri-predict explain RECORDING --at 2023-11-14T22:13:20"
        assert browser.evaluate(command) == asked
        browser.ask("Emulation.setTimezoneOverride", timezoneId="UTC")
        page.show(picture("WARN", number=2))
        browser.wait_for_text("WARN")
        wait_for(lambda: browser.evaluate(when) == "22:13:20", 5)
        assert browser.evaluate(command) == ""  # it slowed nothing

        page.show(None)
        browser.wait_for_text("NO CONTACT", 10)
        near = "document.querySelector('.near').textContent"
        since = browser.evaluate(near)
        began = datetime.strptime(since, "since %H:%M:%S")
        passed_s = (datetime.now(UTC).replace(tzinfo=None) - began).total_seconds() % 43_200
        assert 1.0 <= passed_s < 8.0  # it has been silent for a second, and the browser answered
        page.process.kill()
        browser.wait_for_text("this page lost the node", 10)
        assert browser.evaluate(near) == since
        assert browser.console == []


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_that_was_one_too_many_asks_again():
    with Shown(OPERATOR) as page, Browser(1000, 600) as browser:
        page.show(picture("SLOW"))
        address = urlsplit(page.url)
        held = []  # answers: each holds its connection open
        for _ in range(MAX_BROWSERS):
            connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=10)
            connection.request("GET", "/events")
            held.append(connection.getresponse())
            assert held[-1].status == 200
        browser.open(page.url)
        browser.wait_for_text("waiting for the node")
        time.sleep(1.0)  # it is refused meanwhile
        for each in held:
            each.close()
        browser.wait_for_text("SLOW", 15)


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_after_a_sleep_of_the_computer_only_a_new_connection_is_believed():
    """Its performance.now() may have stood still: what waited in the connection seems new."""
    with Shown(OPERATOR) as page, Browser(1000, 600) as browser:
        page.show(picture("CLEAR", "nothing is near"))
        browser.open(page.url)
        browser.wait_for_text("nothing is near")
        browser.evaluate(
            "const source = EventSource, now = Date.now, opened = [];"
            "window.opened = opened;"
            "window.EventSource = class { constructor() { opened.push(1); }"
            "  addEventListener() {} close() {} };"  # the network is not back yet
            "Date.now = () => now() + 600000; window.back = () => { EventSource = source; };"
        )
        since = time.monotonic()
        browser.wait_for_text("this page lost the node", 5)
        assert time.monotonic() - since < 1.4  # not by the silence of GONE_MS
        time.sleep(1.0)  # the old connection still brings CLEAR
        assert browser.evaluate("document.querySelector('.word').textContent") == "NO CONTACT"
        assert browser.evaluate("opened.length") == 1  # once for each sleep
        browser.evaluate("back(); Date.now = now;")  # and the clock is set: asked again
        wait_for(
            lambda: browser.evaluate("document.querySelector('.word').textContent") == "CLEAR", 5
        )
        assert browser.console == []
