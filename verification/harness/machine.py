"""What else the machine was doing: a figure without it says little on a shared host."""

import os
import platform
import sys
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")


def model() -> str:
    if CPUINFO.exists():
        for line in CPUINFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def load() -> float:
    """Runnable processes, mean of the last minute (ours included)."""
    return os.getloadavg()[0]


def described(load_before: float) -> dict[str, object]:
    """Return what a figure depends on; real-time scheduling, if it was measured with that."""
    found: dict[str, object] = {
        "cpu": model(),
        "cores": len(os.sched_getaffinity(0)),
        "python": ".".join(map(str, sys.version_info[:3])),
        "load": f"{load_before:.1f} -> {load():.1f}",
    }
    if os.sched_getscheduler(0) in (os.SCHED_RR, os.SCHED_FIFO):
        found["scheduling"] = "real-time, ahead of other work"
    return found
