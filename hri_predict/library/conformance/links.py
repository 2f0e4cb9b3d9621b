"""Requirements of the contract on a link; see ``hri_predict.contracts.link``.

The link has a wire in memory instead of a device. A second one of its kind plays the controller.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hri_predict.base.clock import MonotonicClock
from hri_predict.contracts import registry
from hri_predict.contracts.link import (
    LinkCounters,
    LinkSettings,
    check_load,
)
from hri_predict.contracts.link_abilities import Unprotected
from hri_predict.library.conformance.checks import (
    CheckResult,
    Skipped,
    demand,
    demand_soon,
    refuses_nonsense,
    run_checks,
)
from hri_predict.library.conformance.link_part import RATE_HZ, LinkPart
from hri_predict.library.conformance.messages import advice, singles, state, status, zone
from hri_predict.library.conformance.wire import Wire, damaged, noise, units_from
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    RobotState,
    Status,
)
from hri_predict.protocol.reception import OURS, ReceiveCounters

REOPENS_S = 10.0
MANY = 1000
NOISE_SHARE = 0.01  # of pure noise; an eight-bit CRC lets one frame in 256 through
AGE_S = 0.1
REFUSED = "crc_errors counter_errors malformed incomplete ignored echoes unexpected foreign"
AGE_STEP_S = 0.01  # as fine as any protocol here carries an age


def check_link(name: str, settings: LinkSettings) -> list[CheckResult]:
    """Run all checks on the link registered as ``name``.

    Raises:
        HriPredictError: it cannot be made.
    """
    part = LinkPart(registry.load("links", name), settings)
    with registry.building(f"link '{name}'"):
        part.make()
    return run_checks(CHECKS, part)


def refuses_settings_that_make_no_sense(part: LinkPart) -> str:
    """Unknown keys and impossible values are refused by a ``ConfigError`` of one line."""
    wrong = (
        {"delay_s": -0.1},
        {"silence_timeout_s": 0},
        {"reserved_load": 2.0},
        {"reaction_s": "at once"},
        {"name": ""},
    )
    data = part.settings.model_dump(exclude_unset=True)
    return refuses_nonsense(part.cls.settings_model, data, wrong)


def knows_its_load(part: LinkPart) -> str:
    """The load is finite, above 0, the sum of its details, fits, and grows with the robots."""
    one, two = (part.cls.load(part.settings, RATE_HZ, robots) for robots in ((0,), (0, 1)))
    demand(math.isfinite(one.load) and one.load > 0, f"load is {one.load!r}")
    demand(math.isclose(one.load, sum(one.details.values())), "load is not its details' sum")
    spare = 1.0 - one.load - part.settings.reserved_load
    demand(
        one.spare <= spare + 1e-9, f"spare is {one.spare:.3f}; 1 - load - reserved is {spare:.3f}"
    )
    demand(two.load >= one.load, "two robots cause less load than one")
    check_load(one)
    return f"{one.load:.2%} at {RATE_HZ:g} Hz with one robot, {two.load:.2%} with two"


def opens_nothing_until_started(part: LinkPart) -> str:
    """Creating a link opens nothing; its attributes exist."""
    link, wire = part.make()
    demand(wire.opened == 0, "it opens its device when it is made")
    demand(link.name == part.settings.name, f"name is {link.name!r}")
    demand(isinstance(link.counters, LinkCounters), "counters: must be LinkCounters")
    untroubled = not link.connected and link.last_error is None and link.foreign_ns is None
    demand(untroubled, "it is connected, or has had trouble")
    demand(link.on_sent is None, "on_sent must be None until it is set")
    demand(link.take() == [], "it has received something")
    return "closed, all counters 0"


def never_blocks_in_post(part: LinkPart) -> str:
    """``post`` and ``take`` return immediately in real time, even if each write takes 0.2 s."""
    wire = Wire()
    wire.write_s = 0.2
    link = part.cls(part.settings, MonotonicClock(), wire, rate_hz=RATE_HZ, robots=(0, 1))
    link.start()
    taken = []
    for cycle in range(MANY):
        began = time.perf_counter()
        link.post(status(cycle))
        link.take()
        taken.append(time.perf_counter() - began)
    for _ in range(2):
        link.stop()
    demand(not wire.is_open, "stop leaves its device open")
    return f"{MANY} messages: {demand_soon(taken, 'post')}"


def sends_the_newest(part: LinkPart) -> str:
    """The newest message waiting for the wire is sent once: for each robot its own Advice."""
    link, wire = part.make()
    wire.lost = True
    for cycle in range(10):
        link.post(status(cycle))
        link.post(advice(0, 0.1 * cycle))
        link.post(advice(1, 0.2 * cycle))
        part.run(link, 0.04)
    wire.lost = False
    part.run(link, REOPENS_S)
    got = part.decoded(wire.written)
    cycles = [m.cycle for m in got if isinstance(m, Status)]
    robots = sorted(m.robot for m in got if isinstance(m, Advice))
    if not cycles and not robots:
        raise Skipped("not written with these settings: Status, Advice")
    demand(cycles == [9], f"Status of cycles {cycles}: the newest alone, 9, must go")
    demand(robots == [0, 1], f"Advice of robots {robots}: one of each must go")
    dropped = link.counters.superseded
    demand(dropped == 27, f"{dropped} messages counted as superseded, 27 were")
    return "30 messages posted to a wire that was lost: the 3 newest sent, 27 counted"


def accounts_for_every_message(part: LinkPart) -> str:
    """Every posted message is counted as sent, superseded, decimated, or failed."""
    link, wire = part.make()
    posted = 0
    for cycle in range(50):
        for message in (status(cycle), advice(0, 0.5), OURS, zone(cycle)):
            link.post(message)
            posted += 1
        if cycle % 3 == 0:
            part.run(link, 0.04)
    part.run(link, 2.0)
    link.stop()
    c = link.counters
    counted = c.messages_sent + c.superseded + c.decimated + c.write_errors
    demand(counted == posted, f"{posted} messages posted, {counted} accounted for: {_short(c)}")
    demand(c.bytes_sent > 0 or not wire.written, "bytes_sent is 0")
    return f"{posted} posted: {_short(c)}"


def says_how_old_it_is(part: LinkPart) -> str:
    """The age is set when a message is sent: the time since its capture."""
    _needs_our_frames(part)
    link, wire = part.make()
    capture_ns = part.clock.now_ns() - round(AGE_S * 1e9)
    captured = replace(advice(0, 0.5), capture_ns=capture_ns)
    got = part.decoded(units_from(link, wire, part.clock, captured))
    ages = [m.age_s for m in got if isinstance(m, Advice)]
    demand(len(ages) == 1 and ages[0] is not None, f"of an Advice arrived {got}")
    off_s = abs((ages[0] or 0.0) - AGE_S)
    demand(off_s <= AGE_STEP_S, f"age {ages[0]!r} s of what was captured {AGE_S:g} s ago")
    return f"age of an Advice right to {1e3 * off_s:.1f} ms"


def hears_the_controller(part: LinkPart) -> str:
    """RobotState and Acknowledge arrive in order, with the time of receipt; Advice echoes."""
    _needs_our_frames(part)
    node, wire = part.make()
    far, far_wire = part.make()
    sent, press = state(7), Acknowledge(3, 9)
    for message in (sent, press):
        wire.incoming.extend(units_from(far, far_wire, part.clock, message))
    part.run(node, 0.04)
    got = node.take()
    demand([type(r.message) for r in got] == [RobotState, Acknowledge], f"received {got}")
    demand(all(r.received_ns == part.clock.now_ns() for r in got), "received_ns is not the time")
    heard = got[0].message
    demand(isinstance(heard, RobotState) and heard.counter == 7, f"{sent} arrived as {heard}")
    demand(got[1].message == press, f"{press} arrived as {got[1].message}")
    demand(node.counters.messages_received == 2, "messages_received is not 2")
    demand(node.take() == [], "take gives the same again")
    answer = part.decoded(units_from(node, wire, part.clock, advice(0, 0.5)))
    echoes = [m.echo for m in answer if isinstance(m, Advice)]
    demand(echoes == [7], f"Advice echoes {echoes}, the newest RobotState's counter is 7")
    return "RobotState and Acknowledge; Advice echoes the counter"


def does_not_hear_itself(part: LinkPart) -> str:
    """Its own messages received back are counted, not passed on, and not taken as foreign."""
    _needs_our_frames(part)
    link, wire = part.make()
    wire.incoming.extend(units_from(link, wire, part.clock, status(1)))
    part.run(link, 0.04)
    demand(link.take() == [] and _refused(link.counters) > 0, "its own Status is not counted")
    demand(link.counters.foreign == 0, "its own Status is taken for a second sender's")
    return "own Status received: counted"


def tells_a_second_sender(part: LinkPart) -> str:
    """A frame from another sender with this node's ids is counted and timed, but not passed on."""
    _needs_our_frames(part)
    link, wire = part.make()
    for cycle in (2, 3):  # the CRC of one may be right by chance
        wire.incoming.extend(part.units(status(cycle)))
        part.run(link, 0.04)
    nothing, at_ns, foreign = link.take() == [], link.foreign_ns, link.counters.foreign
    counted = nothing and foreign > 0 and at_ns == part.clock.now_ns()
    demand(counted, "another node's Status is not counted as foreign, with its time")
    return f"Status of another node: {foreign} counted"


