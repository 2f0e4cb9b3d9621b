"""Links to the robot's server of ``hri_sim``, which runs as a process of its own."""

from typing import Any

import yaml

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.files import data_path
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from tests.waiting import eventually

PATIENT = {"reply_timeout_s": 2.0, "max_state_age_s": 1.0, "wait_for_device": True}
"""A machine with much else to do answers late."""


def made(protocol: str, port: int, state: dict[str, Any] | None = None, **changes: Any) -> Any:
    """The link of the shipped configuration, not started."""
    config = yaml.safe_load(data_path(f"robot_{protocol}.yaml").read_text())
    entry = config["links"][0] | PATIENT | {"port": port} | changes
    entry[{"modbus": "registers", "opcua": "nodes"}[protocol]] |= state or {}
    kind: Any = registry.load("links", entry["kind"])
    return kind(validated(kind.settings_model, entry, "the link"), MonotonicClock())


def states(link: Any, count: int) -> list[Any]:
    """The next states."""
    found: list[Any] = []

    def enough() -> bool:
        found.extend(received.message for received in link.take())
        return len(found) >= count

    eventually(enough)
    return found
