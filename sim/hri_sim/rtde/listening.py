"""The reason why a stand-in cannot listen at an address, with the option to correct."""

import errno
import socket

MOST_PORT = 65_535
_REMEDIES = {
    errno.EADDRINUSE: "in use by another program; stop it, or choose another --port",
    errno.EADDRNOTAVAIL: "not an address of this machine; correct --host",
    errno.EACCES: "not permitted; choose a --port above 1023",
}


def why_not(address: tuple[str, int]) -> str:
    """Return why nothing can listen at host and port, or "" if it can; libraries do not report it.

    Each reason is one line with the remedy.
    """
    host, port = address
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, _, _, _, at = found[0]
        socket.create_server(at[:2], family=family).close()
    except (socket.gaierror, UnicodeError):  # the latter: no host can have this name
        why = _REMEDIES[errno.EADDRNOTAVAIL]
    except OSError as error:
        why = _REMEDIES.get(error.errno or 0, f"{error.strerror}; correct --host and --port")
    else:
        return ""
    return f"cannot listen on {host}:{port}: {why}"
