"""The FD frames of a real recording, read by cantools as strictly as it can."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import cantools
import pytest

from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import baseline_demo

ROOT = Path(__file__).resolve().parents[4]
RECORDING = ROOT.parent / "shared" / "data" / "cmu_mocap" / "test" / "walking_1.npz"


class _Tap(View):
    """Keeps what the FD link writes: id and bytes of each frame."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []

    def bind(self, assembly: Any) -> None:
        fd = assembly.links[1]
        fd.on_sent = lambda name, raw, now_ns: self.frames.append(
            (int.from_bytes(raw[:4], "big"), raw[4:])
        )


@pytest.mark.long
def test_every_frame_has_the_length_that_the_dbc_gives_its_id():
    if not RECORDING.exists():
        pytest.skip("needs the data pack beside the project")
    base = baseline_demo()
    fd = base.links[1].model_copy(update={"fd": True})
    config = replace(base, links=(base.links[0], fd)).with_source(
        {"kind": "recording", "path": str(RECORDING)}
    )
    tap = _Tap()
    run(config, Options(factor=None, duration_s=6.0, view=tap))
    database: Any = cantools.database.load_file(ROOT / "drivers" / "dbc" / "hri_predict_fd.dbc")
    seen: Counter[str] = Counter()
    partly_filled = 0
    for frame_id, data in tap.frames:
        message = database.get_message_by_frame_id(frame_id)
        assert len(data) == message.length, message.name
        signals = message.decode(data, decode_choices=False, allow_excess=False)
        assert message.encode(signals, strict=False) is not None
        seen[message.name] += 1
        partly_filled += message.name == "ZONE" and signals["COUNT"] < 3
    assert min(seen[name] for name in ("ADVICE_R0", "STATUS", "SCHEMA", "ZONE", "POSE")) > 3, seen
    assert partly_filled > 10, "17 capsules leave room in the last frame"