def finds_messages_in_a_stream(part: LinkPart) -> str:
    """Two messages are decoded as two, whether they arrive in one piece or byte by byte."""
    _needs_our_frames(part)
    far, wire = part.make()
    pieces = []
    for message in (state(1), Acknowledge(3, 9)):
        units = units_from(far, wire, part.clock, message)
        if not all(isinstance(unit, bytes) for unit in units):
            raise Skipped("its units are not a stream: each comes whole or not at all")
        pieces += [unit for unit in units if isinstance(unit, bytes)]
    stream = b"".join(pieces)
    expected = [RobotState, Acknowledge]
    glued = part.decoded([stream])
    demand([type(m) for m in glued] == expected, f"in one piece: {glued}")
    single = part.decoded([stream[i : i + 1] for i in range(len(stream))])
    demand([type(m) for m in single] == expected, f"byte by byte: {single}")
    return f"{len(stream)} bytes in one piece, and byte by byte"


def believes_nothing_damaged(part: LinkPart) -> str:
    """A message with one to three wrong bits is refused and counted, and never raises."""
    _needs_our_frames(part)
    rng = np.random.default_rng(0)
    receiver = part.cls.receiver(part.settings)
    senders = [(message, *part.make()) for message in singles()]
    tried = believed = 0
    for k in range(MANY):
        message, link, wire = senders[k % len(senders)]
        try:
            units = units_from(link, wire, part.clock, message)
        except Skipped:
            continue
        place = int(rng.integers(len(units)))
        units[place] = damaged(units[place], rng)
        tried += 1
        believed += sum(len(receiver.feed(unit)) for unit in units)
    if not tried:
        raise Skipped("this link writes nothing with these settings")
    demand(believed == 0, f"{believed} of {tried} damaged messages were believed; add a CRC")
    counted = _refused(receiver.counters)
    demand(counted > 0, "what is refused is not counted")
    return f"{tried} messages damaged, {believed} believed; {counted} counts"


