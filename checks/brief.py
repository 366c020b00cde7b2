"""`python -m checks.brief`: choose the tests that `make test` runs, into `tests/brief.txt`.

All tests that own their time are run once, with coverage, which takes about a quarter of an hour.
Then files are chosen until the budget of processor time is spent: first those that touch modules of
the product that no chosen file touches, then those that add the most lines for their time. A module
is touched when a line inside one of its functions, or of a module without functions, is executed.

As a plugin of pytest (`-p checks.brief`) it fails a run of the chosen tests in which a module
of the product was not even imported: a new module needs a test there.
"""

import argparse
import ast
import os
import pickle
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest
from coverage import Coverage, CoverageData

from runtime.cli.packages import PACKAGES

ROOT: Final = Path(__file__).resolve().parents[1]
CHOSEN: Final = ROOT / "tests" / "brief.txt"
ONBOARD: Final = "firmware/onboard/"
"""Runs under MicroPython only."""
OWN_PROCESS: Final = ("ground.launch.sidestep_process",)
"""Imported only where it is the program: tests with processes run it."""
RECORDS: Final = "SIDESTEP_BRIEF_RECORDS"
BUDGET_S: Final = 70.0
"""Of processor time without coverage, on all cores together; 120 s are allowed."""
COVERAGE_COST: Final = 4.0
"""How many times as long the tests take with coverage."""
MAX_FILE_S: Final = 4.0
"""A file that takes longer is left to `make gate`, unless only it touches a module."""
SOCKETS: Final = "tests/bus/"
"""Tests there wait for sockets: they are chosen only where no other touches a module."""
Line = tuple[str, int]


class FileRecord(NamedTuple):
    """What the tests of a file need, and which lines of the product they execute."""

    cost_s: float
    lines: frozenset[Line]


def modules() -> list[Path]:
    """Return the modules of the product that run in CPython, relative to the checkout."""
    paths = [path.relative_to(ROOT) for room in PACKAGES for path in (ROOT / room).rglob("*.py")]
    return sorted(path for path in paths if not path.as_posix().startswith(ONBOARD))


def import_name(path: Path) -> str:
    """Return the name under which a module is imported."""
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def lines_that_touch(path: Path) -> set[Line] | None:
    """Return the lines inside the functions of a module; None if it has none."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    functions = [
        node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    found = {
        (path.as_posix(), line)
        for node in functions
        for line in range(node.body[0].lineno, (node.end_lineno or node.lineno) + 1)
    }
    return found or None


def choose(
    records: dict[str, FileRecord], touching: dict[str, set[Line]], budget_s: float
) -> tuple[list[str], list[str]]:
    """Return the chosen files, and the modules that no file touches."""
    chosen: list[str] = []
    covered: set[Line] = set()
    touches = {
        name: {module for module, lines in touching.items() if lines & record.lines}
        for name, record in records.items()
    }
    touched: set[str] = set()

    def take(gain: Callable[[str], int], names: Iterable[str]) -> str | None:
        def value(name: str) -> tuple[float, str]:
            return gain(name) / (0.05 + records[name].cost_s), name

        best = max((name for name in names if name not in chosen), key=value, default=None)
        if best is None or not gain(best):
            return None
        chosen.append(best)
        covered.update(records[best].lines)
        touched.update(touches[best])
        return best

    usable = {name: one for name, one in records.items() if not name.startswith(SOCKETS)}
    short = [name for name, record in usable.items() if record.cost_s <= MAX_FILE_S]
    for names in (short, list(usable), list(records)):
        while take(lambda name: len(touches[name] - touched), names):
            pass
    spent_s = sum(records[name].cost_s for name in chosen)
    while spent_s < budget_s:
        affordable = [name for name in short if spent_s + records[name].cost_s <= budget_s]
        name = take(lambda name: len(records[name].lines - covered), affordable)
        if name is None:
            break
        spent_s += records[name].cost_s
    return sorted(chosen), sorted(set(touching) - touched)


class Recorder:
    """Records, for each test, its processor time and the lines of the product it executes."""

    def __init__(self, folder: Path) -> None:
        source = [str(ROOT / room) for room in PACKAGES]
        self._coverage = Coverage(data_file=None, source=source, config_file=False)
        # A test may execute nothing of the product, and the product is imported before.
        quiet = ["no-data-collected", "module-not-measured", "module-not-imported"]
        self._coverage.set_option("run:disable_warnings", quiet)
        self._file = (folder / f"{os.getpid()}.pickle").open("wb")

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Measure one test."""
        before_s = processor_s()
        self._coverage.erase()
        with self._coverage.collect():
            result = yield
        data = self._data()
        lines = [
            (Path(file).relative_to(ROOT).as_posix(), line)
            for file in data.measured_files()
            for line in data.lines(file) or ()
        ]
        record = (item.nodeid.partition("::")[0], processor_s() - before_s, lines)
        pickle.dump(record, self._file)
        self._file.flush()
        return result

    def _data(self) -> CoverageData:
        """Return what was executed. Threads that a test has left may add to it meanwhile."""
        while True:
            with suppress(RuntimeError):
                return self._coverage.get_data()


