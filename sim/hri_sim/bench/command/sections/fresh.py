"""A predictor in a fresh process: ``python -m hri_sim.bench.command.sections.fresh NAME ENGINE``.

It makes one forecast for one person and prints the process's resident memory, before and after.
"""

import json
import resource
import sys
from pathlib import Path

from hri_predict.base.settings import validated
from hri_predict.cli.common import predictor_settings
from hri_predict.contracts import registry
from hri_sim.bench.command.predictors import _walk


def resident_mib() -> float:
    """This process's resident memory, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def main(name: str, engine: str) -> None:
    """Load, forecast, and print."""
    before = resident_mib()
    settings = predictor_settings(name, None, 25.0, 1.0)
    if "engine" in type(settings).model_fields:
        own = settings.model_dump() | {"engine": engine}
        settings = validated(type(settings), own, "predictor")
    predictor = registry.load("predictors", name)(settings)
    predictor.predict(*_walk(predictor.history_steps, 1))
    print(json.dumps({"before_mib": before, "resident_mib": resident_mib()}))


if __name__ == "__main__":
    main(*sys.argv[1:])
