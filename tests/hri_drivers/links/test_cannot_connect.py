"""A robot's server that is not running: the error names the remedies, also to start without it."""

from typing import Any

import pytest

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_sim.wires.ports import free_tcp_port
from tests.hri_predict.library.conformance.test_links import READ, REGISTERS

KINDS: dict[str, dict[str, Any]] = {
    "rtde": {"full_speed_m_s": 1.0, "max_age_s": 0.4},
    "modbus_client": {"max_state_age_s": 0.1, "registers": REGISTERS},
    "opcua_client": {"max_state_age_s": 0.1, "nodes": READ},
}
PACKAGES = {"modbus_client": "pymodbus", "opcua_client": "asyncua"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_server_that_is_switched_off_is_one_line_with_the_remedies(kind):
    if kind in PACKAGES:
        pytest.importorskip(PACKAGES[kind], reason=f"{PACKAGES[kind]} is not installed")
    cls = registry.load("links", kind)
    data = {"name": "arm", "kind": kind, "host": "127.0.0.1", "port": free_tcp_port()} | KINDS[kind]
    link = cls(validated(cls.settings_model, data, "the link"), MonotonicClock())
    said = r"cannot connect: .*switch the .* on, .*'wait_for_device: true' starts the node without"
    with pytest.raises(LinkError, match=said) as error:
        link.start()
    assert "\n" not in str(error.value)