def processor_s() -> float:
    """Return the processor time of this process and of its ended children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


class ImportCheck:
    """Fails a run in whose processes together not every module of the product was imported."""

    def __init__(self) -> None:
        self._imported: set[str] = set()

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take over the names that a worker has imported."""
        self._imported.update(getattr(node, "workeroutput", {}).get("imported", ()))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hand the names to the controller, or name the modules that are missing there."""
        names = {import_name(path) for path in modules()} - {*OWN_PROCESS}
        self._imported |= names & set(sys.modules)
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["imported"] = sorted(self._imported)
            return
        missing = sorted(names - self._imported)
        if missing and session.testscollected and not session.testsfailed:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
            print(
                f"\nno test in {CHOSEN.relative_to(ROOT)} imports {', '.join(missing)}:"
                " add the file of a test that does, or run `make brief`"
            )


def pytest_configure(config: pytest.Config) -> None:
    """Register what this run is for."""
    folder = os.environ.get(RECORDS)
    config.pluginmanager.register(Recorder(Path(folder)) if folder else ImportCheck())


def read_records(folder: Path) -> dict[str, FileRecord]:
    """Return the records of all processes, by test file."""
    costs: dict[str, float] = {}
    lines: dict[str, set[Line]] = {}
    for path in folder.glob("*.pickle"):
        with path.open("rb") as file:
            while file.peek(1):
                name, cost_s, executed = pickle.load(file)
                costs[name] = costs.get(name, 0.0) + cost_s / COVERAGE_COST
                lines.setdefault(name, set()).update(executed)
    return {name: FileRecord(costs[name], frozenset(lines[name])) for name in costs}


def main(argv: Sequence[str] | None = None) -> int:
    """Run all tests, choose, and write the list; return the exit code of pytest."""
    parser = argparse.ArgumentParser(prog="python -m checks.brief", description=__doc__)
    parser.add_argument("--budget", type=float, default=BUDGET_S, help="seconds (%(default)s)")
    parser.add_argument("--records", type=Path, help="of an earlier run, instead of a new one")
    options = parser.parse_args(argv)
    from checks.gate import ELSEWHERE, EXAMPLES, PYTEST, cores

    with tempfile.TemporaryDirectory() as place:
        code, folder = 0, options.records or Path(place)
        if options.records is None:
            words = (*PYTEST, *cores(0), *EXAMPLES, "-p", "checks.brief", "-p", "no:cov")
            code = subprocess.run(
                (*words, "-m", ELSEWHERE), cwd=ROOT, env={**os.environ, RECORDS: place}
            ).returncode
        records = read_records(folder)
    touching = {path.as_posix(): lines for path in modules() if (lines := lines_that_touch(path))}
    chosen, untouched = choose(records, touching, options.budget)
    CHOSEN.write_text("".join(f"{name}\n" for name in chosen), encoding="utf-8")
    cost_s = sum(records[name].cost_s for name in chosen)
    whole_s = sum(record.cost_s for record in records.values())
    covered = set().union(*(records[name].lines for name in chosen))
    whole = set().union(*(record.lines for record in records.values()))
    print(
        f"{len(chosen)} of {len(records)} files, {cost_s:.0f} of {whole_s:.0f} s of processor time,"
        f" {len(covered)} of {len(whole)} lines; untouched: {' '.join(untouched) or 'no module'}"
    )
    return code


if __name__ == "__main__":
    sys.exit(main())
