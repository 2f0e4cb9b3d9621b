"""What Prometheus reads, by its own client's parser; what /healthz says; hostile clients."""

import json
import math
import re
import socket
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.contracts.link import LinkCounters
from hri_predict.contracts.source import SourceCounters
from hri_predict.node.listeners import Tick
from hri_predict.node.shedding import Shedding
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.operation.service.exposition import Family, Sample, as_text
from hri_predict.operation.service.figures import Figures
from hri_predict.operation.service.server import CONNECTIONS, KEEP_S, MetricsServer
from hri_predict.operation.service.settings import MetricsSettings
from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import Reason
from tests.messages import make_advice, make_status
from tests.waiting import free_port

DASHBOARD = data_path("service", "grafana.json")


class Counting:
    """A node, a link and a live source that have counted something."""

    assess_failures = listener_failures = acknowledges_refused = 0
    acknowledges = 3
    acknowledges_not_counted: dict[str, int] = {}
    strange_states = 0
    robot_counters = {"robot_stale": 2}
    name, connected = 'line "1"\\', True

    def __init__(self):
        self.shedding = Shedding()
        self.counters = LinkCounters(messages_sent=7, bytes_sent=70, crc_errors=1)


class Live:
    def __init__(self):
        self.arrived, self.connected, self.stamps_utc = threading.Event(), True, True
        self.counters = SourceCounters(packets=5, lost=2)
        self.live = self


class Snapshot:
    ids, lost, counters = (1, 2), (object(),), {"appeared": 2}


def tick(level=Level.SLOW, state=NodeState.RUNNING):
    status = make_status(people=3, node_state=state, capture_ns=900_000_000)
    advice = make_advice(level, Reason.PERSON_NEAR, speed_limit_m_s=0.25, separation_m=1.5)
    return Tick(
        now_ns=1_000_000_000,
        status=status,
        advices=(advice,),
        snapshot=Snapshot(),  # type: ignore[arg-type]
        forecast=None,
        assessment=None,
        messages=(),
    )


def figures(now_s=lambda: 10.0, pace=None):
    counting = Counting()
    return Figures(
        node=counting,  # type: ignore[arg-type]
        source=Live(),
        links=[counting],  # type: ignore[list-item]
        pace=pace or Pace(),
        robots=["arm"],
        version="1.2.3",
        healthy_s=0.2,
        others=lambda: {"recorder_dropped": 4},
        monotonic_s=now_s,
    )


def parsed(text):
    """(name, labels) -> value, as Prometheus's own client reads the text."""
    return {
        (s.name, tuple(sorted(s.labels.items()))): s.value
        for family in text_string_to_metric_families(text)
        for s in family.samples
    }


def test_prometheus_reads_what_the_tick_and_the_counters_said():
    pace = Pace()
    for seconds in (0.0005, 0.004, 0.004, 3.0):
        pace.note(seconds)
    shown = figures(pace=pace)
    shown.on_tick(tick())
    read = parsed(as_text(shown.families()))
    arm = ("robot", "arm")
    assert read[("hri_build_info", (("version", "1.2.3"),))] == 1
    assert read[("hri_robot_level", (("level", "slow"), arm))] == 1
    assert read[("hri_robot_level", (("level", "clear"), arm))] == 0
    assert read[("hri_robot_speed_limit_meters_per_second", (arm,))] == 0.25
    assert read[("hri_robot_separation_meters", (arm,))] == 1.5
    assert read[("hri_input_age_seconds", ())] == pytest.approx(0.1)
    assert (read[("hri_people", ())], read[("hri_people_lost", ())]) == (2, 1)
    assert read[("hri_ticks_total", ())] == 4
    assert read[("hri_tick_duration_seconds_bucket", (("le", "0.005"),))] == 3
    assert read[("hri_tick_duration_seconds_bucket", (("le", "+Inf"),))] == 4
    assert read[("hri_tick_duration_seconds_sum", ())] == pytest.approx(3.0085)
    link = ("link", 'line "1"\\')
    assert read[("hri_link_events_total", (("event", "crc_errors"), link))] == 1
    assert read[("hri_link_sent_bytes_total", (link,))] == 70
    assert read[("hri_source_events_total", (("event", "lost"),))] == 2
    assert read[("hri_events_total", (("event", "recorder_dropped"),))] == 4


def test_names_follow_the_conventions():
    shown = figures()
    shown.on_tick(tick())
    for family in shown.families():
        assert re.fullmatch(r"hri_[a-z_]+", family.name)
        assert family.name.endswith("_total") == (family.kind == "counter"), family.name
        assert not re.search(r"_(ms|mm|km|percent|minutes)\b", family.name)
        assert len(family.samples) < 50, family.name  # few labels


@given(st.text(), st.floats())
def test_any_label_and_value_is_read_back_as_it_was(label, value):
    name = "hri_test"
    family = Family(
        name=name, kind="gauge", help="h", samples=[Sample(value=value, labels={"a": label})]
    )
    ((_, labels), got) = next(iter(parsed(as_text([family])).items()))
    assert dict(labels)["a"] == label
    assert got == value or (math.isnan(got) and math.isnan(value))


