"""Alerts through a user's program, which reads each alert as JSON from standard input."""

import contextlib
import json
import os
import signal
import subprocess
from pathlib import PurePath
from typing import Literal

from pydantic import Field

from hri_predict.operation.alerting.alert import AnyAlert, payload
from hri_predict.operation.alerting.sender import HookContext, Sender, SendError
from hri_predict.operation.alerting.settings import HookSettings

LONGEST_STOP_S = 5.0
"""Maximum time for which a stopping node waits for a program, whatever its time limit."""


class CommandHook(HookSettings):
    """``kind: command``. A failed program is not run again, because it may have done part of its
    work.
    """

    kind: Literal["command"] = Field(description="a user's program")
    command: list[str] = Field(min_length=1, description="program and arguments")
    retry_s: float = Field(
        0.0, ge=0, le=3600, description="seconds for which a failed program is run again"
    )
    timeout_s: float = Field(5.0, ge=0.1, le=600, description="kill the program after this time")

    def create_sender(self, place: HookContext) -> Sender:
        """See the base class."""
        return CommandSender(self, place)

    @property
    def where(self) -> str:
        """Return the program's name only, because its arguments may contain a secret."""
        return PurePath(self.command[0]).name

    @property
    def stop_s(self) -> float:
        """Return the program's time limit, up to five seconds, and one second more."""
        return min(self.timeout_s, LONGEST_STOP_S) + 1.0


class CommandSender(Sender):
    """Runs the program, one at a time, without a shell, in a process group of its own."""

    def __init__(self, settings: CommandHook, place: HookContext) -> None:
        self._settings, self._place = settings, place
        self._process: subprocess.Popen[bytes] | None = None

    def send(self, alert: AnyAlert, more_changes: int) -> str:
        """Run the program; it must exit with status 0 in time."""
        data = json.dumps(payload(alert, self._place.cell, more_changes)).encode()
        try:
            self._process = subprocess.Popen(
                self._settings.command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:  # ValueError: a NUL in an argument
            why = getattr(error, "strerror", None) or str(error)
            raise SendError(f"cannot be run: {why}") from error
        try:
            self._process.communicate(data, timeout=self._settings.timeout_s)
        except subprocess.TimeoutExpired:
            self.abort()
            self._process.wait()
            raise SendError(
                f"took longer than {self._settings.timeout_s:g} s and was killed"
            ) from None
        if self._process.returncode != 0:
            raise SendError(f"exited with status {self._process.returncode}")
        return "exited with status 0"

    def abort(self) -> None:
        """Kill the program and its child processes."""
        process = self._process
        if process is not None and process.poll() is None:
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
