"""`python -m checks.speed.tick_probe FILE ARGS...`: run `sidestep ARGS...` with time stamps.

Each process of the closed loop notes when it passes the points below, on the monotonic clock that
all processes of a computer share. FILE receives them as JSON when the process ends. A note costs
about 0.3 us.
"""

import json
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from time import monotonic_ns
from typing import Any

from plant.process.loop import Process
from protocol.bus.mailbox import Mailbox
from protocol.bus.publisher import Publisher
from robot.process import RobotProcess
from robot.vehicle import Vehicle

NOTES: list[tuple[str, int]] = []


def note(point: str) -> None:
    """Note the time at a point."""
    NOTES.append((point, monotonic_ns()))


def watch(owner: type, name: str, begin: str, end: str = "") -> None:
    """Note the times at which a method begins and ends."""
    method: Callable[..., Any] = getattr(owner, name)

    def watched(*arguments: Any, **keywords: Any) -> Any:
        note(begin)
        try:
            return method(*arguments, **keywords)
        finally:
            if end:
                note(end)

    setattr(owner, name, watched)


def watch_topics(owner: type, name: str, begin: str, end: str) -> None:
    """Note the beginning and end of a method of an object with a topic, with the topic's path."""
    method: Callable[..., Any] = getattr(owner, name)

    def watched(self: Any, *arguments: Any) -> Any:
        path = self.topic.path
        note(f"{begin} {path}")
        try:
            return method(self, *arguments)
        finally:
            note(f"{end} {path}")

    setattr(owner, name, watched)


def main(arguments: list[str]) -> None:
    """Run a verb with time stamps; raise SystemExit with its exit code."""
    file, *words = arguments
    watch(Process, "publish", "publish", "published")
    watch(Process, "advance", "advance")
    watch(RobotProcess, "cycle", "cycle", "cycled")
    watch(Vehicle, "step", "step", "stepped")
    watch_topics(Publisher, "put_frame", "put", "sent")
    watch_topics(Mailbox, "store", "arrived", "stored")
    sys.argv = ["sidestep", *words]
    try:
        runpy.run_module("sidestep", run_name="__main__")
    finally:
        Path(file).write_text(json.dumps(NOTES), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
