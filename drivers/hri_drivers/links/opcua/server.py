"""The OPC UA server's process, which ``transport.py`` starts.

The node writes blocks of the register map into a socket; presses of the button go back. It exits
when the socket closes. A single thread does all the work: if it hangs, clients receive nothing,
rather than old values that look fresh.
"""

import asyncio
import contextlib
import json
import os
import signal
import socket
import time
from collections import deque
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.common.callback import CallbackType
from asyncua.crypto import uacrypto

from hri_drivers.links.opcua import messages
from hri_drivers.links.opcua.limits import MOST, LimitedServer, Rules, shed
from hri_drivers.links.opcua.variables import Variables
from hri_drivers.links.plant.image import Block, Image
from hri_drivers.wires.quiet import quiet
from hri_predict.protocol.registers import CHOOSE_BASE, WRITE_BASE, WRITTEN, offset_of

PERIOD_S = 0.01
REPORT_NS = 200_000_000
SAY_NS = 10_000_000_000
MOST_PRESSES = 20
"""Maximum number of presses per second; a person does not press more often."""
NICE = 5  # the node's own threads come first, however much clients ask
_ACK_AT = WRITE_BASE + offset_of(WRITTEN, "ACK_LATCH_ID")
_TYPES = (ua.VariantType.UInt16, ua.VariantType.UInt32)


class PlantServer:
    """The server and its end of the socket.

    Args:
        link: to the node; non-blocking.
        asked: ``OpcUaTransport``'s settings.
    """

    def __init__(self, link: socket.socket, asked: dict[str, Any]) -> None:
        self._link, self._asked = link, asked
        self._rules = Rules()
        self._wake, self._ended = asyncio.Event(), False
        self._refused = 0
        self._presses: deque[int] = deque(maxlen=MOST_PRESSES)
        self._choices: deque[int] = deque(maxlen=MOST_PRESSES)
        self._shed, self._said_ns = [0, 0], -SAY_NS
        self._ack_id = 0  # of the newest press
        self._variables: Variables | None = None

    async def run(self) -> None:
        """Serve until the socket closes."""
        server = await self._opened()
        assert server.bserver is not None
        self._send(messages.READY + messages.number(server.bserver.port))
        asyncio.get_running_loop().add_reader(self._link, self._hear)
        reported_ns = 0
        while not self._ended:
            now_ns = time.monotonic_ns()
            await self._refresh()
            self._look_at(server.bserver.clients, now_ns)
            if now_ns - reported_ns >= REPORT_NS:
                reported_ns = now_ns
                refused = self._refused + self._rules.refused
                counts = (refused, self._variables.timeouts if self._variables else 0)
                self._send(messages.COUNTS + b"".join(map(messages.number, counts)))
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), PERIOD_S)
            self._wake.clear()
        asyncio.get_running_loop().remove_reader(self._link)
        await server.stop()

    async def _opened(self) -> Server:
        asked = self._asked
        trusted = None
        if asked["certificate"]:
            trusted = [await _certificate("trusted", path) for path in asked["trusted"]]
            trusted = [uacrypto.der_from_x509(each) for each in trusted]
        server = Server(iserver=LimitedServer(trusted))
        server.limits.max_message_size = messages.MOST * 16
        server.limits.max_chunk_count = 4
        server.name, server.manufacturer_name = f"hri-predict {asked['name']}", "hri-predict"
        server.product_uri, server._application_uri = "urn:hri-predict", "urn:hri-predict:server"
        server.application_type = ua.ApplicationType.Server
        await server.init()
        policy = ua.SecurityPolicyType.NoSecurity
        if asked["certificate"]:
            policy = ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt
            server.iserver.certificate = await _certificate("certificate", asked["certificate"])
            server.iserver.private_key = await _private_key(asked["private_key"])
            _check_pair(asked, server.iserver.certificate, server.iserver.private_key)
        server.set_security_policy([policy], self._rules)
        host, port = asked["host"], asked["port"]
        server.set_endpoint(f"opc.tcp://{f'[{host}]' if ':' in host else host}:{port}/")
        server.socket_address = (host, port)
        image = Image(asked["silence_s"], asked["max_age_s"])
        self._variables = Variables(server, image, asked["robots"])
        await self._variables.create(self._pressed, self._chosen)
        await self._refresh()
        server.subscribe_server_callback(CallbackType.PreRead, self._refresh)
        await server.start()
        return server

    async def _refresh(self, *_: Any) -> None:
        if self._variables is not None:
            self._take()  # what waits in the socket is newer than what was taken
            await self._variables.refresh(time.monotonic_ns())

    def _hear(self) -> None:
        self._take()
        self._wake.set()

    def _take(self) -> None:
        """Read all blocks that have arrived."""
        assert self._variables is not None
        try:
            while data := self._link.recv(messages.MOST):
                self._variables.put(*messages.unpacked_block(data))
        except BlockingIOError:
            return
        except OSError:  # reset: the node closed with messages unread
            pass
        self._ended = True

    def _send(self, message: bytes) -> bool:
        """Send to the node without waiting for it to read; return whether it was accepted."""
        try:
            self._link.send(message)
        except BlockingIOError:
            return False
        except OSError:
            self._ended = True
            return False
        return True

    async def _chosen(self, _: ua.NodeId, *arguments: ua.Variant) -> ua.StatusCode:
        """Send the choice of a set to the node; clients repeat it with an increased counter."""
        if tuple(each.VariantType for each in arguments) != (ua.VariantType.UInt16,) * 2:
            return self._refuse(ua.StatusCodes.BadInvalidArgument)
        block = Block.of(CHOOSE_BASE, [each.Value for each in arguments])
        return self._hand_on(block, self._choices)

    def _hand_on(self, block: Block, handed: deque[int]) -> ua.StatusCode:
        """Send a client's request to the node, at most ``MOST_PRESSES`` per second."""
        now_ns = time.monotonic_ns()
        if len(handed) == MOST_PRESSES and now_ns - handed[0] < 1_000_000_000:
            return self._refuse(ua.StatusCodes.BadTooManyOperations)
        handed.append(now_ns)
        if not self._send(messages.PRESSED + messages.packed_block(block, now_ns)):
            return self._refuse(ua.StatusCodes.BadTooManyOperations)
        return ua.StatusCode()

    async def _pressed(self, _: ua.NodeId, *arguments: ua.Variant) -> ua.StatusCode:
        """Send a press to the node, which checks it as it does on Modbus."""
        values = [each.Value for each in arguments]
        if tuple(each.VariantType for each in arguments) != _TYPES or not values[1]:
            return self._refuse(ua.StatusCodes.BadInvalidArgument)
        if not values[0] and values[1] != self._ack_id:  # a release of no press
            return self._refuse(ua.StatusCodes.BadInvalidArgument)
        latch_id, self._ack_id = values
        block = Block.of(_ACK_AT, [latch_id, self._ack_id >> 16, self._ack_id & 0xFFFF])
        return self._hand_on(block, self._presses)

    def _refuse(self, code: int) -> ua.StatusCode:
        self._refused += 1
        return ua.StatusCode(code)

    def _look_at(self, clients: list[Any], now_ns: int) -> None:
        """Close connections that use too many resources, and log it now and then."""
        ended = shed(clients)
        self._shed = [a + b for a, b in zip(self._shed, ended, strict=True)]
        if any(self._shed) and now_ns - self._said_ns >= SAY_NS:
            slow, over = self._shed
            line = (
                f"connections ended: {slow} that did not read or sent too much, {over} because "
                f"there were more than {MOST}; find out which clients they are"
            )
            if self._send(messages.SAID + line.encode()):
                self._said_ns, self._shed = now_ns, [0, 0]


