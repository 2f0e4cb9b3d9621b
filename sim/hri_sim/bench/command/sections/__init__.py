"""The sections of ``hri-predict bench``: each yields its rows as they are measured.

To add one: a module with a function from ``Scope`` to rows, and its line in ``SECTIONS``. What it
compares must take turns, and each name of a part must stay, so that runs can be compared.
"""

from hri_sim.bench.command.report.rows import Section
from hri_sim.bench.command.sections import (
    age,
    forecasts,
    jitter,
    load,
    parts,
    scaling,
    speed,
    start,
)

SECTIONS = {
    "parts": Section(about="Parts of the node, one call", rows=parts.rows),
    "predictors": Section(about="A forecast, by predictor and engine", rows=forecasts.rows),
    "age": Section(about="From a capture to the last byte, two people", rows=age.rows),
    "jitter": Section(
        about="Interval between messages less the period, as another process sees it",
        rows=jitter.rows,
    ),
    "load": Section(about="Processor time of a running node, 25 ticks a second", rows=load.rows),
    "scaling": Section(about="A tick, as the cell grows", rows=scaling.rows),
    "start": Section(about="Start of a node, and its memory", rows=start.rows),
    "speed": Section(about="Faster than real time", rows=speed.rows),
}
