"""Run attempts in processes of their own, with limits of time and memory."""

import os
import resource
from collections.abc import Callable, Sequence
from enum import Enum
from multiprocessing import get_context
from multiprocessing.connection import wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import IO, Final, NamedTuple

FORK: Final = get_context("fork")
EXTRA_CPU_S: Final = 5
"""CPU seconds that an attempt may use beyond those of all tests; more is an endless loop."""

WALL_S: Final = 120.0
"""At least one of the running processes ends within this time, otherwise all hang."""

EXTRA_MEMORY: Final = 1 << 30


class MutantVerdict(Enum):
    """The fate of a mutant; one that ran out of time counts as detected."""

    KILLED = "killed"
    TIMEOUT = "timeout"
    SURVIVED = "survived"


PASSED, FAILED = 0, 17
"""Exit codes of an attempt; Python itself exits with 1 on other errors."""


class Attempt(NamedTuple):
    """A run of tests: `passes` returns whether they pass; `cpu_s` is the time without a mutant."""

    passes: Callable[[], bool]
    cpu_s: float


def in_parallel(tried: Sequence[Attempt], jobs: int) -> list[MutantVerdict]:
    """Return the verdicts of attempts, `jobs` processes at a time."""
    found: dict[int, MutantVerdict] = {}
    running: dict[int, ForkProcess] = {}
    for at, one in enumerate(tried):
        running[at] = FORK.Process(target=attempt, args=(one,))
        running[at].start()
        if len(running) >= jobs:
            reap(running, found)
    while running:
        reap(running, found)
    return [found[at] for at in range(len(tried))]


def reap(running: dict[int, ForkProcess], found: dict[int, MutantVerdict]) -> None:
    """Wait for processes to end; kill those that hang."""
    ended = wait([process.sentinel for process in running.values()], WALL_S)
    for at, process in list(running.items()):
        if process.sentinel in ended or not ended:
            process.kill()
            process.join()
            found[at] = verdict_of(process.exitcode)
            del running[at]


def verdict_of(exit_code: int | None) -> MutantVerdict:
    """Return the verdict of an exit code; a process that was killed ran out of time."""
    if exit_code is not None and exit_code < 0:
        return MutantVerdict.TIMEOUT
    return {PASSED: MutantVerdict.SURVIVED, FAILED: MutantVerdict.KILLED}[exit_code or PASSED]


def attempt(one: Attempt) -> None:
    """Run an attempt and exit with PASSED or FAILED."""
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


def silence(log: IO[bytes] | None = None) -> None:
    """Discard the output of the tests, or write it to a file."""
    with open(os.devnull, "r+b", buffering=0) as nowhere:
        output = nowhere if log is None else log
        for descriptor, file in enumerate((nowhere, output, output)):
            os.dup2(file.fileno(), descriptor)
