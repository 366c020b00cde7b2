"""The machine that a figure was measured on, and its load."""

import os
import platform
import sys
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")


def model() -> str:
    """Return the name of the processor."""
    if CPUINFO.exists():
        for line in CPUINFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def load() -> float:
    """Return the number of runnable processes, ours included, averaged over the last minute."""
    return os.getloadavg()[0]


def described(load_before: float) -> dict[str, object]:
    """Return processor, cores, Python and load, and real-time scheduling if in use."""
    found: dict[str, object] = {
        "cpu": model(),
        "cores": len(os.sched_getaffinity(0)),
        "python": ".".join(map(str, sys.version_info[:3])),
        "load": f"{load_before:.1f} -> {load():.1f}",
    }
    if os.sched_getscheduler(0) in (os.SCHED_RR, os.SCHED_FIFO):
        found["scheduling"] = "real-time, ahead of other work"
    return found
