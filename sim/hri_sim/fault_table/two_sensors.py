"""The cell of the fault table with two sensors, one of which has the fault."""

from typing import Any

from hri_predict.contracts import registry
from hri_predict.people.merging.settings import OF_THE_ROOM
from hri_predict.run.config import Config


def with_two_sensors(config: Config, faulty: str, faults: list[str]) -> Config:
    """Return the cell with sensors ``back`` and ``front`` in place of its source.

    Args:
        faulty: the sensor that has the faults.
        faults: faults as on the command line.

    Raises:
        ConfigError: a fault's text is wrong.
    """
    parse = registry.load("faults", "parse")
    sensor = config.source.model_dump(exclude=set(OF_THE_ROOM))
    sensors: dict[str, dict[str, Any]] = {"back": dict(sensor), "front": dict(sensor)}
    sensors[faulty]["faults"] = [parse(text) for text in faults]
    return config.with_source({"kind": "merged", "sensors": sensors})
