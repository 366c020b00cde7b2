"""Run several ghosts, at most one per core at the same time."""

import os
from typing import Self

from ground.ghost.ghost import Ghost
from ground.ghost.predicted_path import PredictedPath
from ground.map.scene import GhostTrail


class Ghosts:
    """Ghosts by label, in the order in which they were added."""

    def __init__(self, most: int | None = None) -> None:
        self._most = max(1, most if most is not None else os.cpu_count() or 1)
        self._ghosts: dict[str, Ghost] = {}
        self._courses: dict[str, PredictedPath] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def add(self, label: str, ghost: Ghost) -> None:
        """Add a ghost, which starts when a core is free; it replaces another of the same label."""
        self.remove(label)
        self._ghosts[label] = ghost
        self._start()

    def poll(self) -> list[str]:
        """Poll all ghosts without waiting; return the labels of those that have just ended."""
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
        """Result of each ghost; None while it waits or runs."""
        return {label: self._courses.get(label) for label in self._ghosts}

    @property
    def busy(self) -> bool:
        """True if a ghost waits or runs."""
        return len(self._courses) < len(self._ghosts)

    @property
    def pids(self) -> list[int]:
        """Process ids of the running ghosts."""
        return [ghost.pid for ghost in self._ghosts.values() if ghost.pid is not None]

    def trails(self) -> list[GhostTrail]:
        """Return the paths for the map; a running ghost has an empty outcome."""
        return [
            GhostTrail(label, ghost.path_m, "" if course is None else course.outcome)
            for (label, ghost), course in zip(
                self._ghosts.items(), self.courses.values(), strict=True
            )
        ]

    def remove(self, label: str) -> None:
        """Remove a ghost if it exists."""
        self._courses.pop(label, None)
        ghost = self._ghosts.pop(label, None)
        if ghost is not None:
            ghost.cancel()

    def clear(self) -> None:
        """Remove all ghosts."""
        for label in list(self._ghosts):
            self.remove(label)

    def _start(self) -> None:
        room = self._most - len(self.pids)
        for label, ghost in self._ghosts.items():
            if room > 0 and not ghost.running and label not in self._courses:
                ghost.start()
                room -= 1
