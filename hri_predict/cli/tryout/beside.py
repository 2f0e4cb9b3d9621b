"""Runs a command that exits when its parent process exits, even if the parent is killed.

``python -m hri_predict.cli.tryout.beside WORDS``: the parent holds the standard input open.
"""

import os
import signal
import sys
import threading
import time

from hri_predict.cli import main

END_S = 2.0
"""Time for the command to exit by itself, as after Ctrl-C."""


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(END_S)
    os._exit(130)


if __name__ == "__main__":
    os.nice(5)  # the node goes first
    threading.Thread(target=_end_with_input, name="input", daemon=True).start()
    sys.argv[0] = "hri-predict"
    main()
