"""Foxglove live: the topics of a recording to any client, and no client can delay the node."""

import itertools
import json
import resource
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import jsonschema
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.check import examine
from hri_predict.operation.foxglove.live import LEFT_OUT, QUEUE_ITEMS, FoxgloveLive
from hri_predict.operation.foxglove.settings import FoxgloveSettings
from hri_predict.recording.mcap.clocks import VirtualClocks
from hri_predict.recording.mcap.items import Item
from hri_predict.recording.mcap.schemas import schemas
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run
from tests.hri_predict.operation.service.cells import cell, written
from tests.hri_predict.recording.mcap.made_up import info, scene, tick

pytest.importorskip("foxglove", reason="needs the extra foxglove")
pytest.importorskip("websockets", reason="needs the extra websocket")
from tests.hri_predict.operation.foxglove.viewers import Viewer, stalled
from tests.waiting import eventually, free_port

ROOT = Path(__file__).resolve().parents[4]
UTC_NS = 1_790_000_000 * 10**9
TICKED = {"/status", "/advice/arm", "/forecast", "/zones", "/view/scene", "/view/people"}


@pytest.fixture
def live():
    settings = FoxgloveSettings(port=free_port(), zones_hz=100, poses_hz=100, view_hz=100)
    one = FoxgloveLive(settings, info(), clocks=VirtualClocks(0, UTC_NS))
    yield one
    one.close()


@pytest.fixture
def viewer(live):
    one = Viewer(live.port)
    yield one
    one.close()


def subscribed(live, viewer, *topics):
    viewer.subscribe(*topics)
    eventually(lambda: all(live.wants(topic) for topic in topics))


def test_it_offers_the_topics_and_schemas_of_a_recording(live, viewer):
    expected = {t: s for t, s in schemas(["arm"]).items() if t not in LEFT_OUT}
    assert set(viewer.channels) == set(expected)
    for topic, channel in viewer.channels.items():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        assert json.loads(channel["schema"]) == expected[topic]
    assert viewer.server["capabilities"] == []  # a client can send nothing


def test_more_clients_than_the_limit_are_ended_counted_and_said_once(caplog):
    settings = FoxgloveSettings(port=free_port(), max_clients=2)
    one = FoxgloveLive(settings, info(), clocks=VirtualClocks(0, UTC_NS))
    try:
        first = Viewer(one.port)
        crowd = [socket.create_connection(("127.0.0.1", one.port)) for _ in range(12)]
        eventually(lambda: one.counts()["foxglove_refused"] >= 11)
        for each in crowd:
            each.close()
        subscribed(one, first, "/status")  # the one that was there first is served
        first.close()
        assert sum("max_clients" in each.message for each in caplog.records) == 1
    finally:
        one.close()


def test_two_clients_get_scene_and_tick_as_they_are_recorded(live, viewer):
    other, wanted = Viewer(live.port), TICKED | {"/scene"}
    got: dict[Viewer, dict] = {viewer: {}, other: {}}

    def read(each):
        while wanted > set(got[each]):
            topic, at_ns, data = each.message()
            got[each].setdefault(topic, (at_ns, json.loads(data)))

    readers = [threading.Thread(target=read, args=[each]) for each in got]
    for each, reader in zip(got, readers, strict=True):
        each.subscribe(*wanted)
        reader.start()
    ticks = itertools.count(1)

    def are_done():
        k = next(ticks)
        live.on_scene(scene(k), 40_000_000 * k)
        live.on_tick(tick(k))
        return not any(reader.is_alive() for reader in readers)

    eventually(are_done)
    for found in got.values():
        for topic, (at_ns, data) in found.items():
            jsonschema.validate(data, schemas(["arm"])[topic])
            assert at_ns % 40_000_000 == 0
            assert at_ns > UTC_NS
        assert found["/advice/arm"][1]["level"] == "SLOW"
        assert len(found["/scene"][1]["people"]) == 1
    other.close()


def test_without_a_client_nothing_is_made_of_a_tick(live):
    assert not live.is_watched
    live.on_tick(None)  # would fail if it were looked at
    live.on_scene(None, 0)
    assert live.counts() == dict.fromkeys(live.counts(), 0)


def test_a_thread_that_does_not_keep_up_loses_the_oldest_and_counts(live, viewer):
    subscribed(live, viewer, "/scene")
    entered, go_on, encoded = threading.Event(), threading.Event(), []

    def slow():
        entered.set()
        go_on.wait()
        return b"0"

    def quick(k):
        encoded.append(k)
        return b"0"

    live.take(Item("/scene", 0, slow, ()))
    entered.wait()
    for k in range(1, QUEUE_ITEMS + 51):
        live.take(Item("/scene", 0, quick, (k,)))
    assert live.dropped == 50
    go_on.set()
    eventually(lambda: len(encoded) == QUEUE_ITEMS)
    assert encoded == list(range(51, QUEUE_ITEMS + 51))