def test_a_loop_that_stands_still_is_unhealthy_and_its_level_is_unknown():
    now = [10.0]
    shown = figures(lambda: now[0])
    assert shown.health() == (False, {"ok": False, "why": "no tick yet"})
    shown.on_tick(tick(Level.CLEAR))
    now[0] = 10.19
    assert shown.health()[0]
    now[0] = 10.21
    is_well, said = shown.health()
    assert not is_well
    assert said["levels"] == {"arm": "unknown"}
    read = parsed(as_text(shown.families()))
    arm = ("robot", "arm")
    assert read[("hri_robot_level", (("level", "clear"), arm))] == 0
    assert read[("hri_robot_level", (("level", "unknown"), arm))] == 1
    assert ("hri_robot_separation_meters", (arm,)) not in read
    assert read[("hri_input_age_seconds", ())] == pytest.approx(0.31)


def test_every_metric_of_the_dashboard_exists():
    dashboard = json.loads(DASHBOARD.read_text(encoding="utf-8"))
    texts = [t["expr"] for panel in dashboard["panels"] for t in panel.get("targets", [])]
    texts += [v["definition"] for v in dashboard["templating"]["list"] if "definition" in v]
    shown = figures()
    shown.on_tick(tick())
    names = {name for name, _ in parsed(as_text(shown.families()))}
    used = {name for text in texts for name in re.findall(r"hri_\w+", text)}
    assert len(used) >= 10
    assert used <= names
    ids = [panel["id"] for panel in dashboard["panels"]]
    assert len(ids) == len(set(ids))


@pytest.fixture
def server():
    shown = figures()
    shown.on_tick(tick())
    port = free_port()
    one = MetricsServer(MetricsSettings(port=port), shown, request_s=0.4)
    yield one, port
    one.close()


def asked(port, request, timeout_s=60.0):
    with socket.create_connection(("127.0.0.1", port), timeout_s) as s:
        s.sendall(request)
        answer = b""
        try:
            while data := s.recv(65536):
                answer += data
        except ConnectionError:
            pass
        return answer


def get(port, path):
    return asked(port, f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())


def test_both_pages_are_answered_and_others_are_not(server):
    _, port = server
    head, _, body = get(port, "/metrics").partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK")
    assert b"text/plain; version=0.0.4" in head
    assert parsed(body.decode())[("hri_healthy", ())] == 1
    head, _, body = get(port, "/healthz?verbose").partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK")
    assert json.loads(body)["levels"] == {"arm": "slow"}
    assert get(port, "/").startswith(b"HTTP/1.1 404")
    assert asked(port, b"POST /metrics HTTP/1.1\r\n\r\n").startswith(b"HTTP/1.1 405")
    assert asked(port, b"\x00\xff\r\n\r\n").startswith(b"HTTP/1.1 400")
    assert asked(port, b"HEAD /metrics HTTP/1.1\r\n\r\n").endswith(b"\r\n\r\n")


def test_slow_silent_and_endless_clients_are_ended_and_others_are_served(server):
    one, port = server
    silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(CONNECTIONS + 4)]
    end = time.monotonic() + 60.0
    while one.refused < 4 and time.monotonic() < end:
        time.sleep(0.01)
    assert one.refused >= 4  # there is room for some only
    slow = time.monotonic() + 60.0
    while one.failed < CONNECTIONS and time.monotonic() < slow:
        time.sleep(0.02)
    assert get(port, "/healthz").startswith(b"HTTP/1.1 200")  # their time was over
    for each in silent:
        each.close()
    failed = one.failed
    asked(port, b"GET /" + b"x" * 100_000)  # no end of its first line
    end = time.monotonic() + 60.0
    while one.failed == failed and time.monotonic() < end:
        time.sleep(0.01)
    assert one.failed > failed
    assert get(port, "/healthz").startswith(b"HTTP/1.1 200")


def test_a_flood_of_requests_makes_the_text_seldom(server):
    one, port = server
    made = []
    families = one._figures.families

    def counted():
        made.append(1)
        return families()

    one._figures.families = counted
    began = time.monotonic()
    for _ in range(20):
        assert get(port, "/metrics").startswith(b"HTTP/1.1 200")
    assert 1 <= len(made) <= 1 + (time.monotonic() - began) / KEEP_S


def test_a_port_in_use_is_one_line_with_the_remedy(server):
    _, port = server
    with pytest.raises(ConfigError, match=rf"port {port}: .*choose another"):
        MetricsServer(MetricsSettings(port=port), figures())


def test_it_listens_on_this_machine_alone_unless_configured():
    assert MetricsSettings(port=9477).host == "127.0.0.1"


def test_a_closed_server_gives_its_port_back():
    port = free_port()
    for _ in range(2):
        MetricsServer(MetricsSettings(port=port), figures()).close()
