"""The predictor's process: builds the predictor, then answers windows until the node exits.

``Worker`` in ``remote.py`` starts it, with two descriptors and the node's process id. The socket
carries one job and the signal to start; after that, each byte announces a window or an answer in
the memory. Settings arrive as JSON and are validated again; no code is received.
"""

import contextlib
import json
import logging
import os
import signal
import socket
from pathlib import Path
from typing import Any

from hri_predict.base.machine.orphans import end_with

ASKED = ANSWERED = b"."
LOG = b"L"  # the first byte of a line of the log
MAX_MESSAGE = 64 * 1024  # bytes; a socket takes them whole


def main(arguments: list[str]) -> int:
    """Run the worker; return its exit status.

    Args:
        arguments: descriptors of socket and memory, and the node's process id.
    """
    link_descriptor, memory, parent = (int(each) for each in arguments)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # the node ends it, by the socket
        signal.signal(number, signal.SIG_IGN)
    end_with(parent)
    with contextlib.suppress(OSError):  # where memory runs out, this process goes, not the node
        Path("/proc/self/oom_score_adj").write_text("500")
    link = socket.socket(fileno=link_descriptor)
    logging.basicConfig(level=logging.WARNING, handlers=[_ToNode(link)])
    job = json.loads(link.recv(MAX_MESSAGE) or b"{}")
    if not job:
        return 1
    if job["cpus"]:
        os.sched_setaffinity(0, job["cpus"])
    # slow imports, and only here: whatever is wrong with them is told to the node
    from hri_predict.base.errors import HriPredictError

    try:
        _serve(link, memory, job)
    except HriPredictError as error:
        _tell(link, {"error": str(error)})
        return 2
    except ConnectionError:  # the node ended while this process was at work
        return 0
    return 0


def _serve(link: socket.socket, memory: int, job: dict[str, Any]) -> None:
    """Build the predictor, describe it, and answer until the socket closes.

    Raises:
        HriPredictError: it cannot be built.
    """
    from hri_predict.base.machine.realtime import lock_memory, settle
    from hri_predict.base.settings import validated
    from hri_predict.contracts import registry
    from hri_predict.predictors.building import predictor_of
    from hri_predict.predictors.process.description import Description
    from hri_predict.predictors.process.shared import SharedWindows, Sizes

    model = registry.predictor_settings(job["settings"]["name"])
    settings = validated(model, job["settings"], "predictor")
    predictor = predictor_of(settings)
    described = Description.of(predictor, settings.files(), registry.code_of(settings))
    _tell(link, {"ready": described.as_data()})
    if not link.recv(MAX_MESSAGE):  # the word to begin: the memory has its size
        return
    sizes = Sizes(
        job["people"],
        predictor.history_steps,
        predictor.horizon_steps,
        len(predictor.skeleton.joints),
    )
    windows = SharedWindows(memory, sizes)
    settle()
    if job["lock_memory"] and (problem := lock_memory()):
        logging.getLogger(__name__).warning("the predictor's process: %s", problem)
    done = 0
    while link.recv(MAX_MESSAGE):
        taken = windows.take(after=done)
        if taken is None:  # answered already, or being written: another byte follows
            continue
        done, history, observed = taken
        _answer(windows, done, predictor, (history, observed))
        link.send(ANSWERED)


def _answer(windows: Any, number: int, predictor: Any, window: tuple[Any, Any]) -> None:
    from hri_predict.base.errors import failure
    from hri_predict.contracts.predictor import checked

    try:
        forecast = predictor.predict(*window)
        windows.give(number, checked(forecast, len(window[0]), predictor))
    except BaseException as error:  # a third party's predictor may fail in any way
        failure(error)
        kind = "" if type(error).__name__ == "PredictorError" else f"{type(error).__name__}: "
        windows.refuse(number, f"{kind}{error}")


_LONGEST_TEXT = 4000  # letters; a message to the node has room for eight times as many bytes


def _tell(link: socket.socket, what: dict[str, Any]) -> None:
    if "error" in what:  # it may quote a file
        what = {"error": what["error"][:_LONGEST_TEXT]}
    link.send(json.dumps(what).encode())


class _ToNode(logging.Handler):
    """Sends log lines to the node, which writes them to its own log."""

    def __init__(self, link: socket.socket) -> None:
        super().__init__()
        self._link = link

    def emit(self, record: logging.LogRecord) -> None:
        """Send one line; it is lost if the node does not read it."""
        line = json.dumps([record.name, record.levelno, record.getMessage()[:2000]])
        with contextlib.suppress(OSError):
            self._link.send(LOG + line.encode(), socket.MSG_DONTWAIT)
