"""Sends a swaying person, like a motion capture program, to try out a source without its system.

python -m hri_sim.senders.mocap_person vmc --port 39539
"""

import argparse
import contextlib
import itertools
import os
import socket
import time
from collections.abc import Callable

import numpy as np

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person, Scene
from hri_sim.people.body import Body
from hri_sim.senders.mocap_ends import PROGRAMS, MotiveProgram, QtmProgram
from hri_sim.senders.natnet import Motive
from hri_sim.senders.qualisys import Qtm


def main(arguments: list[str] | None = None) -> None:
    """Send until the time is up or Ctrl-C is pressed."""
    parser = argparse.ArgumentParser(description="Send a person who sways.")
    parser.add_argument("kind", choices=sorted(PROGRAMS), help="kind of source that receives")
    parser.add_argument("--host", default="127.0.0.1", help="address to send to")
    parser.add_argument(
        "--port", type=_port, required=True, help="port of the source; natnet: command_port"
    )
    parser.add_argument("--rate", type=_above_0, default=60.0, help="captures per second")
    parser.add_argument("--seconds", type=_above_0, help="duration; default: until Ctrl-C")
    parser.add_argument(
        "--place", type=float, nargs=2, default=(2.0, 0.0), help="x and y of the person, metres"
    )
    asked = parser.parse_args(arguments)
    program = PROGRAMS[asked.kind]()
    program.start()
    try:
        send = opened(asked.kind, asked.host, asked.port)
    except (OSError, UnicodeError) as error:  # the latter: no host can have this name
        parser.error(_remedy(asked, error))
    body, rng, begin_s = Body(1.75), np.random.default_rng(0), time.monotonic()
    print(f"sending {asked.rate:g} captures a second, port {asked.port}", flush=True)
    end = None if asked.seconds is None else round(asked.seconds * asked.rate)
    for k in itertools.islice(itertools.count(), end):
        time.sleep(max(0.0, begin_s + k / asked.rate - time.monotonic()))
        place = np.array(asked.place) + 0.02 * np.sin(3.0 * k / asked.rate + np.arange(2))
        noise = rng.normal(0.0, NOISE_M, (len(JOINTS), 3))  # who glides as one piece is made up
        person = Person(1, body.joints(body.standing(place, np.pi)) + noise, _ALL)
        try:
            for unit in program.encode(Scene(time.time_ns(), k, True, (person,))):
                send(unit)
        except OSError as error:
            parser.error(f"--host {asked.host}: {error.strerror}; correct it, or the network")


def opened(kind: str, host: str, port: int) -> Callable[[bytes], object]:
    """Return the function that sends a datagram to a source.

    Args:
        kind: kind of the source.
        host, port: address of the source; for natnet and qualisys, of the server on this machine.

    Raises:
        OSError, UnicodeError: the host is unknown, or the server's port cannot be opened.
    """
    if kind == MotiveProgram.kind:
        return Motive(MotiveProgram.skeletons, port).send
    if kind == QtmProgram.kind:
        return Qtm(QtmProgram.skeletons, port).send
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    out = socket.socket(family, socket.SOCK_DGRAM)
    return lambda unit: out.sendto(unit, address)


def _remedy(asked: argparse.Namespace, error: Exception) -> str:
    if asked.kind in (MotiveProgram.kind, QtmProgram.kind):
        why = os.strerror(error.errno or 0) if isinstance(error, OSError) else error
        return f"--port {asked.port}: {why}; choose another one"
    return f"--host {asked.host}: not the name or address of a machine; correct it"


def _port(text: str) -> int:
    port = int(text)
    if not 1 <= port <= 65_535:
        raise argparse.ArgumentTypeError(f"{text}: give a number from 1 to 65535")
    return port


def _above_0(text: str) -> float:
    number = float(text)
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: give a number above 0")
    return number


_ALL = np.ones(len(JOINTS), np.bool_)
NOISE_M = 0.003


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
