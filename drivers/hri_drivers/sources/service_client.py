"""A client that finds its sender by the name that the sender announces."""

from collections.abc import Callable

from hri_drivers.sources.tcp import Splitter, StreamClient
from hri_predict.protocol.discovery.browser import find
from hri_predict.protocol.discovery.services import SOURCES, ServiceSettings

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