def test_an_item_that_cannot_be_encoded_is_counted_and_the_next_is_sent(live, viewer):
    subscribed(live, viewer, "/scene")
    live.take(Item("/scene", 0, dict, (1,)))
    live.take(Item("/scene", 0, lambda: b"{}", ()))
    assert viewer.message()[2] == b"{}"
    assert live.failed == 1


def test_a_client_that_reads_nothing_takes_no_memory_and_no_message_of_others(live, viewer):
    subscribed(live, viewer, "/scene")
    number, content, count = viewer.channels["/scene"]["id"], b"x" * 200_000, 1600
    with stalled(live.port, [number]):
        before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for k in range(count):
            live.take(Item("/scene", k, lambda: content, ()))
            while viewer.message()[1] != UTC_NS + k:
                pass
        grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
        # 320 MB were sent; 13 MB may wait for each client, and as much be freed late
        assert grown_kb < 100_000
        assert live.dropped == 0
        live.close()  # the server itself would wait for that client for ever


STALLED = """
from tests.hri_predict.operation.foxglove.test_live import *
live = FoxgloveLive(FoxgloveSettings(port=free_port()), info(), clocks=VirtualClocks())
number = Viewer(live.port).channels["/scene"]["id"]
with stalled(live.port, [number]):
    eventually(lambda: live.wants("/scene"))
    encoded = []
    for k in range(400):
        live.take(Item("/scene", 0, lambda: encoded.append(0) or bytes(200_000), ()))
        eventually(lambda: len(encoded) > k)
    if sys.argv[1:]:
        live.close()
"""


@pytest.mark.parametrize("asked", [["closed"], pytest.param([], marks=pytest.mark.long)])
def test_the_process_ends_although_a_client_reads_nothing(asked):
    subprocess.run([sys.executable, "-c", STALLED, *asked], check=True, cwd=ROOT, timeout=150)


def test_what_clients_send_ends_no_other_connection(live, viewer):
    for rubbish in (
        "",
        "{",
        "[]",
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1e99}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 4000000000}]}',
        '{"op": "advertise", "channels": [{"id": 1, "topic": "/advice/arm"}]}',
        b"",
        b"\x01",
        bytes(range(256)) * 8,
    ):
        other = Viewer(live.port)
        other.send(rubbish)
        other.close()
    subscribed(live, viewer, "/scene")
    live.take(Item("/scene", 0, lambda: b"{}", ()))
    assert viewer.message()[2] == b"{}"


def test_a_port_in_use_is_one_line(live):
    settings = FoxgloveSettings(port=live.port)
    assert settings.host == "127.0.0.1"
    with pytest.raises(ConfigError) as caught:
        FoxgloveLive(settings, info(), clocks=VirtualClocks())
    assert str(caught.value) == (
        f"foxglove: 127.0.0.1 port {live.port}: Address already in use; choose another port or host"
    )


@pytest.mark.realtime
def test_a_running_node_shows_itself(tmp_path):
    port = free_port()
    config = configuration.load(written(tmp_path, cell(foxglove={"port": port})))
    stop, summaries = threading.Event(), []
    running = threading.Thread(
        target=lambda: summaries.append(run(config, Options(duration_s=120), stop))
    )
    running.start()
    try:
        viewer = []

        def is_up():
            try:
                viewer.append(Viewer(port))
            except OSError:
                return False
            return True

        eventually(is_up)
        wanted = (TICKED - {"/view/people"}) | {"/scene", "/node"}
        viewer[0].subscribe(*wanted)
        found: set[str] = set()
        while found < wanted:
            topic, at_ns, _ = viewer[0].message()
            found.add(topic)
            assert abs(at_ns * 1e-9 - time.time()) < 60
        viewer[0].close()
    finally:
        stop.set()
        running.join()
    assert summaries[0].counted.get("foxglove_failed", 0) == 0


def test_without_the_extra_check_names_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    config = configuration.load(written(tmp_path, cell(foxglove={})))
    with pytest.raises(
        ConfigError, match=r"foxglove-sdk; install it with: pip install 'hri-predict\[foxglove\]'"
    ):
        examine(config)


def test_check_notes_an_address_that_others_reach(tmp_path):
    config = configuration.load(written(tmp_path, cell(foxglove={"host": "0.0.0.0"})))
    notes = examine(config)["notes"]
    assert [n for n in notes if n.startswith("foxglove.host 0.0.0.0: anyone who reaches port 8765")]


def test_the_package_is_imported_only_when_it_is_used():
    script = (
        "import sys, hri_predict.run.session, hri_predict.operation.foxglove.live;"
        "sys.exit('foxglove' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
