"""Run the tests of a module once for each mutant, each time in a process of its own.

Tests are imported and collected once. A mutant inside a function is tried in a fork of that
process, with the function's code replaced. A mutant of module code (constants, tables, defaults)
must be in force during imports: it is tried in a fork of a process that has imported nothing of the
project. Each attempt has limits of time and memory.
"""

import gc
import importlib.abc
import importlib.machinery
import importlib.util
import os
import resource
import sys
from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from tempfile import TemporaryFile
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import IO, Any, Final, NamedTuple

import pytest
from hypothesis import Phase, settings

from checks.mutation.mutants import Mutant

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


class MutantRun(NamedTuple):
    """A run of tests: `passes` returns whether they pass; `cpu_s` is the time without a mutant."""

    passes: Callable[[], bool]
    cpu_s: float


def in_parallel(tried: Sequence[MutantRun], jobs: int) -> list[MutantVerdict]:
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


def attempt(one: MutantRun) -> None:
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


OPTIONS: Final = (
    *("-q", "-x", "-s", "--no-header", "--no-summary", "-p", "no:xdist", "-p", "no:cov"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # Hypothesis is already imported
)


class Tests(NamedTuple):
    """The tests of the unchanged code: CPU time, and the tests that call each function."""

    cpu_s: float
    callers: dict[str, tuple[int, ...]]


class MutationTarget(NamedTuple):
    """A source file, and the test files that must detect its mutants."""

    path: Path
    root: Path
    tests: tuple[str, ...]

    @property
    def name(self) -> str:
        """The import name of the module."""
        return ".".join(self.path.relative_to(self.root).with_suffix("").parts)

    def run(self, *plugins: object) -> int:
        """Run the tests and return pytest's exit code."""
        arguments = [str(self.root / test) for test in self.tests]
        options = [*OPTIONS, "--rootdir", str(self.root), *arguments]
        return int(pytest.main(options, [FailurePrinter(), *plugins]))


class BrokenTestsError(Exception):
    """The tests fail without a mutant, or cannot be collected; `output` tells which, and why."""

    def __init__(self, target: MutationTarget, output: str) -> None:
        tests = " ".join(target.tests)
        words = f"{target.name}: its tests fail without a mutant: pytest {tests}"
        super().__init__(f"{words}\n{output}".rstrip())


def verdicts(target: MutationTarget, mutants: Sequence[Mutant], jobs: int) -> list[MutantVerdict]:
    """Return the verdict on each mutant, in their order."""
    inner = [mutant for mutant in mutants if mutant.function]
    outer = [mutant for mutant in mutants if not mutant.function]
    with TemporaryFile() as log:
        receiving, sending = FORK.Pipe(duplex=False)
        process = FORK.Process(target=collect_and_try, args=(target, inner, jobs, sending, log))
        process.start()
        sending.close()
        try:
            tests, found = receiving.recv()
        except EOFError:
            raise BrokenTestsError(target, text_in(log)) from None
        finally:
            process.join()
        by_mutant = dict(zip(map(id, inner), found, strict=True))
        control = MutantRun(partial(import_changed, target, unchanged(target), log), tests.cpu_s)
        file = str(target.path)
        tried = [
            MutantRun(partial(import_changed, target, mutant.compile(file)), tests.cpu_s)
            for mutant in outer
        ]
        verdict, *found = in_parallel([control, *tried], jobs)
        if verdict is not MutantVerdict.SURVIVED:
            raise BrokenTestsError(target, f"{verdict.value}\n{text_in(log)}")
    by_mutant.update(zip(map(id, outer), found, strict=True))
    return [by_mutant[id(mutant)] for mutant in mutants]


def text_in(log: IO[bytes]) -> str:
    """Return what was written to a file."""
    log.seek(0)
    return log.read().decode(errors="replace")


def unchanged(target: MutationTarget) -> CodeType:
    """Return the code of the unmodified module, which must pass."""
    source = target.path.read_text(encoding="utf-8")
    return compile(source, str(target.path), "exec", dont_inherit=True)


def collect_and_try(
    target: MutationTarget,
    mutants: Sequence[Mutant],
    jobs: int,
    sending: Connection,
    log: IO[bytes],
) -> None:
    """Collect the tests, run them once and then for each mutant; send the results."""
    silence(log)
    target.run(MutantLoop(target, mutants, jobs, sending))


class MutantLoop:
    """A pytest plugin that replaces the loop over the collected tests."""

    def __init__(
        self, target: MutationTarget, mutants: Sequence[Mutant], jobs: int, sending: Connection
    ) -> None:
        self._target = target
        self._mutants = mutants
        self._jobs = jobs
        self._sending = sending

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests of each mutant instead of all tests."""
        if session.testsfailed or not session.items:
            return True
        for item in session.items:
            derandomize(item)
        tests = first_run(self._target, session)
        if tests is not None:
            tried = [
                MutantRun(partial(self._change, mutant, session, tests), tests.cpu_s)
                for mutant in self._mutants
            ]
            self._sending.send((tests, in_parallel(tried, self._jobs)))
        return True

    def _change(self, mutant: Mutant, session: pytest.Session, tests: Tests) -> bool:
        replace_code(str(self._target.path), mutant)
        return passes(session, tests.callers.get(mutant.function, ()))


CHOSEN: Final = "_hypothesis_internal_use_settings"


def derandomize(item: pytest.Item) -> None:
    """Let a property draw the same examples each time, and stop at the first that fails."""
    test: Any = getattr(item, "function", None)
    chosen = getattr(test, CHOSEN, None)
    if chosen is not None:
        phases = (Phase.explicit, Phase.generate)
        settled = settings(chosen, database=None, derandomize=True, phases=phases)
        setattr(test, CHOSEN, settled)


def first_run(target: MutationTarget, session: pytest.Session) -> Tests | None:
    """Run all tests on the unchanged code in a process of its own; None if one fails.

    Properties run last, because other tests kill most mutants sooner.
    """
    receiving, sending = FORK.Pipe(duplex=False)

    def run() -> None:
        callers: dict[str, list[int]] = {}
        for at in sorted(
            range(len(session.items)),
            key=lambda at: hasattr(getattr(session.items[at], "function", None), CHOSEN),
        ):
            with CallRecorder(str(target.path)) as called:
                passed = passes(session, (at,))
            if not passed:
                return
            for name in called:
                callers.setdefault(name, []).append(at)
        used = resource.getrusage(resource.RUSAGE_SELF)
        found = {name: tuple(items) for name, items in callers.items()}
        sending.send(Tests(used.ru_utime + used.ru_stime, found))

    process = FORK.Process(target=run)
    process.start()
    sending.close()
    try:
        tests: Tests = receiving.recv()
    except EOFError:
        return None
    finally:
        process.join()
    return tests


class CallRecorder:
    """Records the names of a file's functions that are called in the block."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._called: set[str] = set()

    def __enter__(self) -> set[str]:
        sys.setprofile(self._note)
        return self._called

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _note(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename == self._file:
            self._called.add(code.co_qualname.partition(".<locals>")[0])


def passes(session: pytest.Session, at: Sequence[int]) -> bool:
    """Run some of the collected tests until one fails."""
    items = [session.items[index] for index in at]
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.testsfailed:
            return False
    return True


def replace_code(file: str, mutant: Mutant) -> None:
    """Replace the code of the changed function and of all functions inside it."""
    changed = {
        (code.co_qualname, code.co_firstlineno): code
        for code in codes_in(mutant.compile(file))
        if (code.co_qualname + ".").startswith(mutant.function + ".")
    }
    gc.unfreeze()  # what is frozen is not in the list
    for function in gc.get_objects():
        if type(function) is FunctionType and function.__code__.co_filename == file:
            was = function.__code__
            function.__code__ = changed.get((was.co_qualname, was.co_firstlineno), was)


def codes_in(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and those nested in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes_in(constant)


def import_changed(target: MutationTarget, code: CodeType, log: IO[bytes] | None = None) -> bool:
    """Run the tests with a module imported from this code; return whether they pass.

    Their output goes to `log`, if there is one.
    """
    silence(log)
    sys.meta_path.insert(0, ChangedModuleImporter(target, code))
    return target.run(DerandomizePlugin()) == pytest.ExitCode.OK


class FailurePrinter:
    """A pytest plugin that prints each failure at once: the process may end without a summary."""

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Print why tests cannot be collected."""
        self._print(report)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Print why a test failed."""
        self._print(report)

    @staticmethod
    def _print(report: pytest.CollectReport | pytest.TestReport) -> None:
        if report.failed:
            print(f"{report.nodeid}\n{report.longreprtext}", flush=True)


class DerandomizePlugin:
    """A pytest plugin that derandomizes properties."""

    def pytest_runtestloop(self, session: pytest.Session) -> None:
        """Derandomize all properties before the tests run."""
        for item in session.items:
            derandomize(item)


class ChangedModuleImporter(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from changed code."""

    def __init__(self, target: MutationTarget, code: CodeType) -> None:
        self._target = target
        self._code = code

    def find_spec(
        self, fullname: str, path: object, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the specification of the changed module; None for others."""
        if fullname != self._target.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._target.path, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        """Execute the changed code."""
        exec(self._code, vars(module))
