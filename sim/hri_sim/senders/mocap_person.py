"""Sends a swaying person, like a motion capture program, to try out a source without its system.

python -m hri_sim.senders.mocap_person vmc --port 39539
"""

import argparse
import contextlib
import itertools
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
    """Send until the time is over or Ctrl-C is pressed."""
    parser = argparse.ArgumentParser(description="Send a person who sways.")
    parser.add_argument("kind", choices=sorted(PROGRAMS), help="kind of source that receives")
    parser.add_argument("--host", default="127.0.0.1", help="address to send to")
    parser.add_argument(
        "--port", type=int, required=True, help="port of the source; natnet: command_port"
    )
    parser.add_argument("--rate", type=float, default=60.0, help="captures per second")
    parser.add_argument("--seconds", type=float, help="duration; default: until Ctrl-C")
    parser.add_argument(
        "--place", type=float, nargs=2, default=(2.0, 0.0), help="x and y of the person, metres"
    )
    asked = parser.parse_args(arguments)
    program = PROGRAMS[asked.kind]()
    program.start()
    send = opened(asked.kind, asked.host, asked.port)
    body, rng, begin_s = Body(1.75), np.random.default_rng(0), time.monotonic()
    print(f"sending {asked.rate:g} captures a second, port {asked.port}", flush=True)
    end = None if asked.seconds is None else round(asked.seconds * asked.rate)
    for k in itertools.islice(itertools.count(), end):
        time.sleep(max(0.0, begin_s + k / asked.rate - time.monotonic()))
        place = np.array(asked.place) + 0.02 * np.sin(3.0 * k / asked.rate + np.arange(2))
        noise = rng.normal(0.0, NOISE_M, (len(JOINTS), 3))  # who glides as one piece is made up
        person = Person(1, body.joints(body.standing(place, np.pi)) + noise, _ALL)
        for unit in program.encode(Scene(time.time_ns(), k, True, (person,))):
            send(unit)


def opened(kind: str, host: str, port: int) -> Callable[[bytes], object]:
    """Return the function that sends a datagram to a source.

    Args:
        kind: kind of the source.
        host, port: address of the source; for natnet and qualisys, of the server on this machine.
    """
    if kind == MotiveProgram.kind:
        return Motive(MotiveProgram.skeletons, port).send
    if kind == QtmProgram.kind:
        return Qtm(QtmProgram.skeletons, port).send
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    return lambda unit: out.sendto(unit, (host, port))


_ALL = np.ones(len(JOINTS), np.bool_)
NOISE_M = 0.003


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
