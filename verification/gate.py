"""`python -m verification.gate`: every check of the project.

There are three phases. The first phase runs static checks and tests that control their time;
meanwhile it compiles the tests, builds the images for the tests with containers, installs the
MAVLink clients, and builds and tests the firmware. The other phases measure wall time. The second
one runs the tests with processes, including first drives. No other step runs at the same time, so
that robots are not late. The third one runs the tests with containers, and at the same time the
tests with MAVLink clients, which wait for their robot most of the time. Every step is run, so that
one call shows all errors. The exit code is 1 when a step failed, and the last line names it.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from threading import Lock, Thread
from time import monotonic
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
PYTHON: Final = (sys.executable, "-m")
PYTEST: Final = (*PYTHON, "pytest", "-q", "--durations=12")
EXIT_INTERRUPTED: Final = 130
BRIEF: Final = ("--examples", "brief")
"""Branch coverage and mutation, which depend on what examples reach, have the usual number."""
REAL_TIME: Final = "stack and not compose"
REAL_TIME_FOLDERS: Final = ("tests/stack", "tests/bus")
"""tests/conftest.py rejects such a test elsewhere."""
WORKERS: Final = 4
"""Of the tests with processes: more would start so many at once that robots miss deadlines. Those
with containers and with MAVLink clients have one each: a stack of containers keeps a core busy."""
ELSEWHERE: Final = "not stack and not compose and not interop and not mcu"
INTEROP: Final = "interop and brief"
"""Real clients on a clean line. `make interop` has the rest."""


class Step(NamedTuple):
    """A command and its name."""

    name: str
    words: tuple[str, ...]


Lane = Sequence[Step]
"""Steps that run one after the other."""


def phases(extra: Sequence[str]) -> list[list[Lane]]:
    """Return the lanes of each phase; `extra` are options for each call of pytest."""
    prepared = [
        # In a fresh clone each worker would compile all tests, at the same time as the others.
        Step("bytecode of the tests", (*PYTEST, "--collect-only", "-qq")),
        Step("images", (*PYTHON, "tests.support.compose.images")),
        Step("MAVLink clients", (*PYTHON, "tests.interop.environments", *extra)),
        Step("tests with the firmware", (*PYTEST, "-m", "mcu", *extra, "tests/mcu")),
    ]
    containers = Step("tests with containers", (*PYTEST, "-m", "compose", *extra, "tests/compose"))
    clients = Step("tests with MAVLink clients", (*PYTEST, "-m", INTEROP, *extra, "tests/interop"))
    return [[computing(extra), prepared], [processes(extra)], [[containers], [clients]]]


def processes(extra: Sequence[str]) -> list[Step]:
    """Return the tests with processes, which measure wall time."""
    # A file runs on one worker, as its tests share processes; in the order of the folders.
    workers = ("-n", str(WORKERS), "--dist", "loadfile", "--no-loadscope-reorder")
    words = (*PYTEST, *workers, "-m", REAL_TIME, *extra, *REAL_TIME_FOLDERS)
    return [Step("tests with processes", words)]


def computing(extra: Sequence[str]) -> list[Step]:
    """Return the steps that only need processor time."""
    # One worker more than there are cores: some tests wait for threads and processes.
    workers = ("-n", str((os.cpu_count() or 1) + 1), "--dist", "worksteal")
    mutation = (*PYTHON, "verification.mutation", "--module", "stop_latch")
    return [
        Step("format", (*PYTHON, "ruff", "format", "--check", ".")),
        Step("lint", (*PYTHON, "ruff", "check", ".")),
        Step("types", (*PYTHON, "mypy", "--strict")),
        Step("import contracts", (str(Path(sys.executable).with_name("lint-imports")),)),
        Step("documentation", (*PYTHON, "verification.site")),
        Step("branch coverage", (*PYTHON, "verification.branch_coverage")),
        Step("mutation of the stop", mutation),
        Step(
            "tests",
            (*PYTEST, *workers, *BRIEF, "-m", ELSEWHERE, *extra),
        ),
    ]


class Gate:
    """Runs the lanes of a phase at the same time; keeps the names of steps that failed."""

    def __init__(self, folder: Path = ROOT) -> None:
        self._folder = folder
        self._printing = Lock()
        self.failed: list[str] = []

    def run(self, phases: Sequence[Sequence[Lane]]) -> int:
        """Run all steps to their ends; return the exit code."""
        began_s = monotonic()
        for lanes in phases:
            threads = [Thread(target=self._run_lane, args=(lane,), daemon=True) for lane in lanes]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        took_s = monotonic() - began_s
        if self.failed:
            names = ", ".join(self.failed)
            print(f"\nmake test: FAILED: {names} ({took_s:.0f} s)", file=sys.stderr)
            return 1
        print(f"\nmake test: all passed ({took_s:.0f} s)")
        return 0

    def _run_lane(self, lane: Lane) -> None:
        for step in lane:
            self._print(f"... {step.name}")
            self._run_step(step)

    def _run_step(self, step: Step) -> None:
        began_s = monotonic()
        with tempfile.TemporaryFile() as output:
            done = subprocess.run(
                step.words,
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                check=False,
            )
            output.seek(0)
            text = output.read().decode(errors="replace")
        if done.returncode:
            self.failed.append(step.name)
        took_s = monotonic() - began_s
        self._print(f"\n=== {step.name}: {' '.join(step.words)}\n{text}{took_s:.0f} s")

    def _print(self, text: str) -> None:
        with self._printing:
            print(text, flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the gate; return 0 when every step passed, else 1."""
    parser = argparse.ArgumentParser(prog="python -m verification.gate", description=__doc__)
    parser.add_argument("--no-skips", action="store_true", help="a skipped test fails, as in CI")
    options = parser.parse_args(argv)
    extra = ["--no-skips"] if options.no_skips else []
    # A job in the background of a shell ignores it, and so would every process under test.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Hundreds of processes are started: none of them compiles what another has compiled.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    try:
        return Gate().run(phases(extra))
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
