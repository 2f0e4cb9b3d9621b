"""The simulated cell: a mock controller at the other end of every link with ``simulate:``.

In real time each controller is a separate process behind a pseudo-terminal. On the virtual clock,
this process steps all controllers and connects them by pipes. Everything else is the same.
"""

import contextlib
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from hri_drivers.wires.transport import PipeEnd, Transport, pipe
from hri_predict.base.arrays import Floats
from hri_predict.base.clock import Clock
from hri_predict.base.errors import LinkError
from hri_predict.contracts.cell import ControllerReport
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.source import Source
from hri_predict.robots.model import RobotModel, RobotSettings
from hri_sim.controllers.controller import ControllerSettings
from hri_sim.controllers.process import job_for
from hri_sim.controllers.station import Post, Station, at_far_end, codec_for, posts
from hri_sim.controllers.wiring import Wiring
from hri_sim.referee import KnownPeople, KnowsTruth, Referee, TruePeople

# -- a private folder, gone with its process: the next start removes what a killed one left --------

PREFIX = "hri-cell-"
_LOCK = "owner.lock"


class PrivateFolder:
    """A folder in the system's temporary folder, with a lock that the kernel releases when we exit.

    Attributes:
        path: the folder.
    """

    def __init__(self) -> None:
        """Create the folder, and remove those of processes that were killed."""
        remove_orphans(Path(tempfile.gettempdir()))
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = _locked(self.path / _LOCK, os.O_RDWR | os.O_CREAT)

    def remove(self) -> None:
        """Remove the folder with its contents. Safe to call twice."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def remove_orphans(where: Path) -> None:
    """Remove this user's private folders in ``where`` whose lock is not held.

    A folder without a lock file is kept: its owner may still be creating it.
    """
    for folder in where.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            lock = _locked(folder / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
            if lock is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)


def _locked(path: Path, flags: int) -> int | None:
    """Open a file and lock it; return ``None`` if another process holds the lock.

    Raises:
        OSError: the file does not exist, or it cannot be opened.
    """
    file = os.open(path, flags, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        return None
    return file


# --------------------------------------------------------------------------------------------------

_START_S = 30.0  # a loaded machine takes long to import numpy
_END_S = 5.0


class MockCell:
    """Controllers, arms and wires of all simulated links.

    Real time: ``start``, then ``stop``. Virtual clock: ``transports``, then ``step`` at each time
    that ``next_ns`` returns, then ``stop``.
    """

    settings_model: ClassVar[type[ControllerSettings]] = ControllerSettings

    def __init__(
        self,
        *,
        links: Sequence[LinkSettings],
        robots: Sequence[RobotSettings],
        base_dir: Path | None,
        clock: Clock,
        factor: float = 1.0,
        manned: Sequence[Post] | None = None,
    ) -> None:
        """Check everything without starting anything. ``manned``: the posts, if known.

        Raises:
            ConfigError: a ``simulate:`` block is wrong; see ``station.posts``.
            RobotError: a robot or trajectory file is wrong.
        """
        manned = posts(links, robots, base_dir) if manned is None else manned
        self._posts = {post.name: post for post in manned}
        self._clock = clock
        self._factor = factor
        self._private: PrivateFolder | None = None
        self._wirings: dict[int, Wiring] = {}
        self._processes: dict[str, _Process] = {}
        self._ended: list[ControllerReport] = []
        self._stations: list[tuple[Station[Any], Transport[Any]]] = []
        self._due_ns: list[int] = []

    # -- real time --------------------------------------------------------------------------------

    def start(self) -> dict[str, str]:
        """Start one process per link; return link name -> port (or channel) for the node to open.

        The port is a symbolic link in a private folder to the controller's current
        pseudo-terminal: its name stays the same when the controller restarts.

        Raises:
            LinkError: a controller did not start; the error gives the reason.
        """
        self._private = PrivateFolder()
        for index in self._robot_indices():
            names = self._channels(index)
            self._wirings[index] = Wiring.create(self._folder / f"wiring{index}", names)
        try:
            for post in self._posts.values():  # side by side: each takes a second to import
                self._processes[post.name] = self._spawn(post)
            return {name: self._port_of(name) for name in self._posts}
        except BaseException:
            self.stop()
            raise

    def kill(self, link: str) -> None:
        """Kill a controller's process, as a power failure would. Its arm stops where it is."""
        process = self._processes.pop(link)
        process.kill()
        self._ended.append(_untold(self._posts[link]))

    def restart(self, link: str) -> None:
        """Start the controller of ``link`` again, behind the same port.

        Raises:
            LinkError: it did not start.
        """
        if link in self._processes:
            self.kill(link)
        self._processes[link] = self._spawn(self._posts[link])
        self._port_of(link)

    @property
    def _folder(self) -> Path:
        assert self._private is not None, "start() first"
        return self._private.path

    # -- virtual clock ----------------------------------------------------------------------------

    def transports(self) -> dict[str, PipeEnd[Any]]:
        """Build all controllers here; return link name -> the node's end of its pipe."""
        for index in self._robot_indices():
            self._wirings[index] = Wiring.in_memory(self._channels(index))
        ends: dict[str, PipeEnd[Any]] = {}
        now_ns = self._clock.now_ns()
        for post in self._posts.values():
            near, wire = pipe()  # type: ignore[var-annotated]  # bytes or frames, as the link is
            far = at_far_end(wire, post.settings, post.name, self._clock)
            far.open()
            station: Station[Any] = Station(
                post, codec_for(post.link), self._wirings[post.robot_index]
            )
            self._stations.append((station, far))
            self._due_ns.append(now_ns)
            ends[post.name] = near
        return ends

    def next_ns(self) -> int | None:
        """Return when the next controller's cycle is due; ``None`` without controllers."""
        return min(self._due_ns, default=None)

    def step(self, now_ns: int) -> None:
        """Run every cycle that is due, in the order of the links."""
        for i, (station, far) in enumerate(self._stations):
            if self._due_ns[i] > now_ns:
                continue
            for unit in station.cycle(far.read(0.0), now_ns):
                far.write(unit)
            while self._due_ns[i] <= now_ns:
                self._due_ns[i] += station.period_ns

    # -- both -------------------------------------------------------------------------------------

    def robot_truth(self, now_ns: int) -> dict[str, tuple[Floats, Floats]]:
        """Return robot name -> true joints (N,) of every simulated robot, a moving base first."""
        truth = {}
        for post in self._posts.values():
            wiring = self._wirings.get(post.robot_index)
            now = wiring.truth() if wiring is not None else None
            if now is not None:
                truth[post.robot.name] = now.at(now_ns)
        return truth

    def path_s(self) -> dict[str, float]:
        """Return robot name -> position in its cycle, in seconds at full speed."""
        truths = {
            post.robot.name: wiring.truth()
            for post in self._posts.values()
            if (wiring := self._wirings.get(post.robot_index)) is not None
        }
        return {name: truth.path_s for name, truth in truths.items() if truth is not None}

    def permit(self, link: str, now_ns: int) -> float:
        """Return the speed permitted now by the controller of ``link``, m/s; 0 if it is dead."""
        wiring = self._wirings.get(self._posts[link].robot_index)
        return 0.0 if wiring is None else wiring.permit(link, now_ns)[0]

    def stops_within_s(self, link: str) -> float:
        """Return the silence (s) after which the controller of ``link`` stops, plus its cycle."""
        settings = self._posts[link].settings
        return (settings.silence_timeout_s or 0.0) + settings.period_s

    def period_s(self, link: str) -> float:
        """Return the cycle time of the controller of ``link``, seconds."""
        return self._posts[link].settings.period_s

    def referee(self, robots: Sequence[RobotModel]) -> Referee:
        """Return a referee for these robots; its caller passes it ``robot_truth``."""
        return Referee(robots, tool_of=self.tool_of)

    def tool_of(self, robot: str) -> int | None:
        """Return the number of the tool that a robot truly carries."""
        for post in self._posts.values():
            wiring = self._wirings.get(post.robot_index)
            truth = wiring.truth() if wiring is not None and post.robot.name == robot else None
            if truth is not None:
                return truth.mounted.number
        return None

    def true_people(self, source: Source) -> TruePeople | KnownPeople:
        """Return the true positions of all people, from a copy of the source without faults.

        If the source knows the true positions, they come from there, because its scenes may have
        noise or lack joints.
        """
        return KnownPeople(source) if isinstance(source, KnowsTruth) else TruePeople(source)

    def stop(self) -> list[ControllerReport]:
        """Stop all controllers; return their reports in link order. Safe to call twice."""
        for name, process in self._processes.items():
            told = process.finish()
            report = _untold(self._posts[name]) if told is None else _report(told)
            self._ended.append(report)
        self._processes.clear()
        for station, far in self._stations:
            far.close()
            self._ended.append(station.core.report())
        self._stations.clear()
        self._due_ns.clear()
        for wiring in self._wirings.values():
            wiring.close()
        self._wirings.clear()
        if self._private is not None:
            self._private.remove()
            self._private = None
        order = list(self._posts)
        self._ended.sort(key=lambda report: order.index(report.name))
        return list(self._ended)

    def _robot_indices(self) -> list[int]:
        return sorted({post.robot_index for post in self._posts.values()})

    def _channels(self, index: int) -> list[str]:
        """Return the names of one robot's controllers, in order."""
        return [post.name for post in self._posts.values() if post.robot_index == index]

    def _spawn(self, post: Post) -> "_Process":
        names = self._channels(post.robot_index)
        wiring = self._folder / f"wiring{post.robot_index}"
        number = list(self._posts).index(post.name)  # a link's name may not be a valid file name
        job = self._folder / f"job{number}.json"
        job.write_text(json.dumps(job_for(post, wiring, names, self._factor)), encoding="utf-8")
        return _Process(post.name, job)

    def _port_of(self, link: str) -> str:
        """Wait until the controller reports its port, then link the permanent name to it."""
        port = self._processes[link].port()
        if not Path(port).is_absolute():  # a shared bus, such as udp_multicast
            return port
        lasting = self._folder / f"port{list(self._posts).index(link)}"
        fresh = lasting.with_suffix(".new")
        fresh.symlink_to(port)
        os.replace(fresh, lasting)
        return str(lasting)


