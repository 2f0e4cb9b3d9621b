"""The robot's server as a process of its own."""

import socket
import subprocess
import sys

import pytest
import typer

from hri_sim.robot_server import __main__ as program
from hri_sim.robot_server.process import ServerProcess
from hri_sim.rtde.listening import why_not


def test_a_server_that_does_not_start_says_so_at_once(capfd):
    server = ServerProcess("modbus", "no such fault")
    try:
        with pytest.raises(RuntimeError, match="exited with status 2"):
            _ = server.port
        assert "give one of" in capfd.readouterr().err
    finally:
        server.kill()


def said(module: str, *arguments: str) -> str:
    """What a stand-in says that refuses its arguments."""
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2, done
    assert "Traceback" not in done.stderr
    return " ".join(done.stderr.split())


SERVERS = [("hri_sim.robot_server", "modbus"), ("hri_sim.rtde",)]


@pytest.mark.parametrize("server", SERVERS)
def test_an_address_of_another_machine_names_the_host(server):
    line = said(*server, "--host", "192.0.2.1", "--port", "0")  # RFC 5737: for documentation
    assert line.endswith("192.0.2.1:0: not an address of this machine; correct --host")


@pytest.mark.parametrize("server", SERVERS)
def test_a_port_that_is_none_or_taken_names_the_port(server):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        line = said(*server, "--port", str(taken.getsockname()[1]))
    assert line.endswith("in use by another program; stop it, or choose another --port")
    assert "less than or equal to 65535" in said(*server, "--port", "99999")


def test_a_missing_package_is_named_with_the_command_for_this_installation(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "hri_sim.robot_server.modbus", None)
    monkeypatch.setattr(program, "for_this_installation", lambda text: f"here: {text}")
    with pytest.raises(typer.Exit):
        program.main(program.Protocol.MODBUS)
    line = capsys.readouterr().err.strip()
    assert line.startswith("hri_sim.robot_server: here: ")
    assert line.endswith("; install it with: pip install 'hri-predict[modbus]'")


@pytest.mark.long  # its server takes seconds to start
def test_an_opc_ua_server_listens_on_ipv6():
    pytest.importorskip("asyncua", reason="asyncua is not installed: no server")
    if why := why_not(("::1", 0)):
        pytest.skip(why)
    server = ServerProcess("opcua", host="::1")
    try:
        socket.create_connection(("::1", server.port), 20.0).close()
    finally:
        server.kill()
