"""A small cell, and a real node that runs it as a service of the test's own."""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import time

import yaml

WATCHDOG_S = 0.8


def cell(**more):
    """A configuration without links and without people."""
    return {
        "rate_hz": 25,
        "source": {
            "kind": "procedural",
            "room_from_source": {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]},
            "people": [{"start": [3.0, 2.0], "script": [{"do": "wait", "seconds": 600}]}],
        },
        "robots": [
            {
                "name": "arm",
                "model": "ur5e",
                "max_speed_m_s": 1.0,
                "room_from_robot": {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]},
                "motion": {"kind": "standing", "positions": [0, -1.57, 1.57, 0, 0, 0]},
            }
        ],
        "alerts": {"terminal": False},
        **more,
    }


def written(folder, data):
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


class NotifySocket:
    """systemd's end of NOTIFY_SOCKET, at a path or, with ``@``, in the abstract namespace."""

    def __init__(self, address):
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self.heard = []  # (seconds, lines)

    def listen(self, seconds, until=None):
        """Collect for so long, or until a message with this line; return whether it came."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            if not select.select([self._socket], [], [], left)[0]:
                break
            lines = self._socket.recv(65536).decode().split("\n")
            self.heard.append((time.monotonic(), lines))
            if until is not None and until in lines:
                return True
        return False

    def times(self, line):
        return [at for at, lines in self.heard if line in lines]

    def drain(self):
        with contextlib.suppress(BlockingIOError):
            while True:
                self._socket.recv(65536, socket.MSG_DONTWAIT)

    def close(self):
        self._socket.close()


class Service:
    """A node in a session without a terminal, started as systemd does."""

    def __init__(self, config, notify=None, watchdog_s=WATCHDOG_S, options=()):
        environ = {k: v for k, v in os.environ.items() if not k.startswith("WATCHDOG")}
        if notify is not None:
            environ |= {
                "NOTIFY_SOCKET": notify.address,
                "WATCHDOG_USEC": str(round(watchdog_s * 1e6)),
            }
        self.log = config.with_name("stderr.log")
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "hri_predict", "run", str(config), "--json", *options],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                env=environ,
                start_new_session=True,
            )

    def says(self):
        return self.log.read_text(encoding="utf-8")

    def waits_for(self, text, seconds=20.0):
        end = time.monotonic() + seconds
        while text not in self.says():
            assert time.monotonic() < end, self.says()
            time.sleep(0.02)

    def send(self, number):
        self.process.send_signal(number)

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(signal.SIGKILL)
        self.process.wait()
