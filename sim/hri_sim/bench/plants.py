"""``bench plants``: measure the links with registers: RTDE, Modbus and OPC UA."""

import json
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import need_extra
from hri_sim.bench.table import JsonOption, figures, measure

_COLUMNS = {
    "link": "{link}",
    "received": "{heard} of {sent}",
    "superseded": "{superseded}",
    "p50 ms": "{latency_ms[p50]:.2f}",
    "p99 ms": "{latency_ms[p99]:.2f}",
    "max ms": "{latency_ms[max]:.2f}",
}


def plants(
    seconds: Annotated[float, typer.Option(help="Seconds to measure each link.")] = 20.0,
    as_json: JsonOption = False,
) -> None:
    """Measure RTDE, Modbus and OPC UA: time from posting an advice until another process has it.

    The other end of RTDE is `python -m hri_sim.rtde`; that of Modbus polls every 10 ms,
    that of OPC UA subscribes. This runs in real time, so other programs disturb it.

    Example: hri-predict bench plants --seconds 5
    """
    if not 1.0 <= seconds <= 3600.0:
        raise ConfigError(f"--seconds {seconds:g}: give 1 to 3600")
    need_extra("pymodbus", "modbus")
    from hri_sim.bench.plants_cost import costs

    rows = measure(costs(seconds), 2, "registers")
    if as_json:
        print(json.dumps(rows))
    else:
        figures("From posting an advice to the registers of another process", _COLUMNS, rows)
