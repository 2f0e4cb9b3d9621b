"""The setting of a UDP source that joins a multicast group."""

import ipaddress
from typing import Annotated

from pydantic import AfterValidator, Field


def _is_group(value: str | None) -> str | None:
    try:
        if value is None or ipaddress.IPv4Address(value).is_multicast:
            return value
    except ValueError:
        pass
    raise ValueError("must be an IPv4 multicast address, such as 239.255.0.1")


MulticastGroup = Annotated[
    str | None,
    AfterValidator(_is_group),
    Field(description="IPv4 address of a group to join"),
]
