"""Run the tests of a module once for each mutant, each time in a process of its own.

Tests are imported and collected once. A mutant inside a function is tried in a fork of that
process, in which the function's code is replaced. A mutant of a module's own code (constants,
tables, defaults) is in force while everything is imported: it is tried in a fork of a process that
has imported nothing of the project.
"""

import gc
import importlib.abc
import importlib.machinery
import importlib.util
import resource
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, Final, NamedTuple

import pytest
from hypothesis import Phase, settings

from verification.mutation.forks import FORK, Try, Verdict, in_parallel, silence
from verification.mutation.mutants import Mutant

OPTIONS: Final = (
    *("-q", "-x", "-s", "--no-header", "--no-summary", "-p", "no:xdist", "-p", "no:cov"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # Hypothesis is here already
)


class Tests(NamedTuple):
    """What the unchanged code does: CPU time, and the tests that call each function."""

    cpu_s: float
    callers: dict[str, tuple[int, ...]]


class Target(NamedTuple):
    """A source file and the test files that are to notice its mutants."""

    path: Path
    root: Path
    tests: tuple[str, ...]

    @property
    def name(self) -> str:
        """The module's name as it is imported."""
        return ".".join(self.path.relative_to(self.root).with_suffix("").parts)

    def run(self, *plugins: object) -> int:
        arguments = [str(self.root / test) for test in self.tests]
        return int(pytest.main([*OPTIONS, "--rootdir", str(self.root), *arguments], list(plugins)))


class Broken(Exception):
    """The tests fail without any mutant, or cannot be collected."""

    def __init__(self, target: Target) -> None:
        tests = " ".join(target.tests)
        super().__init__(f"{target.name}: its tests fail without a mutant: pytest {tests}")


def verdicts(target: Target, mutants: Sequence[Mutant], jobs: int) -> list[Verdict]:
    """Return the verdict on each mutant, in their order."""
    inner = [mutant for mutant in mutants if mutant.function]
    outer = [mutant for mutant in mutants if not mutant.function]
    receiving, sending = FORK.Pipe(duplex=False)
    process = FORK.Process(target=collect_and_try, args=(target, inner, jobs, sending))
    process.start()
    sending.close()
    try:
        tests, found = receiving.recv()
    except EOFError:
        raise Broken(target) from None
    finally:
        process.join()
    by_mutant = dict(zip(map(id, inner), found, strict=True))
    file = str(target.path)
    codes = [unchanged(target), *(mutant.compile(file) for mutant in outer)]
    tried = [Try(partial(import_changed, target, code), tests.cpu_s) for code in codes]
    control, *found = in_parallel(tried, jobs)
    if control is not Verdict.SURVIVED:
        raise Broken(target)
    by_mutant.update(zip(map(id, outer), found, strict=True))
    return [by_mutant[id(mutant)] for mutant in mutants]


def unchanged(target: Target) -> CodeType:
    """Return the code of the module as it is, which must pass as a mutant would not."""
    source = target.path.read_text(encoding="utf-8")
    return compile(source, str(target.path), "exec", dont_inherit=True)


def collect_and_try(
    target: Target, mutants: Sequence[Mutant], jobs: int, sending: Connection
) -> None:
    """Collect the tests, run them once and then for each mutant; send what came out."""
    silence()
    target.run(Loop(target, mutants, jobs, sending))


class Loop:
    """A plugin of pytest that takes the place of its loop over the collected tests."""

    def __init__(
        self, target: Target, mutants: Sequence[Mutant], jobs: int, sending: Connection
    ) -> None:
        self._target = target
        self._mutants = mutants
        self._jobs = jobs
        self._sending = sending

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        if session.testsfailed or not session.items:
            return True
        for item in session.items:
            settle(item)
        tests = first_run(self._target, session)
        if tests is not None:
            tried = [
                Try(partial(self._change, mutant, session, tests), tests.cpu_s)
                for mutant in self._mutants
            ]
            self._sending.send((tests, in_parallel(tried, self._jobs)))
        return True

    def _change(self, mutant: Mutant, session: pytest.Session, tests: Tests) -> bool:
        replace_code(str(self._target.path), mutant)
        return passes(session, tests.callers.get(mutant.function, ()))


CHOSEN: Final = "_hypothesis_internal_use_settings"


def is_property(item: pytest.Item) -> bool:
    """Return whether Hypothesis runs this test with many examples."""
    return hasattr(getattr(item, "function", None), CHOSEN)


def settle(item: pytest.Item) -> None:
    """Let a property draw the same examples each time, and stop at the first that fails."""
    test: Any = getattr(item, "function", None)
    chosen = getattr(test, CHOSEN, None)
    if chosen is not None:
        phases = (Phase.explicit, Phase.generate)
        settled = settings(chosen, database=None, derandomize=True, phases=phases)
        setattr(test, CHOSEN, settled)


def first_run(target: Target, session: pytest.Session) -> Tests | None:
    """Run all tests on the unchanged code in a process of its own; None when one fails.

    Properties come last: most mutants do not live as long.
    """
    receiving, sending = FORK.Pipe(duplex=False)

    def run() -> None:
        callers: dict[str, list[int]] = {}
        for at in sorted(range(len(session.items)), key=lambda at: is_property(session.items[at])):
            with calls_of(str(target.path)) as called:
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


class calls_of:
    """Collect the names of a file's functions that are called in this block."""

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
    """Run some of the collected tests, until one fails."""
    items = [session.items[index] for index in at]
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.testsfailed:
            return False
    return True


def replace_code(file: str, mutant: Mutant) -> None:
    """Give all functions that are inside the changed one, and itself, their changed code."""
    changed = {
        (code.co_qualname, code.co_firstlineno): code
        for code in codes_in(mutant.compile(file))
        if (code.co_qualname + ".").startswith(mutant.function + ".")
    }
    for function in gc.get_objects():
        if type(function) is FunctionType and function.__code__.co_filename == file:
            was = function.__code__
            function.__code__ = changed.get((was.co_qualname, was.co_firstlineno), was)


def codes_in(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes_in(constant)


def import_changed(target: Target, code: CodeType) -> bool:
    """Run the tests with a module that is imported from this code; return whether they pass."""
    sys.meta_path.insert(0, Changed(target, code))
    return target.run(Settling()) == pytest.ExitCode.OK


class Settling:
    """A plugin of pytest that settles the properties."""

    def pytest_runtestloop(self, session: pytest.Session) -> None:
        for item in session.items:
            settle(item)


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from changed code."""

    def __init__(self, target: Target, code: CodeType) -> None:
        self._target = target
        self._code = code

    def find_spec(
        self, fullname: str, path: object, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._target.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._target.path, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        exec(self._code, vars(module))
