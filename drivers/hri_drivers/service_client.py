"""A client of a sender that is known by the name that it announces, wherever it is now."""

from collections.abc import Callable

from hri_drivers.stream_receiver import Splitter, StreamClient
from hri_predict.discovery.browser import find
from hri_predict.discovery.services import SOURCES, ServiceSettings

TCP_SOURCE = SOURCES[0]


class ServiceClient(StreamClient):
    """``StreamClient`` that looks for its sender each time it opens."""

    def __init__(self, service: ServiceSettings, splitter: Callable[[], Splitter]) -> None:
        super().__init__("", 0, splitter)
        self._service = service

    def open(self) -> None:
        """Look for the sender, then connect.

        Raises:
            DiscoveryError: nobody of that name answers.
            SourceError: it does not let us connect.
        """
        self.close()
        self._address = find(TCP_SOURCE, self._service)
        super().open()