class _Process:
    """A controller's process: start, two lines of output, and exit."""

    def __init__(self, name: str, job: Path) -> None:
        self._name = name
        self._closed = False
        self._child = subprocess.Popen(
            [sys.executable, "-m", "hri_sim.controllers.process", str(job)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C goes to the node alone
        )

    def port(self) -> str:
        """Return the port that the controller opened."""
        line = self._line(_START_S)
        if line is None:
            self.kill()
            raise LinkError(
                f"link '{self._name}': its mock controller did not start (exit status "
                f"{self._child.returncode}); see its error on standard error"
            )
        return str(line["port"])

    def finish(self) -> dict[str, Any] | None:
        """Request the process to exit; return its report, or ``None`` if there is none."""
        if self._closed:
            return None
        with contextlib.suppress(ProcessLookupError):
            self._child.send_signal(signal.SIGTERM)
        report = self._line(_END_S)
        try:
            self._child.wait(_END_S if report is not None else 0.1)
        except subprocess.TimeoutExpired:
            self._child.kill()
        self._close()
        return report

    def kill(self) -> None:
        """Kill the process immediately."""
        self._child.kill()
        self._close()

    def _close(self) -> None:
        self._closed = True
        self._child.wait()
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()

    def _line(self, timeout_s: float) -> dict[str, Any] | None:
        """Return the next line of output, or ``None`` if it does not arrive in time."""
        stream = self._child.stdout
        assert stream is not None
        lines: list[bytes] = []
        reader = threading.Thread(target=lambda: lines.append(stream.readline()), daemon=True)
        reader.start()
        reader.join(timeout_s)
        if not lines or not lines[0]:
            return None
        data: dict[str, Any] = json.loads(lines[0])
        return data


def _report(told: dict[str, Any]) -> ControllerReport:
    told["events"] = [tuple(event) for event in told["events"]]
    return ControllerReport(**told)


def _untold(post: Post) -> ControllerReport:
    role, robot = post.settings.role, post.settings.robot or ""
    return ControllerReport(name=post.name, role=role, robot=robot, ended="killed")
