"""Worlds that are trouble for whoever drives in them, in another process than the test's."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from plant.model.types import World
from tests.support.study.made import floor


class Deadly(dict[str, float]):
    """Settings whose reading kills the process, as often as said; each time leaves a mark."""

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
        return iter(self.keys())  # or dict() would not ask


class Faulty(dict[str, float]):
    """Settings that cannot be read."""

    def keys(self) -> Any:
        raise RuntimeError("the floor gave way")

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())  # or dict() would not ask


def deadly(marks: Path, times: int, name: str = "deadly") -> World:
    marks.mkdir(exist_ok=True)
    return replace(floor(name), robot=Deadly(marks, times))


def faulty(name: str = "faulty") -> World:
    return replace(floor(name), robot=Faulty())
