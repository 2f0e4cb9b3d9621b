"""Named pipes, which no file of the user's may be: to open one may wait for ever.

What a shell or another program hands over as it starts us (``/dev/stdin``, ``<(...)``) is a pipe
without a name, and has its writer.
"""

import errno
import os
import stat
from pathlib import Path


def refuse_named_pipe(path: Path) -> None:
    """Look at ``path`` before it is opened; a file that is not there is none of our business.

    Raises:
        OSError: it is a named pipe; ``strerror`` says so.
        ValueError: there is a NUL in it.
    """
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return
    if stat.S_ISFIFO(mode) and os.path.exists(os.path.realpath(path)):
        raise OSError(errno.EINVAL, "is a pipe, not a file", str(path))
