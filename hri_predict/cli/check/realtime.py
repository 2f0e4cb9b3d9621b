"""``check --realtime``: check the machine's real-time settings, and measure its wake-up latency."""

import json
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table

from hri_predict.base.machine.lateness import load, wake_ups
from hri_predict.base.machine.realtime import RealtimeSettings
from hri_predict.base.machine.survey import survey
from hri_predict.run.config import Config

MEASURED_S = 2.0


def look(config: Config) -> dict[str, Any]:
    """Inspect this machine, and measure a bare loop without and with load."""
    settings, rate_hz = config.node.realtime, config.node.rate_hz
    findings = survey(settings)
    refused = [finding.refused for finding in findings if finding.refused]
    nothing = RealtimeSettings()  # what is not available is left out of the measured loop
    settings = settings.model_copy(update={key: getattr(nothing, key) for key in refused})
    idle = wake_ups(settings, MEASURED_S)
    with load(rate_hz, settings):
        busy = wake_ups(settings, MEASURED_S)
    return {
        "path": str(config.path),
        "asked": config.node.realtime != RealtimeSettings(),
        "machine": [asdict(finding) for finding in findings],
        "lateness": {"idle": asdict(idle), "busy": asdict(busy)},
        "refused": refused,
    }


def show(found: dict[str, Any], as_json: bool) -> bool:
    """Print the result; return whether all configured settings are available."""
    if as_json:
        print(json.dumps(found))
        return not found["refused"]
    console = Console(markup=False)
    table = Table(title="Real-time settings of this machine", title_justify="left")
    for heading in ("", "found", "to do"):
        table.add_column(heading, overflow="fold")
    for finding in found["machine"]:
        table.add_row(finding["name"], finding["found"], finding["remedy"] or "-")
    console.print(table)
    console.print(_lateness_table(found["lateness"]))
    for key in found["refused"]:
        console.print(f"realtime.{key}: not available on this machine; see above", soft_wrap=True)
    ok = not found["refused"]
    said = f"the machine {'has all' if ok else 'lacks some'} of the settings under realtime:"
    if not found["asked"]:
        said = "it has no realtime:, so no settings are requested"
    console.print(f"{found['path']}: {said}", soft_wrap=True)
    return ok


def _lateness_table(lateness: dict[str, dict[str, float]]) -> Table:
    table = Table(title="Wake-up latency of a bare loop, µs", title_justify="left")
    for heading in ("", "p50", "p99", "max"):
        table.add_column(heading, justify="left" if not heading else "right")
    texts = {"idle": "alone", "busy": "while another process computes for half of each cycle"}
    for key, text in texts.items():
        table.add_row(
            text, *(f"{lateness[key][name]:.0f}" for name in ("p50_us", "p99_us", "max_us"))
        )
    return table
