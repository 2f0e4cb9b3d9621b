"""What tests of live sources share."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hri_drivers.sources.live import LiveSource
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.scene import Scene

PATIENCE_S = 20.0
POSE = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}


class Ear:
    """A source as the node builds it, and what it hears."""

    def __init__(self, kind: str, base_dir: Path = Path(), **settings: Any) -> None:
        cls = registry.load("sources", kind)
        data = {"kind": kind, "room_from_source": POSE, "rate_hz": 60} | settings
        source = cls(validated(cls.settings_model, data, "source"), base_dir)
        assert isinstance(source, LiveSource)
        self.source = source
        self.counters = self.source.counters

    @property
    def port(self) -> int:
        """The port that it listens at."""
        port: int = self.source._receiver.port  # type: ignore[attr-defined]
        return port

    def scenes(self, count: int) -> list[Scene]:
        """The next scenes; waits for them."""
        found: list[Scene] = []

        def take() -> bool:
            while (scene := self.source.poll(time.monotonic_ns())) is not None:
                found.append(scene)
            return len(found) >= count

        self.wait(take)
        return found

    def scene(self) -> Scene:
        """The next scene, the only one that is there."""
        (scene,) = self.scenes(1)
        return scene

    def wait(self, reached: Callable[[], bool]) -> None:
        """Wait for what happens in the source's thread."""
        end_s = time.monotonic() + PATIENCE_S
        while not reached():
            assert time.monotonic() < end_s, f"it does not happen: {self.counters}"
            time.sleep(0.002)


@pytest.fixture
def hear() -> Iterator[Callable[..., Ear]]:
    """Builds and opens sources, and closes them in the end."""
    ears: list[Ear] = []

    def opened(kind: str, **settings: Any) -> Ear:
        ear = Ear(kind, **settings)
        ears.append(ear)
        ear.source.open(time.monotonic_ns())
        return ear

    yield opened
    for ear in ears:
        ear.source.close()
