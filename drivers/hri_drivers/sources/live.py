"""Common part of all live sources: a supervised thread, reconnecting, counters, the room frame.

Each kind of source adds a *receiver*, which owns the device and returns bytes, and a *decoder*,
which turns bytes into scenes. The thread waits in the receiver's ``read``, decodes, and wakes the
node (``arrived``): nothing polls. Every error is counted, kept as ``last_error``, and the device is
reopened. ``hri_predict.people.people`` decides when the input is *stale*. The thread also opens the
device, so that a device that never opens blocks neither the start nor a signal.
"""

import logging
import threading
from concurrent.futures import Future
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from pydantic import Field

from hri_drivers.sources.inbox import SceneInbox
from hri_drivers.sources.pace import SenderPace
from hri_drivers.sources.sent import SentScene
from hri_drivers.wires.backoff import BackOff
from hri_drivers.wires.transport import READ_TIMEOUT_S
from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock, MonotonicClock
from hri_predict.base.errors import HriPredictError, SourceError, failure
from hri_predict.base.files import YAML_ENDINGS
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import MAX_RATE_HZ, MIN_RATE_HZ
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import SourceCounters, SourceSettings

log = logging.getLogger(__name__)

OPEN_S = 10.0
"""Maximum time that a start waits for a device; receivers report a reason earlier."""
WAIT_FOR_S = 3.0
"""The same maximum for a device that may be absent (``wait_for_device``)."""
CLOSE_S = 1.0
LOG_PERIOD_NS = 10_000_000_000
TROUBLE = (
    "crc_errors", "malformed", "unauthenticated", "replayed", "lost", "out_of_order", "incomplete",
    "overrun", "restarts", "disconnects",
)  # fmt: skip


class LiveSettings(SourceSettings):
    """``source:`` of every live kind."""

    joint_map: str = Field(
        "canonical",
        min_length=1,
        description="the sender's joints, units and axes: name of a shipped map, or a YAML file",
    )
    rate_hz: float = Field(ge=MIN_RATE_HZ, le=MAX_RATE_HZ, description="nominal scenes per second")
    declares_noise: bool = Field(
        True, description="bit-identical joints mean a frozen sensor; set false if they may repeat"
    )
    wait_for_device: bool = Field(
        False,
        description="start even if the device or server is missing, and keep trying",
    )

    safety: ClassVar[Safety] = harmless("wait_for_device") | {
        "declares_noise": LessSafe(
            other="a frozen source is not detected by its joints, while people keep moving unseen"
        ),
        "allow_unauthenticated": LessSafe(
            other="any program that reaches the source is believed, regardless of the positions "
            "that it reports"
        ),
    }

    @property
    def notes(self) -> list[str]:
        """Warnings if no latency is stated, or if network input is accepted without a key."""
        notes = []
        if self.min_latency_s == 0:
            notes.append(
                "min_latency_s is 0: zones are too small by 1.6 m/s times the true minimum delay "
                "from capture to arrival, which the node cannot measure: measure it, or take it "
                "from the tracker's data sheet"
            )
        open_to_all = getattr(self, "allow_unauthenticated", False)
        if open_to_all and getattr(self, "key_file", None) is None:
            notes.append(
                "allow_unauthenticated without a key: any program that reaches the source is "
                "believed"
            )
        return notes


class Receiver(Protocol):
    """Returns bytes; every ``Transport[bytes]`` is one. Only one thread uses it."""

    def open(self) -> None:
        """Open the device.

        Raises:
            HriPredictError: one line that names the device and the remedy.
        """

    def read(self, timeout_s: float) -> list[bytes]:
        """Return what has arrived, waiting at most ``timeout_s``; empty if nothing arrives.

        Raises:
            HriPredictError: the device or connection is lost.
        """

    def close(self) -> None:
        """Close it; never raises, safe to call twice."""


