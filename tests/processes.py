"""Programs that a test runs to their end."""

import subprocess
import sys
from typing import Any


def python(*arguments: Any, **options: Any) -> "subprocess.CompletedProcess[str]":
    """Run this interpreter with these arguments; what it prints is kept as text."""
    kept: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 600}
    return subprocess.run([sys.executable, *map(str, arguments)], **(kept | options))


def hri_predict(*arguments: Any, **options: Any) -> "subprocess.CompletedProcess[str]":
    """Run ``hri-predict`` in a process of its own."""
    return python("-m", "hri_predict", *arguments, **options)
