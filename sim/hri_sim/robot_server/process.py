"""The robot's server as a process of its own, for tests and measurements."""

import json
import signal
import subprocess
from functools import cached_property

from hri_predict.base.machine.orphans import command_of


class ServerProcess:
    """``python -m hri_sim.robot_server``; the process runs until ``kill``.

    Args:
        protocol: ``modbus`` or ``opcua``.
        fault: what goes wrong, from ``toggle`` on; see ``hri_sim.robot_server.__main__``.
        port: of 127.0.0.1; 0: the system chooses.
    """

    def __init__(self, protocol: str, fault: str = "none", port: int = 0) -> None:
        command = command_of("hri_sim.robot_server", protocol, "--fault", fault)
        command += ["--port", str(port), "--after-s", "1e9"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    @cached_property
    def port(self) -> int:
        """Its port; the first use waits until it listens.

        Raises:
            RuntimeError: it ended before that; its standard error says why.
        """
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the robot's server exited with status {self._process.wait()}")
        return int(json.loads(line)["port"])

    def toggle(self) -> None:
        """Begin the fault, or end it."""
        self._process.send_signal(signal.SIGUSR1)

    def hang(self, hangs: bool) -> None:
        """Stop the process as it is, or let it continue."""
        self._process.send_signal(signal.SIGSTOP if hangs else signal.SIGCONT)

    def kill(self) -> None:
        """End it at once, and wait until it has."""
        self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
