"""Resident memory of this process, and its growth."""

import resource
from pathlib import Path


def resident_mib() -> float:
    """Return the resident memory of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


class Resident:
    """Growth of the resident memory after a warm-up, in which bounded buffers fill.

    Args:
        every_s: interval of node time between two samples.
        warm_up_s: of node time, from the first look.
    """

    def __init__(self, every_s: float, warm_up_s: float) -> None:
        self._every_ns, self._warm_up_ns = round(every_s * 1e9), round(warm_up_s * 1e9)
        self._due_ns: int | None = None
        self._samples: list[float] = []

    def look(self, now_ns: int) -> None:
        """Take a sample if one is due at this node time."""
        if self._due_ns is None:
            self._due_ns = now_ns + self._warm_up_ns
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + self._every_ns
            self._samples.append(resident_mib())

    def growth(self) -> dict[str, float]:
        """Return the memory after the warm-up and at the end, and the growth in percent."""
        end = resident_mib()
        early = self._samples[0] if self._samples else end
        return {
            "rss_mib_early": round(early, 2),
            "rss_mib_end": round(end, 2),
            "growth_percent": round(100.0 * (end / early - 1.0), 2),
        }
