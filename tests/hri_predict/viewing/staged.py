"""Real ticks of the demo's cell, with a named zone, and a camera that does not see everything."""

import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from hri_predict.node.listeners import Tick
from hri_predict.run import config as configuration
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config
from hri_predict.run.coverage import zones_text
from hri_predict.run.session import Options, View, run
from hri_predict.viewing.feed import Feed
from hri_predict.viewing.packing import picture_of
from hri_predict.viewing.picture import Picture

VIEW = {"polygon": [[-1.6, -1.8], [4.2, -1.8], [4.2, 3.2], [-1.6, 3.2]], "z_min": 0, "z_max": 2.6}
PALLET = {"polygon": [[2.4, 1.7], [3.4, 1.7], [3.4, 2.6], [2.4, 2.6]], "z_max": 1.4}
SEEN = {
    "field_of_view": VIEW,
    "sees_free_space": True,
    "shadows": [PALLET],
    "viewpoints": [[-1.6, 3.2, 2.6]],
}
BENCH = {"name": "bench", "level": "none"} | {
    "polygon": [[1.0, -0.9], [2.0, -0.9], [2.0, 0.6], [1.0, 0.6]],
    "z_max": 1.2,
}


class _Kept(View):
    """Keeps the first picture after each moment, as a feed would send it."""

    def __init__(self, at_s: list[float]) -> None:
        self.due = list(at_s)
        self.pictures: list[Picture] = []
        self._feed = Feed([])
        self._start_ns: int | None = None

    def bind(self, assembly: Assembly) -> None:
        self._assembly = assembly

    def on_tick(self, tick: Tick) -> None:
        self._start_ns = self._start_ns or tick.now_ns
        self._feed.on_tick(tick)
        if self.due and tick.now_ns - self._start_ns >= self.due[0] * 1e9:
            self.due.pop(0)
            picture = picture_of(tick, self._assembly)
            changes = list(self._feed._changes)
            picture.facts.update(utc_s=time.time(), rate_hz=25.0, dropped=0, changes=changes)
            picture.facts["coverage"] = zones_text(self._assembly.config)
            self.pictures.append(picture)


def cell(folder: Path, predictor: str = "constant_velocity", **more: Any) -> Config:
    """The demo's cell with a named zone, a field of view, and a pallet's shadow in it."""
    text = configuration.shipped("demo.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text) | {"zones": [BENCH]} | more
    data["source"] |= SEEN
    data["predictor"]["name"] = predictor
    path = folder / "press-4.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return configuration.load(path)


def pictures(
    at_s: list[float], predictor: str = "constant_velocity", config: Config | None = None
) -> list[Picture]:
    """The pictures of the demo's cell, or another, so many seconds after its start."""
    kept = _Kept(at_s)
    with tempfile.TemporaryDirectory() as folder:
        config = (config or cell(Path(folder), predictor)).quiet()
        run(config, Options(factor=None, duration_s=max(at_s) + 0.2, view=kept))
    return kept.pictures
