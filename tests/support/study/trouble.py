"""Worlds that raise or kill the worker process that runs them."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from protocol.world import World
from tests.support.study.made import floor


class Deadly(dict[str, float]):
    """Settings that kill the process that reads them, a number of times; each leaves a mark."""

    def __init__(self, marks: Path, times: int) -> None:
        super().__init__()
        self.marks, self.times = marks, times

    def keys(self) -> Any:
        if multiprocessing.parent_process() is not None:
            killed = len(list(self.marks.iterdir()))
            if killed < self.times:
                (self.marks / str(killed)).touch()
                os.kill(os.getpid(), signal.SIGKILL)
        return super().keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())  # otherwise dict() would bypass keys()


class Faulty(dict[str, float]):
    """Settings that raise when read."""

    def keys(self) -> Any:
        raise RuntimeError("the floor gave way")

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())  # otherwise dict() would bypass keys()


def deadly(marks: Path, times: int, name: str = "deadly") -> World:
    marks.mkdir(exist_ok=True)
    return replace(floor(name), robot=Deadly(marks, times))


def faulty(name: str = "faulty") -> World:
    return replace(floor(name), robot=Faulty())
