"""Try things in processes of their own, with a limit of time and memory."""

import os
import resource
from collections.abc import Callable, Sequence
from enum import Enum
from multiprocessing import get_context
from multiprocessing.connection import wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import Final, NamedTuple

FORK: Final = get_context("fork")
EXTRA_CPU_S: Final = 5
"""CPU seconds that a try may use beyond those of all tests; more is an endless loop."""

WALL_S: Final = 120.0
"""A time in which at least one of the processes ends that run at a time, else all hang."""

EXTRA_MEMORY: Final = 1 << 30


class Verdict(Enum):
    """Whether a test noticed the mutant; one that ran out of time was noticed, too."""

    KILLED = "killed"
    TIMEOUT = "timeout"
    SURVIVED = "survived"


PASSED, FAILED = 0, 17
"""Exit codes of a try; Python itself ends with 1 when something else goes wrong."""


class Try(NamedTuple):
    """`passes` returns whether the tests pass; on the unchanged code all of them take `cpu_s`."""

    passes: Callable[[], bool]
    cpu_s: float


def in_parallel(tried: Sequence[Try], jobs: int) -> list[Verdict]:
    """Return the verdict of each, so many processes at a time."""
    found: dict[int, Verdict] = {}
    running: dict[int, ForkProcess] = {}
    for at, one in enumerate(tried):
        running[at] = FORK.Process(target=attempt, args=(one,))
        running[at].start()
        if len(running) >= jobs:
            reap(running, found)
    while running:
        reap(running, found)
    return [found[at] for at in range(len(tried))]


def reap(running: dict[int, ForkProcess], found: dict[int, Verdict]) -> None:
    """Wait for processes to end; end those that hang."""
    ended = wait([process.sentinel for process in running.values()], WALL_S)
    for at, process in list(running.items()):
        if process.sentinel in ended or not ended:
            process.kill()
            process.join()
            found[at] = verdict_of(process.exitcode)
            del running[at]


def verdict_of(exit_code: int | None) -> Verdict:
    """Return the verdict on a try; a process that a signal has ended ran out of time."""
    if exit_code is not None and exit_code < 0:
        return Verdict.TIMEOUT
    return {PASSED: Verdict.SURVIVED, FAILED: Verdict.KILLED}[exit_code or PASSED]


def attempt(one: Try) -> None:
    """End the process with PASSED or FAILED, as the tests do."""
    silence()
    limit_s = int(one.cpu_s) + EXTRA_CPU_S
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + EXTRA_MEMORY, used + EXTRA_MEMORY))
    try:
        passed = one.passes()
    except BaseException:
        passed = False
    os._exit(PASSED if passed else FAILED)


def silence() -> None:
    """Send what the tests print to nowhere."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
