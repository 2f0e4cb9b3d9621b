"""One ROS 2 node with its own context and thread; by default only on this machine.

Needs rclpy, from a sourced ROS 2 installation (Jazzy or later) or from the extra ``ros2``.

``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` alone limits which nodes a node finds, but not which
nodes reach it: Fast DDS still receives on all interfaces. ``ros2_loopback.xml`` binds it to
127.0.0.1. Fast DDS reads its profiles once in a process, so all nodes of a process have the same
``discovery``. A profile of the user's own (``FASTDDS_DEFAULT_PROFILES_FILE``) takes precedence.
"""

import atexit
import contextlib
import importlib.metadata
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from hri_drivers.wires.ros2_settings import MAX_DOMAIN, Discovery, Ros2Settings
from hri_predict.base.errors import LinkError, first_line
from hri_predict.base.quantities.whole import whole

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
JAZZY = importlib.metadata.version("rclpy").startswith("7.")
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE" if JAZZY else "FASTDDS_DEFAULT_PROFILES_FILE"
LOOPBACK = Path(__file__).with_name("ros2_loopback.xml")
JOIN_S = 5.0
TURN_S = 0.2  # maximum time in the executor, should a wake-up be lost
PAUSE_S = 0.1  # after a callback that raised

log = logging.getLogger(__name__)
_lock = threading.Lock()
_discovery: Discovery | None = None  # of this process, since its first node


class SpinningNode:
    """A ROS 2 node whose callbacks run in one thread, from ``open`` to ``close``.

    A callback that raises is logged, and the thread continues.

    Args:
        settings: the node's.
    """

    def __init__(self, settings: Ros2Settings) -> None:
        self._settings = settings
        self._context: Context | None = None
        self._node: Node | None = None
        self._executor: SingleThreadedExecutor | None = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._closing = threading.Lock()

    def open(self) -> Node:
        """Create the node; create its publishers and subscriptions, then call ``spin``.

        Raises:
            LinkError: ROS 2 cannot start, or another node of this process has another
                ``discovery``; one line with the remedy.
        """
        self.close()
        self._stopping.clear()
        atexit.register(self.close)  # a node that spins at exit aborts the process
        try:
            with _environment(self._settings.discovery):
                self._context = Context()
                self._context.init(
                    args=[], initialize_logging=False, domain_id=_domain(self._settings)
                )
                self._node = Node(
                    self._settings.node_name,
                    context=self._context,
                    use_global_arguments=False,
                    enable_rosout=False,
                    start_parameter_services=False,
                )
        except LinkError:
            self.close()
            raise
        except Exception as error:  # RCLError, RuntimeError, or the middleware's own
            self.close()
            why = first_line(error)
            raise LinkError(
                f"ROS 2 does not start: {why}; check RMW_IMPLEMENTATION and {PROFILES}"
            ) from error
        return self._node

    def spin(self) -> None:
        """Start the thread that runs the node's callbacks."""
        assert self._context is not None
        assert self._node is not None
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(
            target=self._run, args=(self._executor,), name="ros2-node", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, then destroy the node; never raises, safe to call twice.

        Nothing is destroyed while the thread may use it: a thread that does not stop keeps its
        node. Do not call it from a callback.
        """
        with self._closing:
            self._stopping.set()
            if self._executor is not None:
                self._executor.wake()
            if self._thread is not None:
                self._thread.join(JOIN_S)
                if self._thread.is_alive():
                    log.warning("ros2: a callback does not return; its node is not destroyed")
                    self._executor = self._node = self._context = None
                self._thread = None
            self._destroy()
            atexit.unregister(self.close)

    def _destroy(self) -> None:
        executor, self._executor = self._executor, None
        node, self._node = self._node, None
        context, self._context = self._context, None
        with contextlib.suppress(Exception):
            if executor is not None:
                executor.shutdown(0.0)
        with contextlib.suppress(Exception):
            if node is not None:
                node.destroy_node()
        with contextlib.suppress(Exception):
            if context is not None:
                context.try_shutdown()

    def _run(self, executor: SingleThreadedExecutor) -> None:
        while not self._stopping.is_set():
            try:
                executor.spin_once(timeout_sec=TURN_S)
            except Exception:
                if not self._stopping.wait(PAUSE_S):
                    log.exception("ros2: a callback failed; the node continues")


def _domain(settings: Ros2Settings) -> int:
    """Return the configured domain, or that of the environment.

    Raises:
        LinkError: ``ROS_DOMAIN_ID`` is not a domain.
    """
    if settings.domain_id is not None:
        return settings.domain_id
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    domain = whole(text)
    if domain is None or domain > MAX_DOMAIN:
        raise LinkError(
            f"ROS_DOMAIN_ID: '{text[:40]}' is not a number from 0 to {MAX_DOMAIN}; correct it, or "
            f"set 'domain_id'"
        )
    return domain


@contextlib.contextmanager
def _environment(discovery: Discovery) -> Iterator[None]:
    """Set the variables that ROS 2 reads while a node is created, and restore them.

    Raises:
        LinkError: another node of this process has another ``discovery``.
    """
    global _discovery
    ours = {RANGE: discovery.upper()}
    if discovery == "localhost" and not os.environ.get(PROFILES):
        ours[PROFILES] = str(LOOPBACK)
    with _lock:
        if _discovery not in (None, discovery):
            raise LinkError(
                f"discovery: {discovery}, but another ROS 2 node of this process has "
                f"{_discovery}; give the source and the links the same"
            )
        _discovery = discovery
        before = {name: os.environ.get(name) for name in ours}
        os.environ.update(ours)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
