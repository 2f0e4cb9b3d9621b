"""The robot's server as a separate process, for tests and measurements."""

import json
import signal
import subprocess
from functools import cached_property

from hri_predict.base.machine.orphans import command_of


class ServerProcess:
    """``python -m hri_sim.robot_server``; the process runs until ``kill``.

    Args:
        protocol: ``modbus`` or ``opcua``.
        fault: the fault that ``toggle`` starts; see ``hri_sim.robot_server.__main__``.
        port: port to listen on; 0: chosen by the system.
        host: address of this machine to listen on.
    """

    def __init__(
        self, protocol: str, fault: str = "none", port: int = 0, *, host: str = "127.0.0.1"
    ) -> None:
        command = command_of("hri_sim.robot_server", protocol, "--fault", fault)
        command += ["--host", host, "--port", str(port), "--after-s", "1e9"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    @cached_property
    def port(self) -> int:
        """Port of the server; the first use waits until it listens.

        Raises:
            RuntimeError: it exited before that; see its standard error.
        """
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the robot's server exited with status {self._process.wait()}")
        return int(json.loads(line)["port"])

    def toggle(self) -> None:
        """Start the fault, or end it."""
        self._process.send_signal(signal.SIGUSR1)

    def hang(self, hangs: bool) -> None:
        """Suspend the process, or let it continue."""
        self._process.send_signal(signal.SIGSTOP if hangs else signal.SIGCONT)

    def kill(self) -> None:
        """Kill the process, and wait until it has exited."""
        self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
