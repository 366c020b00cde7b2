"""Small studies for tests: worlds, tasks, rows, and workers that fail."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from protocol.world import Circle, GoalPose, Start, World
from study.runner.plan import ListedWorld, StudySettings, TrialTask, digest_of, tasks_of
from study.runner.rows import CodeVersion, TrialRow
from study.runner.run_task import StudyContext, failed

CODE = CodeVersion(commit="c0ffee", dirty=False, version="0.1.0", digest="d1")


def floor(name: str = "floor", *, far_m: float = 0.4, family: str | None = "open") -> World:
    """Return a world with the goal straight ahead, a second or two away."""
    return World(
        name=name,
        size_m=(4.0, 3.0),
        start=Start(x_m=1.0, y_m=1.0),
        goal=GoalPose(x_m=1.0 + far_m, y_m=1.0),
        family=family,
        shortest_path_m=far_m,
        reachable=True,
    )


def boxed(name: str = "disc") -> World:
    """Return a world with a disc in the way, so that the robot has to avoid it."""
    world = floor(name, far_m=2.4, family="disc")
    return replace(world, obstacles=(Circle(x_m=2.2, y_m=1.0, radius_m=0.2),))


def list_of(*worlds: World) -> list[ListedWorld]:
    return [ListedWorld(f"shipped:{one.name}", digest_of(one), one) for one in worlds]


def context_of(*worlds: World, study: str = "test") -> StudyContext:
    return StudyContext(study=study, code=CODE, worlds=worlds)


def settings(**changed: Any) -> StudySettings:
    usual: dict[str, Any] = {"navigators": ("vgm:left",), "noise": ("none",), "timeout_s": 20.0}
    return StudySettings(**{**usual, **changed})


def tasks(*worlds: World, **changed: Any) -> list[TrialTask]:
    return tasks_of(list_of(*worlds), settings(**changed), CODE.version)


def rows(count: int, start: int = 0, **changed: Any) -> list[TrialRow]:
    """Return rows of different trials, none of them driven."""
    one, context = tasks(floor())[0], context_of(floor())
    made = [
        failed(replace(one, trial_id=f"{number:032x}"), context, "never begun")
        for number in range(start, start + count)
    ]
    return [replace(row, **changed) for row in made]


def ids(found: Any) -> list[str]:
    """Return the trial ids of a table in its order."""
    names: list[str] = found["trial_id"].to_pylist()
    return names


def spoil(file: Path) -> None:
    """Truncate a file, as a failing disk does."""
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])


class Watch:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


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
