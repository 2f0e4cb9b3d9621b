"""``listen``: print the messages that a controller would receive on a link."""

import dataclasses
import json
import math
import time
from collections.abc import Sequence
from enum import IntEnum
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.base.set_key import set_key
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts import registry
from hri_predict.contracts.link import AnyLinkClass, LinkSettings
from hri_predict.protocol.can import DEFAULT_BASE_ID
from hri_predict.protocol.messages import Advice, BaseMotion, Level, Message, Schema, Status
from hri_predict.protocol.reception import ERRORS, FORGET_S, ReceiveCounters, SchemaGate

READ_TIMEOUT_S = 0.2
SILENCE_S = 0.5
ERRORS_S = 1.0  # errors are told so often at most
DISPUTE = 3  # errors within ERRORS_S that are more than a restarted node makes
HINT = "a bad line, or two nodes with the same ids"


def listen(
    *,
    link: Annotated[
        str,
        typer.Argument(
            help="serial:PORT or can:INTERFACE:CHANNEL, as in the configuration; for another kind "
            "of link, its kind, with --set for its settings."
        ),
    ],
    baudrate: Annotated[int, typer.Option(help="Serial: bits per second.")] = 115200,
    bitrate: Annotated[int, typer.Option(help="CAN: bits per second.")] = 500000,
    fd: Annotated[bool, typer.Option("--fd", help="CAN: use CAN FD.")] = False,
    base_id: Annotated[
        int, typer.Option(help="CAN: id of the first frame, in decimal.")
    ] = DEFAULT_BASE_ID,
    extended: Annotated[bool, typer.Option("--extended", help="CAN: use 29-bit ids.")] = False,
    isotp_id: Annotated[
        int | None, typer.Option(help="CAN: id of zones sent by ISO-TP; default: base id + 70.")
    ] = None,
    listen_only: Annotated[
        bool,
        typer.Option("--listen-only", help="CAN: send nothing, not even acknowledgement bits."),
    ] = False,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", help="A setting of the link: key=value. Repeatable."),
    ] = None,
    alerts: Annotated[
        bool, typer.Option("--alerts", help="Print only changes of level and of the node's state.")
    ] = False,
    seconds: Annotated[float | None, typer.Option(help="Stop after this many seconds.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON lines on standard output.")
    ] = False,
) -> None:
    """Print the messages that a controller would receive on a link; send nothing.

    Until a Schema with this program's version and hash arrives, all other messages are shown as
    unknown, with the reason.

    Example: hri-predict listen can:socketcan:can0 --alerts
    """
    if seconds is not None and not 0 < seconds < math.inf:
        raise ConfigError(f"--seconds {seconds}: give a number above 0")
    can: dict[str, Any] = {"bitrate": bitrate, "fd": fd, "base_id": base_id, "extended": extended}
    if isotp_id is not None:
        can["isotp"] = {"id": isotp_id, "peer_id": isotp_id ^ 1}  # only the controller answers
    cls, settings = _settings(link, {"baudrate": baudrate}, can, change or [])
    if listen_only:
        if settings.kind != "can":
            raise ConfigError(f"--listen-only: only for CAN, not for {link}; leave it out")
        settings = settings.model_copy(update={"listen_only": True})
    with registry.building(f"link '{link}'"):
        transport = cls.make_transport(settings)
        receiver = cls.receiver(settings)
    transport.open()
    printer = Printer(alerts, as_json)
    began = last = time.monotonic()
    silent = False
    try:
        while seconds is None or time.monotonic() - began < seconds:
            for unit in transport.read(READ_TIMEOUT_S):
                for message in receiver.feed(unit):
                    printer.show(message, time.monotonic() - began)
                    last, silent = time.monotonic(), False
            printer.errors(receiver.counters, time.monotonic() - began)
            silence_s = time.monotonic() - last
            if not silent and silence_s > SILENCE_S:
                printer.silent(time.monotonic() - began)
                silent = True
            if silence_s > FORGET_S:
                printer.forget()
    finally:
        transport.close()
        printer.counters(receiver.counters)


def _settings(
    link: str, serial: dict[str, Any], can: dict[str, Any], changes: Sequence[str]
) -> tuple[AnyLinkClass, LinkSettings]:
    """Return the link's class and its settings, from the options for this kind of link."""
    kind, _, rest = link.partition(":")
    if kind == "serial" and rest:
        data: dict[str, Any] = {"port": rest, **serial}
    elif kind == "can" and ":" in rest:
        interface, _, channel = rest.partition(":")
        data = {"interface": interface, "channel": channel, **can}
    elif link in {"serial", "can"} or link not in registry.names("links"):
        raise ConfigError(
            f"listen {link}: give serial:PORT or can:INTERFACE:CHANNEL; for another kind of link, "
            f"KIND and --set key=value"
        )
    else:
        data = {}
    cls = registry.load("links", kind)
    data = {"name": "listen", "kind": kind, **data}
    for change in changes:
        set_key(data, change)
    return cls, validated(cls.settings_model, data, link)


