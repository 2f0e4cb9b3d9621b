"""Commands in a network of their own, so that nothing outside it is touched."""

import shutil
import subprocess

NETWORK = "ip link set lo up && ip route add 239.0.0.0/8 dev lo"


def in_namespace(command: str, seconds: float) -> "subprocess.CompletedProcess[str]":
    """Run a shell command there."""
    return subprocess.run(
        ["unshare", "--map-root-user", "--net", "sh", "-c", f"{NETWORK} && {command}"],
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )


def why_not() -> str | None:
    """Why this machine cannot do it, if it cannot."""
    for tool in ("unshare", "ip"):
        if shutil.which(tool) is None:
            return f"needs the program '{tool}' for a network namespace"
    tried = in_namespace("true", 20)
    if tried.returncode:
        return f"no network namespace here: {tried.stderr.strip().splitlines()[-1:]}"
    return None