class Decoder(Protocol):
    """Turns bytes into scenes; counts packets and refusals."""

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """Scenes that ``data`` (one element of ``Receiver.read``) completes; never raises.

        ``received_ns`` is the time on the node's clock.
        """

    def reset(self) -> None:
        """Discard incomplete data: the connection is new."""


class LiveSource:
    """See ``hri_predict.contracts.source.Source`` and ``Live``.

    Args:
        settings: the source's.
        receiver: returns bytes.
        decoder: turns them into scenes; counts packets and refusals in ``counters``.
        counters: shared with the decoder.
        joint_map: the sender's joints; see ``sender_joints``.
        clock: the node's.

    Attributes:
        counters, connected, arrived, stamps_utc, label: see ``Live``.
        live: itself.
    """

    settings_model: ClassVar[type[LiveSettings]] = LiveSettings
    stamps_utc = False

    def __init__(
        self,
        *,
        settings: LiveSettings,
        receiver: Receiver,
        decoder: Decoder,
        counters: SourceCounters,
        joint_map: JointMap,
        clock: Clock | None = None,
    ) -> None:
        self.joint_map = joint_map
        self.rate_hz = settings.rate_hz
        self.declares_noise = settings.declares_noise
        self.counters = counters
        self.connected = False
        self.arrived = threading.Event()
        self.label = f"source '{settings.kind}'"
        self.live = self
        self._settings = settings
        self._receiver = receiver
        self._decoder = decoder
        self._clock = clock or MonotonicClock()
        self._inbox = SceneInbox(settings.rate_hz)
        self._room_from_sent = _room_from_sent(settings, joint_map)
        self._session: int | None = None
        self._shift = self._last_sequence = 0
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._opened_before = False
        self._back_off = BackOff()
        self._pace = SenderPace(settings.rate_hz)
        self._logged: dict[str, Any] = {}
        self._log_ns = 0

    def open(self, start_ns: int) -> None:
        """Open the device and start the thread.

        Raises:
            SourceError: the device is absent, unless ``wait_for_device`` is set.
        """
        if self._thread is not None:
            return
        self._stopping.clear()
        tried: Future[None] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(tried,), name=f"{self._settings.kind}-source", daemon=True
        )
        self._thread.start()
        waits = self._settings.wait_for_device
        limit_s = WAIT_FOR_S if waits else OPEN_S
        try:
            tried.result(limit_s)
        except (HriPredictError, TimeoutError) as error:
            if waits:
                return
            self.close()
            why = error if isinstance(error, HriPredictError) else f"not open within {limit_s:g} s"
            raise SourceError(f"{self.label}: {why}") from error
        except BaseException:  # a signal, or what no device should raise
            self.close()
            raise

    def next_ns(self) -> int:
        """Time at which ``poll`` may return a scene; ``NOT_KNOWN_NS`` until one arrives."""
        return self._inbox.next_ns()

    def poll(self, now_ns: int) -> Scene | None:
        """The oldest waiting scene, or the newest in a flood; metres, in the room."""
        sent = self._inbox.take(now_ns)
        self.counters.overrun = self._inbox.overrun
        return None if sent is None else self._numbered(sent).in_room(self._room_from_sent)

    def close(self) -> None:
        """Stop the thread. Safe to call twice."""
        thread, self._thread = self._thread, None
        self._stopping.set()
        if thread is not None:
            thread.join(CLOSE_S)
            if thread.is_alive():
                log.warning("%s: its device failed to close", self.label)

    # -- the thread -------------------------------------------------------------------------------

    def _run(self, tried: "Future[None]") -> None:
        self._connect_first(tried)
        while not self._stopping.is_set():
            try:
                if not self.connected:
                    self._connect()
                for data in self._receiver.read(READ_TIMEOUT_S):
                    self._hear(data)
            except BaseException as error:  # the thread must survive any fault of its device
                self._lost(failure(error))
                self._stopping.wait(self._back_off.next_s(self._clock.now_ns()))
            self._log_trouble()
        self.connected = False
        self._receiver.close()

    def _connect_first(self, tried: "Future[None]") -> None:
        """Open the device for the first time, and report the result."""
        try:
            self._connect()
        except BaseException as raised:  # the thread must survive any fault of its device
            error = failure(raised)
            self._lost(error)
            tried.set_exception(error)
            self._stopping.wait(self._back_off.next_s(self._clock.now_ns()))
        else:
            tried.set_result(None)

    def _connect(self) -> None:
        self._receiver.open()
        self._decoder.reset()
        self._back_off.opened(self._clock.now_ns())
        self.connected = True
        if self._opened_before:
            self.counters.reconnects += 1
            log.info("%s: connected again", self.label)
        self._opened_before = True

    def _lost(self, error: Exception) -> None:
        """Close, and record the cause."""
        if self.connected:
            log.warning("%s: %s; trying again", self.label, error)
            self.counters.disconnects += 1
        self.connected = False
        self.counters.note(error)
        self._receiver.close()

    def _hear(self, data: bytes) -> None:
        self.counters.bytes_received += len(data)
        try:
            scenes = self._decoder.feed(data, self._clock.now_ns())
        except BaseException as error:  # a faulty decoder: only these bytes are lost
            self.counters.malformed += 1
            self.counters.note(failure(error))
            self._decoder.reset()
            return
        for sent in scenes:
            self.counters.scenes += 1
            self._inbox.put(sent)
        if scenes:
            self.arrived.set()

    def _log_trouble(self) -> None:
        """Log the errors since the last line: the first immediately, then at most every 10 s."""
        now_ns = self._clock.now_ns()
        if slow := self._pace.note(self.counters.scenes, self.connected, now_ns):
            log.warning("%s: %s", self.label, slow)
        if now_ns < self._log_ns:
            return
        counts = asdict(self.counters)
        news = [
            _counted(counts[name] - self._logged.get(name, 0), name)
            for name in TROUBLE
            if counts[name] > self._logged.get(name, 0)
        ]
        if news:
            self._logged, self._log_ns = counts, now_ns + LOG_PERIOD_NS
            error = f" ({counts['last_error']})" if counts["last_error"] else ""
            log.warning("%s: %s%s", self.label, ", ".join(news), error)

    # -- the taker --------------------------------------------------------------------------------

    def _numbered(self, sent: SentScene) -> SentScene:
        """Return the scene with a sequence that continues across the sender's sessions."""
        if sent.session != self._session:
            if self._session is not None:
                self.counters.restarts += 1
                self._shift = self._last_sequence + 1 - sent.sequence
            self._session = sent.session
        self._last_sequence = sent.sequence + self._shift
        return replace(sent, sequence=self._last_sequence)


def _counted(count: int, name: str) -> str:
    """``1 crc error``, ``2 restarts of the sender``."""
    words = (name.removesuffix("s") if count == 1 else name).replace("_", " ")
    return f"{count} {words}" + (" of the sender" if name == "restarts" else "")


def _room_from_sent(settings: LiveSettings, joint_map: JointMap) -> Floats:
    """(4, 4) from the sender's units, axes and frame to metres in the room."""
    to_metres = np.eye(4)
    to_metres[:3, :3] = joint_map.rotation * joint_map.scale_to_m
    matrix: Floats = settings.room_from_source.matrix() @ to_metres
    return matrix


def sender_joints(settings: LiveSettings, base_dir: Path | None) -> JointMap:
    """The configured joint map; a file's relative path starts at ``base_dir``.

    Raises:
        ConfigError: the map does not exist, or its file is wrong.
    """
    name = settings.joint_map
    if base_dir is not None and name.endswith(YAML_ENDINGS) and (base_dir / name).exists():
        name = str(base_dir / name)
    return load_joint_map(name)