def survives_noise(part: LinkPart) -> str:
    """Random bytes never raise and are almost never accepted; valid messages after them are
    received.
    """
    _needs_our_frames(part)
    rng = np.random.default_rng(1)
    receiver = part.cls.receiver(part.settings)
    link, wire = part.make()
    like = units_from(link, wire, part.clock, status(0))[0]
    believed = sum(len(receiver.feed(noise(like, rng))) for _ in range(MANY))
    demand(
        believed <= NOISE_SHARE * MANY,
        f"{believed} of {MANY} pieces of noise were taken for messages; protect them better",
    )
    for cycle in range(1, 4):
        for unit in units_from(link, wire, part.clock, status(cycle)):
            for message in receiver.feed(unit):
                if isinstance(message, Status) and message.cycle == cycle:
                    return f"{MANY} pieces, {believed} believed; Status {cycle} heard after them"
    demand(False, "after noise three sound messages were not heard")
    return ""


def counts_what_it_refuses(part: LinkPart) -> str:
    """Noise on the wire is not passed on; the link's counters report it."""
    _needs_our_frames(part)
    rng = np.random.default_rng(2)
    link, wire = part.make()
    like = part.units(status(0))[0]
    wire.incoming.extend(noise(like, rng) for _ in range(100))
    part.run(link, 0.2)
    believed = len(link.take())
    demand(believed <= 1, f"{believed} of 100 pieces of noise were taken for messages")
    demand(_refused(link.counters) > 0, "noise is not counted")
    demand(link.counters.bytes_received > 0, "bytes_received is 0")
    demand(link.connected, "noise closes the link")
    return f"100 pieces: {_refused(link.counters)} counts"


