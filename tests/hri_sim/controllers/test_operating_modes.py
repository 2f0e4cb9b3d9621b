"""Operating modes through the mock controllers: a drive on serial, a monitor on CAN, and the node.

One run: somebody walks up to the arm and stays; then the operator asks for each mode in turn.
"""

import logging
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hri_predict.base.files import data_path
from hri_predict.protocol.messages import Level, NodeState, OperatingMode, RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import BASELINE
from hri_sim.controllers.lies import Requests, RequestSettings, Said

AUTOMATIC, TEACH, RECOVERY, MUTED = OperatingMode
ENDS_S = 12.6
BOTH = [
    {"request": "recovery", "start_s": 5.0, "duration_s": 2.5},
    {"request": "teach", "start_s": 7.7, "duration_s": 2.0},
    {"request": "muted", "start_s": 9.9, "duration_s": 2.5},
]
DRIVE_ALONE = {"request": "recovery", "start_s": 4.4, "duration_s": 0.3}
PERSON = {
    "start": [3.6, 2.4],
    "script": [
        {"do": "wait", "seconds": 0.5},  # the arm stops where its way back leads away
        {"do": "walk", "to": [1.1, -0.45]},
        {"do": "wait", "seconds": 60.0},
    ],
}


class Watch(View):
    """Keeps ticks and RobotStates."""

    def __init__(self) -> None:
        self.ticks: list[Any] = []
        self.states: dict[str, list[RobotState]] = {}

    def on_tick(self, tick: Any) -> None:
        self.ticks.append(tick)

    def on_received(self, link: str, received: Any) -> None:
        if isinstance(received.message, RobotState):
            self.states.setdefault(link, []).append(received.message)

    def of(self, mode: OperatingMode) -> list[Any]:
        return [tick for tick in self.ticks if tick.advices[0].mode is mode]


def written(folder: Path, modes: dict[str, Any]) -> Path:
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    data |= {"predictor": BASELINE, "risk": {"mode": "iso"}, "alerts": {"terminal": False}}
    data |= {"people": {}, "source": data["source"] | {"people": [PERSON]}}
    (robot,) = data["robots"]
    robot["motion"]["plan"] = "pick_and_place"
    robot["modes"] = modes
    for link in data["links"]:
        alone = [DRIVE_ALONE] if link["name"] == "drive" else []
        link["simulate"]["requests"] = [*alone, *BOTH]
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Watch, list[str]]:
    allowed = {"teach": {}, "recovery": {}, "muting": {"max_s": 1.2}}
    path = written(tmp_path_factory.mktemp("modes"), allowed)
    watch, said = Watch(), _Kept()
    logging.getLogger("hri_predict.risk").addHandler(said)
    try:
        options = Options(factor=None, duration_s=ENDS_S, view=watch)
        return run(configuration.load(path), options), watch, said.lines
    finally:
        logging.getLogger("hri_predict.risk").removeHandler(said)


class _Kept(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


@pytest.mark.long
def test_each_mode_is_entered_and_left_once_over_both_links(played: Any) -> None:
    summary, watch, lines = played
    modes = [mode for mode, _ in groupby(watch.ticks, key=lambda tick: tick.advices[0].mode)]
    assert modes == [AUTOMATIC, RECOVERY, AUTOMATIC, TEACH, AUTOMATIC, MUTED, AUTOMATIC]
    for link in ("drive", "monitor"):
        asked = {(s.mode, s.request, s.enabling) for s in watch.states[link]}
        assert (RobotMode.MANUAL, TEACH, True) in asked
        assert (RobotMode.AUTOMATIC, MUTED, True) in asked
    counted = {k: v for k, v in summary.counted.items() if k.startswith("mode_")}
    # refused: one channel alone, the time that is over, and ticks in which one link is ahead
    assert 2 <= counted.pop("mode_refused") <= 6
    assert counted == {"mode_recovery": 1, "mode_teach": 1, "mode_muted": 1}
    assert [line.split(":")[1] for line in lines if "begins" in line or "ends" in line] == [
        " recovery begins",
        " recovery ends",
        " teach begins",
        " teach ends",
        " muted begins",
        " muted ends",
    ]


def test_one_channel_alone_enters_nothing(played: Any) -> None:
    _, _, lines = played
    assert lines[0] == "robot arm: recovery refused: not all of its controllers request it"


def test_in_recovery_the_arm_goes_back_slowly_and_away(played: Any) -> None:
    _, watch, _ = played
    ticks = watch.of(RECOVERY)
    limits = [tick.advices[0].speed_limit_m_s for tick in ticks]
    assert max(limits) == 0.1
    apart = np.array([tick.advices[0].separation_m for tick in ticks])
    moving = apart[[limit == 0.1 for limit in limits]]
    assert moving[-1] > moving[0] + 0.05
    # sensor noise of 4 mm and a person who sways; what it moves itself takes it away
    assert np.diff(moving).min() > -0.02
    assert {tick.status.reason for tick in ticks} == {Reason.RECOVERY}


def test_teaching_is_slow_and_muting_is_loud_and_ends_by_itself(played: Any) -> None:
    _, watch, lines = played
    taught = watch.of(TEACH)
    assert max(tick.advices[0].speed_limit_m_s for tick in taught) == 0.25
    assert taught[-1].advices[0].level is Level.SLOW
    muted = watch.of(MUTED)
    assert len(muted) == pytest.approx(1.2 * 25, abs=1)
    assert muted[-1].advices[0].speed_limit_m_s > 0.25
    assert {tick.status.reason for tick in muted} == {Reason.MUTED}
    assert {tick.status.node_state for tick in muted} == {NodeState.DEGRADED}
    assert "robot arm: muted ends: its 1.2 s are over; release the request" in lines
    assert watch.ticks[-2].advices[0].level is Level.STOP


def test_what_is_asked_follows_the_clock() -> None:
    requests = Requests([RequestSettings(request="teach", start_s=1.0, duration_s=1.0)])
    assert requests.said(5 * 10**9) == Said()
    assert requests.said(6 * 10**9) == Said(RobotMode.MANUAL, TEACH, True)
    assert requests.said(7 * 10**9) == Said()
