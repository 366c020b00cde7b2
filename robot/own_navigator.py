"""A navigator of the user's own: loaded, checked, and watched at each step.

A step that raises, returns no usable decision, or does not end fails: its goal ends with the reason
NAVIGATOR_FAILED and the robot stops. The failure names file, line and remedy.
"""

import ctypes
import importlib
import importlib.util
import inspect
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from hashlib import sha256
from itertools import count
from math import inf
from pathlib import Path
from traceback import TracebackException, walk_tb
from types import ModuleType
from typing import Any, Final

from protocol.navigators import DEFINED, OwnSource, own_source
from protocol.wire.enums import Branch, Navigator
from robot.core import states
from robot.core.brain import TICK_US
from robot.core.navigators import registry
from robot.core.navigators.registry import NAVIGATORS, NavigatorStep
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Decision, Goal, Pose
from runtime.errors import UserError

ARGUMENTS: Final = "memory, pose, ring, goal, params"
JUDGES: Final = "JUDGES_PROGRESS"
"""A constant of the file: True if its navigator itself finds out that it cannot arrive."""

STEP_LIMIT_NS: Final = 1_000_000_000
"""Processor time after which a step is taken for one that does not end."""

LOAD_LIMIT_NS: Final = 10_000_000_000
"""The same for a file that is loaded: what it imports may take seconds."""

LOOK_S: Final = 0.1
FIRST_IN_SIMULATION: Final = 2000
"""Numbers of navigators of trials, which no message has."""


class Memory:
    """The state of a navigator between two ticks, for files without a class `Memory`.

    `side` is where obstacles are passed: 1 left, -1 right. Further attributes may be added.
    """

    fault = ""
    """Why this stands for a memory that could not be made."""

    def __init__(self) -> None:
        self.side: int = states.LEFT

    def __getattr__(self, name: str) -> Any:  # for mypy: a step may add attributes
        raise AttributeError(
            f"the memory has no {name!r} yet: set it first, or write a class Memory"
        )


class FailedDecision(Decision):
    """The decision of a step that failed, with its fault in words."""

    fault = ""


class OverTimeError(BaseException):
    """Raised in code that does not end; no `except Exception` of it catches this."""


FAULTS: Final = (Exception, SystemExit)
"""What code of the user's may raise: `sys.exit()` in it must not end the robot or the study."""


class Watch:
    """Interrupts what takes more than its limit of its thread's processor time.

    Time for which a thread waits for a processor does not count, so that no verdict depends on the
    load of the machine.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._steps: dict[int, int] = {}
        """End of the time of the step under way, on the processor clock of its thread (ns)."""

        self._thread: threading.Thread | None = None

    def begin(self, limit_ns: int) -> int:
        """Watch the step that this thread begins; return the processor time in ns."""
        with self._lock:
            now_ns = time.thread_time_ns()
            self._steps[threading.get_ident()] = now_ns + limit_ns
            if self._thread is None:
                self._thread = threading.Thread(target=self._look, name="steps", daemon=True)
                self._thread.start()
            return now_ns

    def end(self) -> int:
        """End it, so that it is not interrupted any more; return the processor time in ns."""
        with self._lock:
            self._steps.pop(threading.get_ident(), None)
            return time.thread_time_ns()

    @contextmanager
    def loading(self) -> Iterator[None]:
        """Watch what is run when a file is loaded."""
        try:
            self.begin(LOAD_LIMIT_NS)
            yield
        finally:
            self.end()

    def _look(self) -> None:
        never = threading.Event()
        while not never.wait(LOOK_S):
            with self._lock:  # a thread that is in a step cannot end
                for thread, end_ns in self._steps.items():
                    clock = time.pthread_getcpuclockid(thread)
                    if time.clock_gettime_ns(clock) > end_ns:
                        ctypes.pythonapi.PyThreadState_SetAsyncExc(
                            ctypes.c_ulong(thread), ctypes.py_object(OverTimeError)
                        )


WATCH: Final = Watch()


class OwnNavigator:
    """A step and a memory of the user's; both fail in words instead of an exception."""

    def __init__(
        self,
        source: OwnSource,
        step: Callable[..., Any],
        memory: Callable[[], Any],
        file: str,
        judges_progress: bool = False,
    ) -> None:
        self.source = source
        self.judges_progress = judges_progress
        self._step = step
        self._memory = memory
        self._file = file
        self.cost_ns = 0
        """Processor time of the newest step."""

        self._line = getattr(getattr(step, "__code__", None), "co_firstlineno", 0)

    def memory(self) -> Any:
        """Return an empty memory; one that cannot be made fails at the first step."""
        try:
            return self._memory()
        except FAULTS as error:
            broken = Memory()
            broken.fault = self._words(error)
            return broken

    def __call__(self, memory: Any, pose: Pose, ring: Ring, goal: Goal, params: Params) -> Decision:
        """Decide for one tick; a failure is a decision with branch FAILED."""
        if isinstance(memory, Memory) and memory.fault:
            return failed(memory.fault)
        try:
            begun_ns = 0
            try:
                begun_ns = WATCH.begin(STEP_LIMIT_NS)
                decision = self._step(memory, pose, ring, goal, params)
            finally:
                self.cost_ns = WATCH.end() - begun_ns
        except OverTimeError as error:
            limit_s = STEP_LIMIT_NS / 1e9
            return failed(
                f"{self._where(error)}: the step has not ended after {limit_s:g} s of processor"
                " time: it is called 20 times a second, so let no loop wait for a change"
            )
        except FAULTS as error:
            return failed(self._words(error))
        fault = fault_of(decision)
        if fault:
            return failed(f"{self._file}, line {self._line}, {self.source.function}: {fault}")
        return decision  # type: ignore[no-any-return]

    def _words(self, error: BaseException) -> str:
        """Return place and text of an exception, with the suggestion of Python."""
        text = "".join(TracebackException.from_exception(error).format_exception_only())
        return f"{self._where(error)}: {(text.strip().splitlines() or [''])[-1]}"

    def _where(self, error: BaseException) -> str:
        """Return file, line and function of the innermost line of the user's file."""
        frames = [(frame.f_code, line) for frame, line in walk_tb(error.__traceback__)]
        own = [(code, line) for code, line in frames if code.co_filename == self._file]
        code, line = (own or frames)[-1]
        return f"{code.co_filename}, line {line}, {code.co_name}"


