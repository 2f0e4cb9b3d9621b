"""What commands do with a source that hears a sender."""

import threading
import time
from collections.abc import Iterator

import pytest

from hri_drivers.sources.scene_stream.udp_source import UdpSource
from hri_predict.base.errors import ConfigError
from hri_predict.cli.check.sensor import measure_touch
from hri_predict.contracts.source import NOT_KNOWN_NS, live_part
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.config import Config
from hri_predict.run.session import Options, run
from hri_sim.baseline_demo import baseline_demo
from hri_sim.wires.ports import free_udp_port
from tests.hri_drivers.sources.scene_streaming import hri_sender

pytestmark = pytest.mark.realtime

PORT = free_udp_port()


def live(config: Config) -> Config:
    """The configuration with a live source."""
    shipped = configuration.load(configuration.shipped("live_udp.yaml"))
    return config.with_source(shipped.source.model_dump() | {"port": PORT})


@pytest.fixture
def sender() -> Iterator[None]:
    """The person whom the copied sender shows, at 60 Hz."""
    module, stop = hri_sender(), threading.Event()
    sender = module.SceneSender("127.0.0.1", PORT, module.CANONICAL)

    def send() -> None:
        while not stop.wait(1 / 60):
            sender.send([(1, module.swaying(time.monotonic()))])

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    yield
    stop.set()
    thread.join()
    sender.close()


@pytest.mark.long
@pytest.mark.usefixtures("sender")
def test_a_point_that_a_person_touches_is_found():
    found = measure_touch(live(baseline_demo()), "2,-0.26,0.8", "r_hand")
    assert found["off_m"] < 0.03


def test_with_nobody_sending_a_touch_is_refused_not_waited_for():
    with pytest.raises(ConfigError, match="no scene arrived: no sender"):
        measure_touch(live(baseline_demo()), "2,-0.26,0.8", "r_hand")


def test_faults_are_injected_into_what_a_live_source_hears():
    faulty = assemble.build_source(live(baseline_demo()).with_faults(["delay@0:delay_s=0.2"]))
    inner = live_part(faulty)
    assert isinstance(inner, UdpSource)
    assert faulty is not inner
    assert faulty.next_ns() == NOT_KNOWN_NS  # and ``arrived`` wakes who waits


def test_nobody_judges_contacts_with_live_people_by_a_second_copy_of_them():
    """A second source on one port could not even be opened."""
    summary = run(live(baseline_demo()), Options(factor=None, duration_s=0.5))
    assert summary.contacts is None
    assert summary.source["kind"] == "udp"
    assert summary.source["live"]["packets"] == 0
    assert set(summary.ticks_at) == {"unknown"}
