"""The soak test: hours of the demo's cell with random faults, and conditions that must always hold.

One person is always near and another comes and goes, while sources, links and clocks fail and
controllers lie, sometimes several at once. The conditions: the node never advises *clear*, a moving
robot touches no person, every posted message is sent or counted, and memory does not grow.
"""

import resource
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.contracts.link import Link, LinkSettings
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level, Message
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import baseline_demo
from hri_sim.faults.injector import LINK_FAULTS, SOURCE_FAULTS

QUIET_S = 5.0  # nothing fails at the start
MEAN_GAP_S = 20.0  # from one fault's start to the next's
MEAN_LIE_GAP_S = 60.0  # from one lie's end to the next's start
LONGEST_S = 4.0
OPERATOR_S = 20.0  # after that an operator has looked for lost people, and acknowledges
DECEIVING_S = 2.0  # longest time of false sensor data: the node must believe longer ones
WARM_UP = 0.1  # share of the run; bounded buffers are full by then
LIMIT_PERCENT = 2.0
SAMPLE_S = 20.0

_DIRECTIONS = ("out", "in", "both")
_LIES: tuple[Mapping[str, Any], ...] = (
    {"kind": "freeze"},
    {"kind": "hold"},
    {"kind": "stand"},
    {"kind": "zero"},
    {"kind": "jump", "jump_rad": 0.6},
    {"kind": "acknowledges", "period_s": 0.3},
    {"kind": "acknowledges", "period_s": 0.5, "ids": 2, "names": "first"},
)
"""Lies of one controller at a time, while the other is truthful."""


def draw_faults(seed: int, seconds: float, links: Sequence[str]) -> list[str]:
    """Draw faults at random times for source and links, in the form of the command line.

    A renamed id moves to another person, and its former owner is not seen during that time.
    """
    rng = np.random.default_rng(seed)
    found, start_s = [], QUIET_S
    while (start_s := start_s + rng.exponential(MEAN_GAP_S)) < seconds - LONGEST_S:
        target = rng.choice(["", *links])
        kinds = LINK_FAULTS if target else SOURCE_FAULTS
        drawn = [(kind, how) for kind, fault in kinds.items() for how in fault.soak]
        kind, parameters = drawn[rng.integers(len(drawn))]
        longest_s = DECEIVING_S if kinds[kind].deceives else LONGEST_S
        if target:
            way = f"direction={rng.choice(_DIRECTIONS)}"
            parameters = f"{parameters},{way}" if parameters else way
        time = f"@{start_s:.2f}+{rng.uniform(0.2, longest_s):.2f}"
        if kind == "rename":
            found.append(f"vanish{time}:person=1")
        text = f"{kind}{time}:{parameters}" if parameters else f"{kind}{time}"
        found.append(f"{target}:{text}" if target else text)
    return found