class Printer:
    """Prints messages as text or JSON lines; without a matching Schema, as unknown."""

    def __init__(self, alerts: bool, as_json: bool) -> None:
        self._alerts, self._json = alerts, as_json
        self._last: dict[Any, Any] = {}
        self._gate = SchemaGate()
        self._errors = 0
        self._told_s = -math.inf

    def show(self, message: Message, seconds: float) -> None:
        """Print a message received ``seconds`` after the start."""
        if isinstance(message, Schema):
            self._gate.take(message)
        if self._alerts and not self._is_news(message):
            return
        if isinstance(message, Schema):
            shown = {"version": message.version, "hash": f"{message.hash:#010x}"}
            shown |= {"matches": self._gate.open, **self._unknown()}
        elif self._gate.open:
            shown = self._fields(message)
        else:
            robot = {"robot": message.robot} if isinstance(message, Advice) else {}
            shown = {**robot, **self._unknown()}
        self._out(type(message).__name__.lower(), shown, seconds)

    def errors(self, counters: ReceiveCounters, seconds: float) -> None:
        """Report errors since the last report, at most once a second."""
        counts = {name: getattr(counters, name) for name in ERRORS}
        new = sum(counts.values()) - self._errors
        if new == 0 or seconds - self._told_s < ERRORS_S:
            return
        self._errors += new
        self._told_s = seconds
        hint = {"why": HINT} if new >= DISPUTE else {}
        self._out("errors", {"new": new, **counts, **hint}, seconds)

    def silent(self, seconds: float) -> None:
        """Report that the link is silent."""
        self._out("silent", {"level": Level.UNKNOWN.name.lower()}, seconds)

    def forget(self) -> None:
        """Drop the Schema: the sender must send it again after a silence of this length."""
        self._gate.reset()

    def _unknown(self) -> dict[str, Any]:
        if self._gate.open:
            return {}
        return {"level": Level.UNKNOWN.name.lower(), "why": self._gate.why}

    def _fields(self, message: Message) -> dict[str, Any]:
        fields = {f.name: getattr(message, f.name) for f in dataclasses.fields(message)}
        for hidden in ("capture_ns", "detail"):
            fields.pop(hidden, None)
        shown = {k: v.name.lower() if isinstance(v, IntEnum) else v for k, v in fields.items()}
        if isinstance(message, Advice) and message.reason.clears_when:
            shown["clears_when"] = message.reason.clears_when
        return shown

    def counters(self, counters: Any) -> None:
        """Print the receiver's counters."""
        self._out("counters", dataclasses.asdict(counters), None)

    def _is_news(self, message: Message) -> bool:
        key: tuple[str, int]
        value: Any
        if isinstance(message, Schema):
            key, value = ("schema", 0), (self._gate.why,)
        elif isinstance(message, Advice):
            key = ("advice", message.robot)
            value = (message.level, message.reason, message.mode)
        elif isinstance(message, Status):
            key, value = ("status", 0), (message.node_state, message.reason)
        else:
            return False
        value = value if self._gate.open else self._gate.why
        news = self._last.get(key) != value
        self._last[key] = value
        return news

    def _out(self, what: str, fields: dict[str, Any], seconds: float | None) -> None:
        if self._json:
            stamp = {} if seconds is None else {"time_s": round(seconds, 4)}
            if "capsules" in fields:  # by name, as all else
                fields = fields | {"capsules": [c._asdict() for c in fields["capsules"]]}
            line = json.dumps({"message": what, **stamp, **fields}, default=dataclasses.asdict)
            print(f"{line}\n", end="", flush=True)  # at once: Ctrl-C comes between two writes
            return
        at = "          " if seconds is None else f"{seconds:8.3f} s"
        named = {**fields, "body_part": _segment(fields.get("body_part"))}
        text = "  ".join(f"{k}={_short(v)}" for k, v in named.items() if v is not None)
        print(f"{at}  {what:8} {text}\n", end="", flush=True)


def _segment(index: int | None) -> str | int | None:
    """Return a body segment's index with its name, as PROTOCOL.md lists it: ``10 (l_foot)``."""
    names = CANONICAL.segment_names
    return f"{index} ({names[index]})" if index is not None and index < len(names) else index


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, BaseMotion):
        return _short(dataclasses.astuple(value))
    if isinstance(value, tuple):
        return (
            f"[{len(value)}]"
            if value and not isinstance(value[0], float)
            else str([round(v, 3) for v in value])
        )
    return str(value)
