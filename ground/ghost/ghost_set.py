"""Several ghosts at once, no more of them driving than there are cores; the others wait."""

import os
from typing import Self

from ground.ghost.ghost import Ghost
from ground.ghost.predicted_path import PredictedPath
from ground.map import GhostTrail


class Ghosts:
    """By label, in the order in which they were asked for."""

    def __init__(self, most: int | None = None) -> None:
        self._most = max(1, most if most is not None else os.cpu_count() or 1)
        self._ghosts: dict[str, Ghost] = {}
        self._courses: dict[str, PredictedPath] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def add(self, label: str, ghost: Ghost) -> None:
        """It starts when there is room; another of that label makes way."""
        self.remove(label)
        self._ghosts[label] = ghost
        self._start()

    def poll(self) -> list[str]:
        """Look at all of them, without waiting; the labels of those that have just ended."""
        ended = []
        for label, ghost in self._ghosts.items():
            course = None if label in self._courses else ghost.poll()
            if course is not None:
                self._courses[label] = course
                ended.append(label)
        self._start()
        return ended

    @property
    def courses(self) -> dict[str, PredictedPath | None]:
        """How each came out; None while it waits or drives."""
        return {label: self._courses.get(label) for label in self._ghosts}

    @property
    def busy(self) -> bool:
        return len(self._courses) < len(self._ghosts)

    @property
    def pids(self) -> list[int]:
        return [ghost.pid for ghost in self._ghosts.values() if ghost.pid is not None]

    def trails(self) -> list[GhostTrail]:
        """For the map; of one that drives as far as it has come, with an outcome of none."""
        return [
            GhostTrail(label, ghost.path_m, "" if course is None else course.outcome)
            for (label, ghost), course in zip(
                self._ghosts.items(), self.courses.values(), strict=True
            )
        ]

    def remove(self, label: str) -> None:
        """Nothing when there is none."""
        self._courses.pop(label, None)
        ghost = self._ghosts.pop(label, None)
        if ghost is not None:
            ghost.cancel()

    def clear(self) -> None:
        for label in list(self._ghosts):
            self.remove(label)

    def _start(self) -> None:
        room = self._most - len(self.pids)
        for label, ghost in self._ghosts.items():
            if room > 0 and not ghost.running and label not in self._courses:
                ghost.start()
                room -= 1