def draw_lies(seed: int, seconds: float, links: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Draw lies of the simulated controllers: link -> as in ``simulate.lies``."""
    rng = np.random.default_rng([seed, 1])
    found: dict[str, list[dict[str, Any]]] = {link: [] for link in links}
    end_s = QUIET_S
    while (start_s := end_s + rng.exponential(MEAN_LIE_GAP_S)) < seconds - LONGEST_S:
        lasts_s = float(rng.uniform(0.2, LONGEST_S))
        lie = _LIES[rng.integers(len(_LIES))]
        times = {"start_s": round(start_s, 2), "duration_s": round(lasts_s, 2)}
        found[str(rng.choice(list(links)))].append({**lie, **times})
        end_s = start_s + lasts_s
    return found


@dataclass(frozen=True, kw_only=True)
class SoakResult:
    """The result of a soak test; ``fine`` if all conditions held.

    Attributes:
        hours: hours of node time.
        faults: number of injected faults, including lies of controllers.
        ticks: number of the node's ticks.
        clear_ticks: number of ticks that advised *clear* although a person was near.
        contacts: touches of a moving robot.
        posted: number of messages posted to links.
        unaccounted: posted messages neither sent nor counted as superseded, decimated or failed.
        rss_mib_early, rss_mib_end, growth_percent: resident memory after the warm-up and at the
            end.
        counted: the run's counters.
    """

    hours: float
    faults: int
    ticks: int
    clear_ticks: int
    contacts: int
    posted: int
    unaccounted: int
    rss_mib_early: float
    rss_mib_end: float
    growth_percent: float
    counted: dict[str, int]

    @property
    def fine(self) -> bool:
        """Return whether all conditions held."""
        harmless = self.clear_ticks == 0 and self.contacts == 0 and self.unaccounted == 0
        return harmless and self.growth_percent <= LIMIT_PERCENT and self.ticks > 0


def run_soak(hours: float, seed: int = 0, speed: float | None = None) -> dict[str, object]:
    """Run the soak test with a baseline predictor; return ``SoakResult`` as plain data.

    Args:
        hours: hours of node time.
        seed: random seed of the faults.
        speed: node seconds per second, with real threads and clock; ``None``: as fast as possible
            on the virtual clock.
    """
    if not 0 < hours <= 1000:
        raise ConfigError(f"--hours {hours}: give more than 0 and at most 1000")
    seconds = hours * 3600.0
    base = _scene(baseline_demo())
    names = [link.name for link in base.links]
    faults = draw_faults(seed, seconds, names)
    lies = draw_lies(seed, seconds, names)
    base = replace(base, links=tuple(_lying(link, lies[link.name]) for link in base.links))
    watch = _Watch(WARM_UP * seconds)
    summary = run(base.with_faults(faults), Options(factor=speed, duration_s=seconds, view=watch))
    result = SoakResult(
        hours=hours,
        faults=len(faults) + sum(map(len, lies.values())),
        ticks=watch.ticks,
        clear_ticks=watch.clear_ticks,
        contacts=summary.contacts or 0,
        posted=sum(count.posted for count in watch.posts),
        unaccounted=sum(count.unaccounted for count in watch.posts),
        counted=summary.counted,
        **watch.memory.growth(),
    )
    return asdict(result) | {"fine": result.fine}


def _scene(base: Config) -> Config:
    """Return the demo's cell: one person works near the robot, the demo's own comes and goes.

    The person near the robot takes a step now and then: a body that did not move for hours would
    stay *unknown* once the tracker had invented it.
    """
    data = base.source.model_dump()
    script = [
        step
        for to in ([2.3, 0.5], [2.3, 0.2])
        for step in ({"do": "wait", "seconds": 15.0}, {"do": "walk", "to": to})
    ]
    waits = {"start": [2.3, 0.2], "script": script}
    return base.with_source(data | {"people": [waits, *data["people"]], "keeps_ids": False})


def _lying(link: LinkSettings, lies: list[dict[str, Any]]) -> LinkSettings:
    """Return the link; the controller at its far end lies and has a button."""
    changes = {"lies": lies, "acknowledge_after_s": OPERATOR_S}
    return link.model_copy(update={"simulate": (link.simulate or {}) | changes})


class _Posts:
    """Counts the messages posted to one link."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self.posted = 0
        post = link.post

        def counted(message: Message) -> None:
            self.posted += 1
            post(message)

        link.post = counted  # type: ignore[method-assign]

    @property
    def unaccounted(self) -> int:
        """Number of messages that were lost without being counted, or counted twice.

        ``write_errors`` counts attempts, and a later attempt may have succeeded, so it is only an
        upper bound of the failed messages.
        """
        counters = self._link.counters
        sent = counters.messages_sent + counters.superseded + counters.decimated
        failed = self.posted - sent
        return max(0, failed - counters.write_errors) + max(0, -failed)


class _Watch(View):
    """Checks every tick."""

    def __init__(self, warm_up_s: float) -> None:
        self.ticks = self.clear_ticks = 0
        self.posts: list[_Posts] = []
        self.memory = Resident(SAMPLE_S, warm_up_s)
        self._start_ns: int | None = None

    def bind(self, assembly: Assembly) -> None:
        """Count the messages posted to the links."""
        self.posts = [_Posts(link) for link in assembly.links]

    def on_tick(self, tick: Tick) -> None:
        """Check one tick."""
        if self._start_ns is None:
            self._start_ns = tick.now_ns
        elapsed_ns = tick.now_ns - self._start_ns
        self.ticks += 1
        near = elapsed_ns > QUIET_S * 1e9  # by then both are in view
        self.clear_ticks += near and any(a.level is Level.CLEAR for a in tick.advices)
        self.memory.look(tick.now_ns)


# -- resident memory of this process, and its growth -----------------------------------------------


def resident_mib() -> float:
    """Return the resident memory of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


class Resident:
    """Growth of the resident memory after a warm-up, in which bounded buffers fill.

    Args:
        every_s: node time between two samples.
        warm_up_s: node time of the warm-up, from the first sample.
    """

    def __init__(self, every_s: float, warm_up_s: float) -> None:
        self._every_ns, self._warm_up_ns = round(every_s * 1e9), round(warm_up_s * 1e9)
        self._due_ns: int | None = None
        self._samples: list[float] = []

    def look(self, now_ns: int) -> None:
        """Take a sample if one is due at this node time."""
        if self._due_ns is None:
            self._due_ns = now_ns + self._warm_up_ns
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + self._every_ns
            self._samples.append(resident_mib())

    def growth(self) -> dict[str, float]:
        """Return the memory after the warm-up and at the end, and the growth in percent."""
        end = resident_mib()
        early = self._samples[0] if self._samples else end
        return {
            "rss_mib_early": round(early, 2),
            "rss_mib_end": round(end, 2),
            "growth_percent": round(100.0 * (end / early - 1.0), 2),
        }
