"""Shared by every run: with --no-skips a test that is skipped has failed, with its reason."""

import asyncio
import gc
import inspect
import os
import signal
import threading
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings


@pytest.hookimpl(trylast=True)
def pytest_runtest_call() -> None:
    """Wait, while the output of a test is open, for the thread that says that no robot is there."""
    for thread in threading.enumerate():
        if thread.name == "note absence":
            thread.join(60.0)


@pytest.fixture(scope="session", autouse=True)
def state_of_our_own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Redirect what the app stores in the user's home (history, recordings, settings)."""
    folder = tmp_path_factory.mktemp("state")
    before = {name: os.environ.get(name) for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME")}
    os.environ.update(dict.fromkeys(before, str(folder)))
    yield folder
    for name, value in before.items():
        if value is None:
            del os.environ[name]
        else:
            os.environ[name] = value


def pytest_configure(config: pytest.Config) -> None:
    """Load a profile of Hypothesis by the name in `--examples`; watch the load.

    An example has no deadline: its duration depends on the load of the machine. A shell lets what
    it starts in the background ignore SIGINT, which processes under test would inherit.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for name, examples in EXAMPLES.items():
        settings.register_profile(name, deadline=None, max_examples=examples)
    settings.load_profile(config.getoption("--examples"))
    config.pluginmanager.register(Loads())


TESTS = Path(__file__).parent
EXAMPLES = {"brief": 30, "usual": 100, "long": 2000}
"""The examples of a property that sets no number of its own, by the value of `--examples`."""
FOLDERS_OF = {
    "stack": ("stack", "bus"),
    "compose": ("compose",),
    "interop": ("interop",),
    "mcu": ("mcu",),
    "realtime": ("stack", "bus"),
}
"""A step of the gate collects only these: to collect everything costs more than many a test."""


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None]:
    """Collect without garbage collection, which never traverses the thousands of items.

    Afterwards it is rarer than usual: starting an app makes many objects that live on.
    """
    gc.disable()
    try:
        share_compilation(session.config)
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(50_000, 20, 100)
        gc.enable()


def share_compilation(config: pytest.Config) -> None:
    """Import a share of the test files in each worker of xdist, before it collects all of them.

    All workers collect the same files in the same order. In a new clone each would compile all of
    them, with their assertions, at the same moment as the others.
    """
    worker = getattr(config, "workerinput", None)
    if worker is None:
        return
    number, of = int(worker["workerid"].removeprefix("gw")), worker["workercount"]
    left_out = [Path(file).resolve() for file in config.getoption("ignore") or ()]
    files: list[Path] = []
    for place in map(Path, config.args):
        files += sorted(place.rglob("test_*.py")) if place.is_dir() else [place]
    for file in [one.resolve() for one in files if one.resolve() not in left_out][number::of]:
        with suppress(Exception, pytest.skip.Exception):  # collection reports it
            import_module(".".join(file.relative_to(TESTS.parent).with_suffix("").parts))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Reject a marker of a lane on a test that its lane would not find; thin out sweeps."""
    reject_misplaced(items)
    if config.getoption("--examples") != "long":
        thin_out(config, items)


def thin_out(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect all but every n-th row of a test that is marked `sweep(n)`."""
    rows: Counter[tuple[object, ...]] = Counter()
    left_out: list[pytest.Item] = []
    for item in items:
        marker = item.get_closest_marker("sweep")
        if marker is None:
            continue
        test = (item.path, getattr(item, "originalname", item.name))
        if rows[test] % marker.args[0]:
            left_out.append(item)
        rows[test] += 1
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        unwanted = set(left_out)
        items[:] = [item for item in items if item not in unwanted]


def reject_misplaced(items: Sequence[pytest.Item]) -> None:
    """Raise a usage error for a test whose marker its folder forbids."""
    folder_of: dict[Path, str | None] = {}
    for item in items:
        if item.path not in folder_of:
            inside = item.path.is_relative_to(TESTS)
            folder_of[item.path] = item.path.relative_to(TESTS).parts[0] if inside else None
        folder = folder_of[item.path]
        if folder is None:
            continue
        for marker, folders in FOLDERS_OF.items():
            if folder not in folders and item.get_closest_marker(marker):
                where = " or ".join(f"tests/{name}" for name in folders)
                raise pytest.UsageError(f"{item.nodeid} is marked {marker}: move it to {where}")


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an asynchronous test on an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = pyfuncitem._fixtureinfo.argnames
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-screens", action="store_true", help="take the screens as they are")
    parser.addoption("--no-skips", action="store_true", help="a skipped test fails, as in CI")
    parser.addoption("--examples", choices=EXAMPLES, default="usual", help="of each property")


class Loads:
    """Says which load the tests of real time have met: with much of it a failure proves little."""

    def __init__(self) -> None:
        self._loads: list[float] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the load average at the end of a test whose verdict depends on real time."""
        if "realtime" in report.keywords and report.when == "call":
            self._loads.append(os.getloadavg()[0])

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the least and the most of them."""
        if self._loads:
            terminalreporter.write_line(
                f"load average met by tests of real time: {min(self._loads):.1f} to"
                f" {max(self._loads):.1f} on {os.cpu_count()} cores"
            )


class Count:
    """Writes how many tests have ended, and of how many, for the line of `make test`."""

    def __init__(self, session: pytest.Session, file: Path) -> None:
        self._session, self._file = session, file
        self._done = 0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count a test at its last phase; a torn write cannot be read and is left out."""
        if report.when == "teardown":
            self._done += 1
            self._file.write_text(f"{self._done} {self._session.testscollected}\n", "ascii")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Count for the program that has started this run; a worker of xdist has no count."""
    file = os.environ.pop("SIDESTEP_TEST_COUNT", "")
    if file and not hasattr(session.config, "workerinput"):
        session.config.pluginmanager.register(Count(session, Path(file)), "count")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    expected_failure = hasattr(report, "wasxfail")
    if report.skipped and not expected_failure and item.config.getoption("--no-skips"):
        report.outcome = "failed"
        report.longrepr = f"skipped, which --no-skips forbids: {reason(report.longrepr)}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    if report.skipped and collector.config.getoption("--no-skips"):
        report.outcome = "failed"
        report.longrepr = f"skipped, which --no-skips forbids: {reason(report.longrepr)}"
    return report


def reason(skip: object) -> str:
    """Return the reason from pytest's tuple (path, line, reason)."""
    return str(skip[2]) if isinstance(skip, tuple) else str(skip)