def failed(fault: str) -> FailedDecision:
    """Return the decision of a step that failed."""
    made = FailedDecision(states.FAILED, None, inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    made.fault = fault
    return made


BRANCHES: Final = frozenset(Branch) - {Branch.NONE, Branch.FAILED}


def fault_of(decision: object) -> str:
    """Return what is wrong with what a step has returned, and a remedy; empty if it is usable."""
    if not isinstance(decision, Decision):
        what = "nothing" if decision is None else f"a value of type {type(decision).__name__}"
        return f"returned {what}: return a Decision, in each branch of the function"
    if decision.branch not in BRANCHES:
        return f"branch {decision.branch!r}: use TO_GOAL, PASS_LEFT, PASS_RIGHT, GIVE_UP or LOST"
    if decision.branch in (states.GIVE_UP, states.LOST):
        return ""
    for name in ("goal_bearing_rad", "rotation_rad", "virtual_x_m", "virtual_y_m"):
        value = getattr(decision, name)
        if not is_number(value) or value - value != 0.0:
            return f"{name} = {value!r}: must be a finite number"
    limit_m_s = decision.speed_limit_m_s
    if not is_number(limit_m_s) or not limit_m_s >= 0.0:
        return f"speed_limit_m_s = {limit_m_s!r}: must be a number from 0 on, or inf for no limit"
    if not is_number(decision.nearest_range_m):
        return f"nearest_range_m = {decision.nearest_range_m!r}: give ring.nearest_m"
    bearing_rad = decision.nearest_bearing_rad
    if bearing_rad is not None and not is_number(bearing_rad):
        return f"nearest_bearing_rad = {bearing_rad!r}: give bearing_rad(ring)"
    return ""


def is_number(value: object) -> bool:
    """Return whether this can be computed with as a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def cost_words() -> str:
    """Return the time of the newest step of the robot's own navigator; empty without one."""
    own = NAVIGATORS[states.OWN].step if states.OWN in NAVIGATORS else None
    if not isinstance(own, OwnNavigator):
        return ""
    return (
        f"a step of {own.source.name} takes {own.cost_ns / 1e6:.1f} ms of processor time; a whole"
        f" control cycle has {TICK_US / 1e3:g} ms"
    )


def fault_in(decision: Decision | None) -> str:
    """Return the fault of a step that failed; empty for any other decision."""
    return decision.fault if isinstance(decision, FailedDecision) else ""


FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {}
"""Those of this program, by name."""


def defined(step: Callable[..., Any]) -> str:
    """Return a reference, for this process only, to a function that serves as a step."""
    name = getattr(step, "__name__", type(step).__name__)
    FUNCTIONS[name] = step
    reference = f"{DEFINED}:{name}"
    own_source(reference)  # refuses a name that is taken
    return reference


def load(reference: str) -> OwnNavigator:
    """Load and check a navigator of the user's own; raise UserError with file, line and remedy."""
    source = own_source(reference)
    if source.place == DEFINED:
        step = FUNCTIONS[source.function]
        code = getattr(step, "__code__", None)
        file = getattr(code, "co_filename", source.function)
        check_signature(step, file)
        return OwnNavigator(source, step, Memory, file)
    module, file = imported(source)
    found = getattr(module, source.function, None)
    if not callable(found):
        functions = filter(inspect.isfunction, vars(module).values())
        near = ", ".join(one.__name__ for one in functions if one.__module__ == module.__name__)
        raise UserError(
            f"{file}: has no function {source.function!r}: write `def {source.function}"
            f"({ARGUMENTS})`" + (f", or name one of {near}, as in {source.place}:NAME" * bool(near))
        )
    check_signature(found, file)
    judges_progress = getattr(module, JUDGES, False) is True
    return OwnNavigator(source, found, memory_of(module, file), file, judges_progress)


def imported(source: OwnSource) -> tuple[ModuleType, str]:
    """Run a file or import a module; return it with its path."""
    folder = str(Path(source.place).parent) if source.is_file else str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # for what it imports; last, so that it shadows nothing
    try:
        if not source.is_file:
            known = sys.modules.get(source.place)
            with WATCH.loading():
                module = importlib.reload(known) if known else importlib.import_module(source.place)
            return module, module.__file__ or source.place
        name = f"own_{source.name}_{sha256(source.place.encode()).hexdigest()[:8]}"
        spec = importlib.util.spec_from_file_location(name, source.place)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # as for an import: dataclasses look it up
        with WATCH.loading():
            spec.loader.exec_module(module)
    except (*FAULTS, OverTimeError) as error:
        raise UserError(refusal(source, error)) from None
    return module, source.place


def refusal(source: OwnSource, error: BaseException) -> str:
    """Return why a file cannot be loaded: place, error, and Python's suggestion."""
    missing = error.name if isinstance(error, ModuleNotFoundError) and error.name else ""
    if not source.is_file and missing and f"{source.place}.".startswith(f"{missing}."):
        return (
            f"{source.place}: there is no such module from {Path.cwd()}: give a file, such as"
            " my_nav.py, or start in the folder of the package"
        )
    text = "".join(TracebackException.from_exception(error).format_exception_only())
    last = (text.strip().splitlines() or [type(error).__name__])[-1]
    if isinstance(error, SyntaxError):
        line = f": `{error.text.strip()}`" if error.text else ""
        where = f", line {error.lineno}" if error.lineno else ""
        return f"{error.filename or source.place}{where}: {last}{line}"
    frames = [(frame.f_code.co_filename, line) for frame, line in walk_tb(error.__traceback__)]
    own = [(file, line) for file, line in frames if not is_ours(file)]
    file, number = own[-1] if own else (source.place, 1)
    if isinstance(error, OverTimeError):
        last = (
            f"has not been loaded after {LOAD_LIMIT_NS / 1e9:g} s of processor time: let no loop"
            " outside of functions wait for a change"
        )
    return f"{file}, line {number}: {last}"


def is_ours(file: str) -> bool:
    """Return whether a frame is of the machinery that loads a file."""
    return file == __file__ or file.startswith("<frozen ")


def check_signature(step: Callable[..., Any], file: str) -> None:
    """Raise UserError unless a function takes what a step is called with."""
    try:
        signature = inspect.signature(step)
    except (TypeError, ValueError):  # made of C
        return
    try:
        signature.bind(*ARGUMENTS.split(", "))
    except TypeError:
        name = getattr(step, "__name__", "step")
        line = getattr(getattr(step, "__code__", None), "co_firstlineno", 1)
        raise UserError(
            f"{file}, line {line}: {name}{signature} does not take ({ARGUMENTS}), with which it is"
            " called"
        ) from None
    if inspect.iscoroutinefunction(step) or inspect.isgeneratorfunction(step):
        raise UserError(f"{file}: step must be a plain `def` that returns a Decision")


def memory_of(module: ModuleType, file: str) -> Callable[[], Any]:
    """Return what makes an empty memory; raise UserError for a class that is none."""
    factory = getattr(module, "Memory", Memory)
    try:
        factory().side = states.LEFT
    except FAULTS as error:
        raise UserError(
            f"{file}: class Memory: {type(error).__name__}: {error}: it must be made without"
            " arguments, and have an attribute `side`"
        ) from None
    made: Callable[[], Any] = factory
    return made


def digest_of(reference: str) -> str:
    """Return the SHA-256 of the file of a navigator."""
    source = own_source(reference)
    if source.place == DEFINED:
        return str(id(FUNCTIONS[source.function]))
    place = source.place if source.is_file else imported(source)[1]
    return sha256(Path(place).read_bytes()).hexdigest()


def install(own: OwnNavigator, number: int = Navigator.OWN) -> None:
    """Make a navigator one of the robot's, under a number."""
    step: NavigatorStep = own
    NAVIGATORS[number] = registry.Navigator(own.memory, step, own.judges_progress)


NUMBERS: Final = count(FIRST_IN_SIMULATION)


@lru_cache(maxsize=64)
def _installed(reference: str, _digest: str) -> int:
    number = next(NUMBERS)
    install(load(reference), number)
    return number


def simulated_number(reference: str) -> int:
    """Load a navigator for trials of this process, once for each version of its file.

    Trials with several navigators may run at the same time, so each has a number of its own.
    """
    return _installed(str(own_source(reference)), digest_of(reference))