def comes_back_after_a_loss(part: LinkPart) -> str:
    """A lost device is counted, reported, and reopened; nothing is raised."""
    link, wire = part.make()
    units_from(link, wire, part.clock, status(0))
    demand(link.connected, "a link that is serviced does not open its device")
    wire.lost = True
    link.post(status(1))
    part.run(link, 0.2)
    demand(not link.connected, "connected, although the device is lost")
    demand(link.counters.disconnects == 1, f"disconnects is {link.counters.disconnects}, not 1")
    demand(bool(link.last_error), "last_error does not mention the loss")
    wire.lost = False
    wire.written.clear()
    part.run(link, REOPENS_S)
    demand(link.connected and link.counters.reconnects == 1, "it does not reconnect")
    link.post(status(2))
    part.run(link, 0.04)
    cycles = [m.cycle for m in part.decoded(wire.written) if isinstance(m, Status)]
    heard = cycles[-1:] == [2] or isinstance(part.cls, Unprotected)
    demand(heard, f"after the loss Status of cycles {cycles} went, not 2")
    return "one disconnect, one reconnect"


def tells_the_recorder(part: LinkPart) -> str:
    """``on_sent`` is called with name, bytes and time for each unit written."""
    link, wire = part.make()
    told: list[tuple[str, bytes, int]] = []
    link.on_sent = lambda name, data, now_ns: told.append((name, data, now_ns))
    units = units_from(link, wire, part.clock, advice(0, 0.5))
    demand(len(told) == len(units), f"{len(units)} units written, {len(told)} reported")
    expected = (part.settings.name, part.clock.now_ns())
    demand(all((n, t) == expected for n, _, t in told), "another name or time is reported")
    demand(all(isinstance(data, bytes) and data for _, data, _ in told), "no bytes are reported")
    return f"units of an Advice: {len(told)}"


def stops_twice(part: LinkPart) -> str:
    """``stop`` writes posted messages and closes; it may be called twice or without a start."""
    idle, _ = part.make()
    idle.stop()
    idle.stop()
    link, wire = part.make()
    units_from(link, wire, part.clock, status(0))
    wire.written.clear()
    link.post(status(1))
    link.stop()
    link.stop()
    cycles = [m.cycle for m in part.decoded(wire.written) if isinstance(m, Status)]
    heard = cycles == [1] or isinstance(part.cls, Unprotected)
    demand(heard, "the last word posted does not leave the node")
    demand(not (wire.is_open or link.connected), "stop leaves its device open")
    return "the last word sent, then closed"


CHECKS: tuple[Callable[[LinkPart], str], ...] = (
    refuses_settings_that_make_no_sense,
    knows_its_load,
    opens_nothing_until_started,
    never_blocks_in_post,
    sends_the_newest,
    accounts_for_every_message,
    says_how_old_it_is,
    hears_the_controller,
    does_not_hear_itself,
    tells_a_second_sender,
    finds_messages_in_a_stream,
    believes_nothing_damaged,
    survives_noise,
    counts_what_it_refuses,
    comes_back_after_a_loss,
    tells_the_recorder,
    stops_twice,
)


def _needs_our_frames(part: LinkPart) -> None:
    """Skip a check that requires this node's own frames.

    Raises:
        Skipped: the link speaks a third-party protocol.
    """
    if isinstance(part.cls, Unprotected):
        raise Skipped("it speaks a third-party protocol, without CRC and counters of this node")


def _refused(counters: LinkCounters | ReceiveCounters) -> int:
    """Return the number of refusals, for any reason."""
    return sum(getattr(counters, name, 0) for name in REFUSED.split())


def _short(c: LinkCounters) -> str:
    dropped = f"{c.superseded} superseded, {c.decimated} decimated"
    return f"{c.messages_sent} sent, {dropped}, {c.write_errors} failed"
