"""The robot's server as a process of its own."""

import pytest

from hri_sim.robot_server.process import ServerProcess


def test_a_server_that_does_not_start_says_so_at_once(capfd):
    server = ServerProcess("modbus", "no such fault")
    try:
        with pytest.raises(RuntimeError, match="exited with status 2"):
            _ = server.port
        assert "give one of" in capfd.readouterr().err
    finally:
        server.kill()
