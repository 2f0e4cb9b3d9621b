"""A3, A4: a lost person is released by presses that nobody made, or forgotten over a restart."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.protocol.messages import Acknowledge
from tests.attacks.kinds.controllers import acknowledge
from tests.attacks.kinds.hider import Hider
from tests.attacks.play import Attack

_BOTH = ("drive", "monitor")


def _flooded(rng: np.random.Generator, how: str, latch: Callable[[int], int]) -> Attack:
    hider = Hider.draw(rng)
    period_s = float(10 ** rng.uniform(-1.2, 0.7))
    ids = int(rng.choice([1, 2, 3, 255]))
    links = _BOTH if rng.random() < 0.5 else ("drive",)
    state: dict[str, Any] = {}

    def due(t: float, shown: int) -> Acknowledge | None:
        if t < state.get("next", 0.0):
            return None
        state["next"] = t + period_s
        state["count"] = state.get("count", -1) + 1
        return Acknowledge(latch(shown), 1 + state["count"] % ids)

    def connect(cell: Any) -> None:
        state.clear()
        acknowledge(cell, due, links)

    return Attack(
        name=f"acknowledges {how} every {period_s:.2f} s, {ids} ids, from {links}, {hider}",
        truth=lambda t: [hider.joints(t)],
        seen=lambda t, k: [(1, hider.joints(t))] if t < hider.lost_s else [],
        seconds=hider.end_s,
        cell=connect,
    )


def zero(rng: np.random.Generator) -> Attack:
    """A taped button names no latch."""
    return _flooded(rng, "0", lambda shown: 0)


def mirrored(rng: np.random.Generator) -> Attack:
    """A controller acknowledges by itself whatever latch is shown."""
    return _flooded(rng, "the shown latch", lambda shown: shown)


def guessed(rng: np.random.Generator) -> Attack:
    """Recorded presses: a latch id of an earlier run."""
    old = int(rng.integers(1, 65536))
    return _flooded(rng, f"latch {old}", lambda shown: old)


def forgotten(rng: np.random.Generator) -> Attack:
    """The state file is deleted, rolled back, of another cell or cut short over a restart."""
    hider = Hider.draw(rng)
    how = str(rng.choice(["deleted", "all deleted", "rolled back", "foreign", "cut"]))
    end_s = hider.lost_s + float(rng.uniform(0.5, 3.0))

    def change(data: dict[str, Any]) -> None:
        data["risk"]["latch"] = ["restart", "lost"]

    def elsewhere(data: dict[str, Any]) -> None:
        change(data)
        data["robots"][0] |= {"name": "other", "room_from_robot": {"xyz": [0.0, -2.0, 0.0]}}
        for link in data["links"]:
            link["simulate"]["robot"] = "other"

    def keep(folder: Path) -> None:
        shutil.move(folder / "state.json", folder / "kept")

    def keep_copy(folder: Path) -> None:
        shutil.copy(folder / "state.json", folder / "kept")

    def spoil(folder: Path) -> None:
        path = folder / "state.json"
        if how == "cut":
            path.write_bytes(path.read_bytes()[:-20])
        elif how in ("rolled back", "foreign"):
            shutil.copy(folder / "kept", path)
        else:
            path.unlink()
        if how == "all deleted":
            for each in folder.glob("*state*"):
                each.unlink()

    empty = Attack(name="", truth=lambda t: [], seen=lambda t, k: [], seconds=2.0)
    before = {
        "rolled back": (replace(empty, change=change), keep_copy),
        "foreign": (replace(empty, change=elsewhere), keep),
    }
    first = Attack(
        name="",
        truth=lambda t: [hider.joints(t)],
        seen=lambda t, k: [(1, hider.joints(t))] if t < hider.lost_s else [],
        seconds=end_s,
        change=change,
        before=before.get(how),
    )
    return Attack(
        name=f"state file {how} after {end_s:.1f} s, {hider}",
        truth=lambda t: [hider.joints(t + (hider.reach_s - 5.0))],
        seen=lambda t, k: [],
        seconds=9.0,
        change=change,
        before=(first, spoil),
    )
