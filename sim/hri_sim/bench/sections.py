"""The sections of ``hri-predict bench``, in their order.

To add one: a function from ``Scope`` to rows, which it yields as they are measured, and its line
here. What it compares must take turns, and each name of a part must stay, so that runs can be
compared.
"""

from hri_sim.bench import age, forecasts, parts, running, scaling, speed
from hri_sim.bench.rows import Section

SECTIONS = {
    "parts": Section("Parts of the node, one call", parts.rows),
    "predictors": Section("A forecast, by predictor and engine", forecasts.rows),
    "age": Section("From a capture to the last byte, two people", age.rows),
    "jitter": Section(
        "Interval between messages less the period, as another process sees it", running.jitter
    ),
    "load": Section("Processor time of a running node, 25 ticks a second", running.load),
    "scaling": Section("A tick, as the cell grows", scaling.rows),
    "start": Section("Start of a node, and its memory", running.start),
    "speed": Section("Faster than real time", speed.rows),
}
