"""The queue of received messages between a link and the node."""

import threading
from collections import deque

from hri_predict.contracts.link import Received
from hri_predict.protocol.messages import RobotState

CAPACITY = 256


class Inbox:
    """A bounded queue between the reading thread and the node's loop.

    Attributes:
        overrun: number of messages dropped because the node did not take them in time: the oldest
            RobotState first, an Acknowledge only if there are no RobotStates.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.overrun = 0
        self._capacity = capacity
        self._lock = threading.Lock()
        self._queue: deque[Received] = deque()

    def put(self, received: Received) -> None:
        """Add a message."""
        with self._lock:
            self._queue.append(received)
            if len(self._queue) <= self._capacity:
                return
            self.overrun += 1
            for index, old in enumerate(self._queue):
                if isinstance(old.message, RobotState):
                    del self._queue[index]
                    return
            self._queue.popleft()

    def take(self) -> list[Received]:
        """Take all messages, oldest first."""
        with self._lock:
            taken = list(self._queue)
            self._queue.clear()
        return taken
