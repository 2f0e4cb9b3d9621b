"""``kind: json``: one scene per line over TCP; ``codec`` defines the lines.

Each scene states its units and axes; the joint map gives only the names. TCP keeps the order, so a
sequence lower than the previous one means that the sender restarted.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from hri_drivers.sources.live import LiveSettings, LiveSource, Receiver, sender_joints
from hri_drivers.sources.scene_json.codec import LineSplitter, SceneJsonError, SceneReader
from hri_drivers.sources.sent import SentScene
from hri_drivers.sources.tcp import (
    ALLOW_UNAUTHENTICATED,
    Splitter,
    StreamClient,
    StreamServer,
    check_exposure,
)
from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.discovery.browser import find
from hri_predict.protocol.discovery.services import SOURCES, ServiceSettings

DEFAULT_PORT = 9871
MAX_LOST = 100_000
"""Maximum number of lost scenes; a larger jump ahead means that the sender restarted."""


class SceneJsonSettings(LiveSettings):
    """Settings common to both sources of JSON scenes."""

    min_confidence: float = Field(
        0.3, ge=0, le=1, description="joints sent with less confidence are unobserved"
    )

    safety: ClassVar[Safety] = {
        "min_confidence": LessSafe(below="joints with a confidence of {value:g} count as seen")
    }


class JsonSettings(SceneJsonSettings):
    """``source:`` of ``kind: json``."""

    kind: Literal["json"]
    role: Literal["server", "client"] = Field(
        "server", description="server: the sender connects to us; client: we connect to it"
    )
    host: str = Field(
        "127.0.0.1", min_length=1, description="address to listen on, or to connect to"
    )
    port: int = Field(DEFAULT_PORT, ge=0, le=65535, description="TCP port")
    service: ServiceSettings | None = Field(
        None, description="client: the name that the sender announces; replaces host and port"
    )
    allow_unauthenticated: bool = ALLOW_UNAUTHENTICATED

    safety: ClassVar[Safety] = harmless("port")

    @model_validator(mode="after")
    def _protected(self) -> Self:
        if self.role == "server":
            check_exposure(self.host, self.allow_unauthenticated)
        if self.service is not None and self.role == "server":
            raise ValueError("'service' needs 'role: client'; set it, or remove 'service'")
        for address in self.service.interfaces if self.service is not None else ():
            check_exposure(address, self.allow_unauthenticated)  # the name may be anybody's
        return self


class JsonDecoder:
    """Turns JSON texts into scenes, one each; see ``hri_drivers.sources.live.Decoder``."""

    def __init__(self, reader: SceneReader) -> None:
        self._reader = reader
        self._counters = reader.counters
        self._session = 0
        self._sequence: int | None = None

    def reset(self) -> None:
        """Do nothing: each text is a whole scene."""

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """Return the scene in ``data``, if it is valid."""
        self._counters.packets += 1
        try:
            scene = self._reader.read(data)
        except SceneJsonError as error:
            self._counters.malformed += 1
            self._counters.note(error)
            return []
        risen = 1 if self._sequence is None else scene.sequence - self._sequence
        if 0 <= risen <= MAX_LOST:
            self._counters.lost += max(0, risen - 1)
        else:
            self._session += 1
        self._sequence = scene.sequence
        return [replace(scene, session=self._session)]


class SceneJsonSource(LiveSource, ABC):
    """A live source of JSON scenes, over any carrier.

    Raises:
        ConfigError: the joint map is wrong.
    """

    def __init__(
        self,
        settings: Any,  # each kind's own
        base_dir: Path | None = None,
        clock: Clock | None = None,
    ) -> None:
        counters = SourceCounters()
        names = sender_joints(settings, base_dir)
        joint_map = names.with_units(1.0).with_axes(["x", "y", "z"])  # as the reader gives them
        reader = SceneReader(names.source_joints, settings.min_confidence, counters)
        self._reader = reader
        super().__init__(
            settings=settings,
            receiver=self._make_receiver(settings, counters),
            decoder=JsonDecoder(reader),
            counters=counters,
            joint_map=joint_map,
            clock=clock,
        )

    @property
    def stated(self) -> Floats | None:
        """See ``hri_predict.contracts.source.StatesFrame``."""
        return self._reader.stated

    @staticmethod
    @abstractmethod
    def _make_receiver(settings: Any, counters: SourceCounters) -> Receiver:
        """Return the receiver of the texts, not yet open."""


class JsonSource(SceneJsonSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = JsonSettings

    @staticmethod
    def _make_receiver(settings: JsonSettings, counters: SourceCounters) -> Receiver:
        if settings.role == "server":
            return StreamServer(
                host=settings.host,
                port=settings.port,
                splitter=LineSplitter,
                places=1,
                counters=counters,
            )
        if settings.service is not None:
            return ServiceClient(settings.service, LineSplitter)
        return StreamClient(settings.host, settings.port, LineSplitter)


TCP_SOURCE = SOURCES[0]


class ServiceClient(StreamClient):
    """``StreamClient`` that searches for its sender at each opening."""

    def __init__(self, service: ServiceSettings, splitter: Callable[[], Splitter]) -> None:
        super().__init__("", 0, splitter)
        self._service = service

    def open(self) -> None:
        """Search for the sender, then connect.

        Raises:
            DiscoveryError: no sender with that name answers.
            SourceError: the sender refuses the connection.
        """
        self.close()
        self._address = find(TCP_SOURCE, self._service)
        super().open()
