"""The Modbus TCP server, based on pymodbus, in a separate thread."""

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.simulator import DataType, SimData, SimDevice

from hri_drivers.links.modbus.connections import READ, WRITE, LimitedServer
from hri_drivers.links.plant.image import Block, Image
from hri_drivers.links.plant.link import try_address
from hri_predict.base.errors import LinkError, first_line
from hri_predict.protocol.fields import MAX_ROBOTS
from hri_predict.protocol.registers import (
    CHOOSE_BASE,
    CHOSEN,
    READ_WORDS,
    STATE,
    STATE_BASE,
    STATE_STRIDE,
    WRITE_BASE,
    WRITTEN,
    offset_of,
    state_address,
    words_of,
)

START_S = 5.0
CAPACITY = 1024  # writes that may wait to be read; the oldest are dropped
_WRITTEN_WORDS, _STATE_WORDS = words_of(WRITTEN), words_of(STATE)
_ACK_AT = offset_of(WRITTEN, "ACK_LATCH_ID")
WHOLE = {
    (WRITE_BASE, 1),  # the heartbeat
    (WRITE_BASE, _WRITTEN_WORDS),  # with an acknowledge
    (WRITE_BASE + _ACK_AT, _WRITTEN_WORDS - _ACK_AT),  # an acknowledge
    (CHOOSE_BASE, words_of(CHOSEN)),
    *((state_address(robot), _STATE_WORDS) for robot in range(MAX_ROBOTS)),
}
"""(address, words) of the accepted write requests; a request for part of a value is refused."""


class _Run:
    """The thread of one opening; a late one never touches what a later opening uses.

    Attributes:
        ready: set when the server listens, or has ended.
        loop, port: set once it listens.
        ended: set to stop it.
        closed: whether it must stop, also if it does not listen yet.
        why: why it ended; "" if nothing failed.
    """

    def __init__(self, serve: Callable[["_Run"], Coroutine[Any, Any, None]]) -> None:
        self.ready = threading.Event()
        self.loop: asyncio.AbstractEventLoop | None = None
        self.ended = asyncio.Event()
        self.closed = False
        self.port = 0
        self.why = ""
        self._lock = threading.Lock()
        self._serve = serve
        self.thread = threading.Thread(target=self._work, name="modbus-server", daemon=True)
        self.thread.start()

    def begin(self, port: int) -> bool:
        """The server listens at ``port``; return whether it must go on."""
        with self._lock:
            if not self.closed:
                self.port, self.loop = port, asyncio.get_running_loop()
            self.ready.set()
            return not self.closed

    def close(self) -> None:
        """Stop it, and wait until it has ended if it listens."""
        with self._lock:
            self.closed, loop = True, self.loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended by itself
                loop.call_soon_threadsafe(self.ended.set)
            self.thread.join(START_S)

    def _work(self) -> None:
        try:
            asyncio.run(self._serve(self))
        except Exception as error:
            self.why = first_line(getattr(error, "strerror", None) or error)
        self.ready.set()


class ModbusTransport:
    """``Transport[Block]``: writes blocks into the image, and reads a PLC's writes.

    Args:
        address: host and port to listen on; port 0 lets the system choose.
        image: what PLCs read.

    Attributes:
        port: the open port.
        refused: number of refused write requests.
        overrun: number of writes that were not read in time.
    """

    def __init__(self, address: tuple[str, int], image: Image) -> None:
        self.port = address[1]
        self.refused = self.overrun = 0
        self._address = address
        self._image = image
        self._arrived = threading.Condition()
        self._inbox: deque[Block] = deque()
        self._run: _Run | None = None

    @property
    def advice_timeouts(self) -> int:
        """Number of times that PLCs read an advice as *unknown* that had permitted motion."""
        return self._image.timeouts

    def open(self) -> None:
        """Listen.

        Raises:
            LinkError: it cannot listen; the message names address and remedy.
        """
        self.close()
        try_address("Modbus server", self._address)
        run = self._run = _Run(self._serve)
        if not run.ready.wait(START_S):
            why = f"it did not start within {START_S:g} s; check the load of this machine"
        elif run.loop is None:
            why = f"it did not start ({run.why}); remove the cause and start again"
        else:
            self.port = run.port
            return
        self.close()
        raise LinkError(f"Modbus server at {self._named}: {why}")

    def write(self, unit: Block) -> None:
        """Put a block into the image.

        Raises:
            LinkError: the server has stopped.
        """
        self._check()
        self._image.put(unit, time.monotonic_ns())

    def read(self, timeout_s: float) -> list[Block]:
        """Return what PLCs have written.

        Raises:
            LinkError: the server has stopped.
        """
        self._check()
        with self._arrived:
            if not self._inbox and timeout_s > 0:
                self._arrived.wait(timeout_s)
            units = list(self._inbox)
            self._inbox.clear()
        return units

    def close(self) -> None:
        """Stop the server and close its connections; never raises, safe to call twice."""
        run, self._run = self._run, None
        if run is not None:
            run.close()
        self._image.forget()
        with self._arrived:
            self._inbox.clear()
            self._arrived.notify_all()

    @property
    def _named(self) -> str:
        return f"{self._address[0]}:{self._address[1]}"

    def _check(self) -> None:
        run = self._run
        if run is None:
            raise LinkError(f"Modbus server at {self._named} is closed; open it first")
        if not run.thread.is_alive():
            raise LinkError(f"Modbus server at {self._named} has ended ({run.why}); opening again")

    async def _serve(self, run: _Run) -> None:
        server = LimitedServer(_device(self._asked), self._address, self._refuse)
        await server.listen()
        try:
            sockets: Any = getattr(server.transport, "sockets", None)
            port = sockets[0].getsockname()[1]
            if run.begin(port):
                await run.ended.wait()
        finally:
            await server.shutdown()

    async def _asked(self, *request: Any) -> ExcCodes | None:
        """Answer a request: function, first register, address, count, registers, values.

        pymodbus calls it with its own registers, and with ``None`` as the values of a read request.
        """
        function, _, address, count, registers, values = request
        if function in READ:
            registers[:READ_WORDS] = self._image.words(time.monotonic_ns())
            return None
        if function not in WRITE:
            return ExcCodes.ILLEGAL_FUNCTION
        if values is None:  # function 6: pymodbus reads what it wrote, to repeat it in the reply
            return None
        if (address, count) not in WHOLE:
            self._refuse(1)
            return ExcCodes.ILLEGAL_VALUE
        with self._arrived:
            if len(self._inbox) >= CAPACITY:
                self._inbox.popleft()
                self.overrun += 1
            self._inbox.append(Block.of(address, [int(value) & 0xFFFF for value in values]))
            self._arrived.notify_all()
        return None

    def _refuse(self, count: int) -> None:
        """Count write requests that are not carried out."""
        self.refused += count


def _device(asked: object) -> SimDevice:
    """All registers; the first ``READ_WORDS`` are read-only. Every unit id is answered."""
    words = DataType.REGISTERS
    return SimDevice(
        0,
        simdata=[
            SimData(0, values=[0] * READ_WORDS, datatype=words, readonly=True),
            SimData(WRITE_BASE, values=[0] * _WRITTEN_WORDS, datatype=words),
            SimData(CHOOSE_BASE, values=[0] * words_of(CHOSEN), datatype=words),
            SimData(STATE_BASE, values=[0] * (MAX_ROBOTS * STATE_STRIDE), datatype=words),
        ],
        action=asked,  # type: ignore[arg-type]
    )
