"""The node: one tick, and the life cycle.

``runtime`` calls ``tick`` at absolute deadlines (real time) or steps it (virtual time); the node
itself never sleeps and never reads a clock.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from hri_predict.base.errors import failure
from hri_predict.contracts.link import Link, Received
from hri_predict.contracts.predictor import Forecast
from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.memory import Remembers
from hri_predict.node.presses import Press, Presses
from hri_predict.node.publish_phase import PublishPhase
from hri_predict.node.publisher import Publisher
from hri_predict.node.refused_states import RefusedStates, StrangeStates
from hri_predict.node.repeats import Repeats
from hri_predict.node.shedding import Shedding
from hri_predict.people.people import People
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.thread_runner import Prediction
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    NodeState,
    RobotState,
    SetChoice,
    Status,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.types import Assessment
from hri_predict.robots.tracker import RobotTracker

# -- detects another sender that uses this node's ids, on any of its links -------------------------

HOLD_NS = 2_000_000_000
"""Time for which the node stops the robots after the last frame from a second sender: twice the
time for which a receiver keeps a schema (``protocol.reception.FORGET_S``), so that no receiver
still follows the other sender.
"""


class SecondSender:
    """Watches the links for a second sender.

    Two nodes with the same ids may send contradictory advice: one may observe a person where the
    other does not. Neither can determine which one a controller follows, so both must stop the
    robots.
    """

    def __init__(self, links: Sequence[Link]) -> None:
        self._links = links
        self._heard: frozenset[str] = frozenset()

    def heard(self, now_ns: int) -> bool:
        """Whether another sender was detected within ``HOLD_NS``."""
        heard = frozenset(
            link.name
            for link in self._links
            if link.foreign_ns is not None and now_ns - link.foreign_ns < HOLD_NS
        )
        for name in sorted(heard - self._heard):
            log.error("link %s: another sender uses this node's ids; the robots stop", name)
        for name in sorted(self._heard - heard):
            log.warning("link %s: the other sender is silent again", name)
        self._heard = heard
        return bool(heard)


# --------------------------------------------------------------------------------------------------

log = logging.getLogger(__name__)


class Node:
    """One node: people in, advice out.

    Counters: ``scenes_in``, ``frames_in`` (skeletons in them), ``assess_failures``,
    ``acknowledges`` (valid presses, see ``Presses``), ``acknowledges_refused`` (valid presses
    without effect, and all invalid ones), ``listener_failures``.

    Attributes:
        shedding: what is left out while ticks take too long; set by the code that measures them.
        conditions: reasons from parts that do not contribute to the advice, for Status and as notes
            in the advice.
    """

    def __init__(
        self,
        *,
        people: People,
        prediction: Prediction,
        risk: RiskEngine,
        robots: Sequence[RobotTracker],
        links: Sequence[Link],
        advised: Sequence[frozenset[int]],
        publisher: Publisher,
        predictor_index: int,
        listeners: Sequence[Listener] = (),
        supervised_restart: bool = False,
    ) -> None:
        self._people = people
        self._prediction = prediction
        self._risk = risk
        self._robots = robots
        self._refused_states = [RefusedStates(tracker) for tracker in robots]
        self._links = links
        self._second_sender = SecondSender(links)
        self._advised = advised  # per link: indices of the robots advised on it
        self._publisher = publisher
        self._predictor_index = predictor_index
        self._listeners = listeners
        self.shedding = Shedding()
        self._cycle = 0
        self._presses = Presses(supervised_restart)
        self._pressed: list[Press] = []  # to be judged by the facts of this tick
        self.conditions: Callable[[], Sequence[Reason]] = tuple
        self.scenes_in = self.frames_in = self.assess_failures = self.acknowledges = 0
        self.listener_failures = 0
        self._strange_states = StrangeStates()
        self._refused = self._forgotten = 0
        self.state = NodeState.STARTING

    def receive(self, scene: Scene, receipt_ns: int) -> None:
        """Receive a scene from the source (called by the source's thread)."""
        self.scenes_in += 1
        try:
            self.frames_in += len(scene.people)
            self._people.receive(scene, receipt_ns)
        except Exception:  # the next scenes would look as if nobody had been in this one
            if self._people.lose_scene(receipt_ns) % 1000 == 1:
                log.exception("a scene could not be processed: its people may be anywhere")
        self._tell(lambda listener: listener.on_scene(scene, receipt_ns))

    def tick(self, now_ns: int) -> Tick:
        """Run one cycle: people, predictor, risk, publisher."""
        snapshot: PeopleSnapshot | None = None
        forecast: Forecast | None = None
        assessment: Assessment | None = None
        reasons: tuple[Reason, ...] = ()
        self._refused += len(self._pressed)  # the tick before failed
        self._pressed, self._forgotten = [], 0
        try:
            self._take_received()
            snapshot = self._people.snapshot(now_ns)
            second_sender = self._second_sender.heard(now_ns)
            if second_sender:  # like an untrusted scene, so that the release takes its time
                reasons = (Reason.SECOND_SENDER, *snapshot.reasons)
                snapshot = replace(snapshot, reasons=reasons)
            forecast, reason = self._prediction.run(snapshot)
            reasons = (*self._conditions(now_ns), *(() if reason is None else (reason,)))
            assessment = self._risk.assess(snapshot, forecast, reasons)
            self._release()
            advices, reasons = assessment.advices, assessment.reasons
            if self.shedding.active:
                reasons = (*reasons, Reason.LOAD_SHED)
            if second_sender:
                advices = tuple(replace(advice, level=Level.FAULT) for advice in advices)
        except BaseException as error:  # last line of defence: the robots stop, whatever failed
            failure(error)
            if self.assess_failures == 0 or self.assess_failures % 1000 == 0:
                log.exception("the tick failed (earlier failures: %d)", self.assess_failures)
            self.assess_failures += 1
            assessment = None  # its state and reasons would contradict the advice
            advices = self._all_robots(Level.FAULT, Reason.NODE_FAULT)
        self.state = self._state_of(snapshot, assessment, reasons)
        status = self._status(snapshot, reasons, assessment)
        return self._publish(
            Tick(
                now_ns=now_ns,
                status=status,
                advices=advices,
                snapshot=snapshot,
                forecast=forecast,
                assessment=assessment,
            )
        )

    def announce(self, now_ns: int, state: NodeState, reason: Reason) -> Tick:
        """Send *unknown* with a reason to the controllers: at start, and last at stop."""
        self.state = state
        status = Status(
            node_state=state,
            reason=reason,
            people=0,
            predictor=self._predictor_index,
            cycle=self._cycle,
        )
        advices = self._all_robots(Level.UNKNOWN, reason)
        return self._publish(Tick(now_ns=now_ns, status=status, advices=advices))

    def warm_up(self) -> None:
        """See ``RiskEngine.warm_up``."""
        self._risk.warm_up()

    def self_check(self) -> dict[str, Any] | None:
        """See ``RiskEngine.self_check``."""
        return self._risk.self_check()

    @property
    def repeats(self) -> Repeats:
        """The part that repeats Status and Advice until the next tick."""
        return self._publisher.repeats

    @property
    def publish_phase(self) -> PublishPhase | None:
        """The part that holds messages until a fixed time after the tick's deadline, if any."""
        return self._publisher.phase

    @property
    def remembering(self) -> dict[str, Remembers]:
        """The parts with state that persists across a restart; see ``memory``."""
        return {"latches": self._risk, "people": self._people}

    @property
    def acknowledges_refused(self) -> int:
        """Number of invalid Acknowledges and of presses without effect."""
        return self._refused + self._presses.refused.total()

    @property
    def acknowledges_not_counted(self) -> Mapping[str, int]:
        """Reason -> number of Acknowledges that were not presses; see ``Presses``."""
        return self._presses.refused

    @property
    def strange_states(self) -> int:
        """Number of RobotStates of a robot that the link's controller does not control."""
        return self._strange_states.count

    @property
    def people_counters(self) -> Mapping[str, int]:
        """See ``People.counters``."""
        return self._people.counters()

    @property
    def robot_counters(self) -> dict[str, int]:
        """See ``RiskEngine.robot_counters``."""
        return self._risk.robot_counters

    def _publish(self, made: Tick) -> Tick:
        messages = self._publisher.publish(made, self.shedding.leaves_out)
        tick = replace(made, messages=tuple(messages))
        self._cycle += 1
        self._presses.show(tick.advices, tick.now_ns)
        self._tell(lambda listener: listener.on_tick(tick))
        return tick

    def _take_received(self) -> None:
        for link, robots in zip(self._links, self._advised, strict=True):
            for received in link.take():
                self._tell(partial(_heard, link.name, received))
                message = received.message
                if isinstance(message, RobotState):
                    if message.robot not in robots:
                        self._strange_states.add(
                            message.robot, received.received_ns, link.name, robots
                        )
                    else:
                        tracker = self._robots[message.robot]
                        tracker.update(message, received.received_ns, link.name)
                        self._refused_states[message.robot].look(
                            message, received.received_ns, link.name
                        )
                elif isinstance(message, SetChoice):
                    self._risk.choose_set(link.name, message.number, received.received_ns)
                elif isinstance(message, Acknowledge):
                    self._acknowledge(link.name, robots, message, received.received_ns)

    def _acknowledge(
        self, link: str, robots: frozenset[int], message: Acknowledge, at_ns: int
    ) -> None:
        """Clear the displayed condition: lost people immediately, a latch if this tick's data
        permit it.
        """
        for press in self._presses.take(link, robots, message, at_ns):
            self.acknowledges += 1
            self._pressed.append(press)
            self._forgotten += self._people.acknowledge()

    def _release(self) -> None:
        """Release the latches that were acknowledged, if their causes have cleared."""
        pressed, self._pressed = self._pressed, []
        for press in pressed:
            released = self._risk.acknowledge(press.latch_id, press.down_ns)
            if not released and not self._forgotten:
                log.warning(
                    "acknowledge of latch %d refused (%d refused before): its cause has returned, "
                    "or another cause was added since",
                    press.latch_id,
                    self._refused,
                )
                self._refused += 1

    def _conditions(self, now_ns: int) -> tuple[Reason, ...]:
        held = (Reason.ACKNOWLEDGE_REPEATED,) if self._presses.are_held(now_ns) else ()
        return (*held, *self.conditions())

    def _state_of(
        self,
        snapshot: PeopleSnapshot | None,
        assessment: Assessment | None,
        reasons: tuple[Reason, ...],
    ) -> NodeState:
        if assessment is None or snapshot is None or Reason.SECOND_SENDER in snapshot.reasons:
            return NodeState.FAULT
        if self.state is NodeState.STARTING and snapshot.newest_capture_ns is None:
            return NodeState.STARTING
        trouble = any(reason.row.is_trouble for reason in reasons)
        if trouble or snapshot.reasons or not all(link.connected for link in self._links):
            return NodeState.DEGRADED
        return NodeState.RUNNING

    def _status(
        self,
        snapshot: PeopleSnapshot | None,
        reasons: tuple[Reason, ...],
        assessment: Assessment | None,
    ) -> Status:
        scene_reasons = snapshot.reasons if snapshot is not None else ()
        chosen = assessment.set_in_force if assessment is not None else None
        worst = (
            Reason.NODE_FAULT
            if assessment is None
            else next(iter(scene_reasons + reasons), Reason.NONE)
        )
        return Status(
            node_state=self.state,
            reason=worst,
            people=len(snapshot.ids) + len(snapshot.lost) if snapshot is not None else 0,
            predictor=self._predictor_index,
            cycle=self._cycle,
            capture_ns=snapshot.newest_capture_ns if snapshot is not None else None,
            set_number=None if chosen is None else chosen[0],
            set_hash=None if chosen is None else chosen[1],
        )

    def _all_robots(self, level: Level, reason: Reason) -> tuple[Advice, ...]:
        return tuple(
            Advice(robot=i, level=level, reason=reason, speed_limit_m_s=0.0)
            for i in range(len(self._robots))
        )

    def _tell(self, call: Callable[[Listener], None]) -> None:
        """Call every listener; count failures, which must not disturb the node."""
        for listener in self._listeners:
            try:
                call(listener)
            except BaseException as error:
                failure(error)
                if self.listener_failures == 0:
                    log.exception("a listener failed")
                self.listener_failures += 1


def _heard(link: str, received: Received, listener: Listener) -> None:
    listener.on_received(link, received)
