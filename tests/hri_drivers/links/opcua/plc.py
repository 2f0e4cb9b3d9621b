"""A plant's client, by asyncua: one request for each line of JSON, one answer each.

    python plc.py URL [CERTIFICATE KEY]

``{"read": [name, ...]}``: status, value and source time (s) of each; ``{"call": [latch, ack]}``,
``{"choose": [number, counter]}``, ``{"write": [name, value]}``, ``{"add": 1}``: the status;
``{"subscribe": [names], "ms": 20}``, then ``{"changes": seconds}``: what came, as [name, status,
value, time of receipt].
"""

import asyncio
import json
import sys
import time
from typing import Any

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

TYPES = {"ACK_LATCH_ID": ua.VariantType.UInt16, "ACK_ID": ua.VariantType.UInt32}


class Changes:
    """Keeps what a subscription brings."""

    def __init__(self) -> None:
        self.came: list[list[Any]] = []

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """See asyncua."""
        found = data.monitored_item.Value
        name = str(node.nodeid.Identifier)
        self.came.append([name, found.StatusCode.name, value, time.monotonic_ns()])


def node(client: Client, name: str) -> Any:
    """A node of the server's own namespace."""
    return client.get_node(ua.NodeId(name, 2))


class Plc:
    """The client, and its subscription."""

    def __init__(self, client: Client) -> None:
        self.client, self.changes = client, Changes()

    async def answer(self, asked: dict[str, Any]) -> Any:
        """Do what is asked."""
        if "read" in asked:
            nodes = [node(self.client, name) for name in asked["read"]]
            found = await self.client.read_attributes(nodes)
            return [
                [
                    each.StatusCode.name,
                    each.Value.Value if each.Value else None,
                    each.SourceTimestamp.timestamp() if each.SourceTimestamp else None,
                ]
                for each in found
            ]
        if "call" in asked:
            latch, ack = (
                ua.Variant(value, kind)
                for value, kind in zip(asked["call"], TYPES.values(), strict=True)
            )
            await self.client.nodes.objects.call_method(ua.NodeId("Acknowledge", 2), latch, ack)
        elif "choose" in asked:
            given = [ua.Variant(value, ua.VariantType.UInt16) for value in asked["choose"]]
            await self.client.nodes.objects.call_method(ua.NodeId("ChooseSet", 2), *given)
        elif "write" in asked:
            name, value = asked["write"]
            await node(self.client, name).write_value(ua.Variant(value, ua.VariantType.UInt16))
        elif "add" in asked:
            await self.client.nodes.objects.add_folder(ua.NodeId("Own", 2), "2:Own")
        elif "subscribe" in asked:
            taken = await self.client.create_subscription(asked["ms"], self.changes)
            await taken.subscribe_data_change([node(self.client, n) for n in asked["subscribe"]])
        else:
            await asyncio.sleep(asked["changes"])
            came, self.changes.came = self.changes.came, []
            return came
        return "Good"


async def main(url: str, *secured: str) -> None:
    """Answer until the input ends."""
    client = Client(url, timeout=20)
    if secured:
        await client.set_security(SecurityPolicyBasic256Sha256, *secured)
    loop = asyncio.get_running_loop()
    try:
        await client.connect()
    except Exception as error:
        print(json.dumps({"refused": type(error).__name__}), flush=True)
        return
    print(json.dumps("ready"), flush=True)
    plc = Plc(client)
    while line := await loop.run_in_executor(None, sys.stdin.readline):
        try:
            answer = await plc.answer(json.loads(line))
        except ua.UaStatusCodeError as error:
            answer = ua.StatusCode(error.code).name
        except (OSError, TimeoutError, ua.UaError) as error:
            answer = {"lost": type(error).__name__}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