async def _certificate(key: str, path: str) -> Any:
    try:
        return await uacrypto.load_certificate(Path(path))
    except Exception as error:
        raise ValueError(f"{key} {path}: {_why(error)}; give an X.509 certificate") from None


async def _private_key(path: str) -> Any:
    try:
        return await uacrypto.load_private_key(Path(path))
    except Exception as error:
        raise ValueError(f"private_key {path}: {_why(error)}; give an RSA key as PEM") from None


def _check_pair(asked: dict[str, Any], certificate: Any, private_key: Any) -> None:
    """Refuse a key that does not match the certificate: no client could connect.

    Raises:
        ValueError: they do not match; one line with both files.
    """
    if certificate.public_key() != private_key.public_key():
        raise ValueError(
            f"private_key {asked['private_key']} is not the key of certificate "
            f"{asked['certificate']}; give a matching pair of files"
        )


def _why(error: Exception) -> str:
    text = (getattr(error, "strerror", None) or str(error) or type(error).__name__).splitlines()[0]
    return f"cannot be read: {text}"


def main(descriptor: int, settings: str) -> None:
    """Run until the socket closes; report an error on it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the node
    with contextlib.suppress(OSError):
        os.nice(NICE)
    quiet("asyncua")  # it logs each request that it cannot read
    link = socket.socket(fileno=descriptor)
    link.setblocking(False)

    async def run() -> None:
        await PlantServer(link, json.loads(settings)).run()

    try:
        asyncio.run(run())
    except Exception as error:
        line = (str(error) or type(error).__name__).splitlines()[0]
        with contextlib.suppress(OSError):
            link.send(messages.FAILED + line.encode()[: messages.MOST - 1])
        raise SystemExit(1) from None
