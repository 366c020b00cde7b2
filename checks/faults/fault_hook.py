"""Run a verb and cause a fault in its process on SIGUSR1.

`python -m checks.faults.fault_hook PARENT INJECTION VERB ...` runs the same main as
the real process. INJECTION is JSON with one entry: {"hang": {}} blocks in a C call that holds the
GIL, {"raise": {}} raises an exception in the main thread, {"jump": {"s": 5}} sets the clock ahead,
{"trouble": {...}} disturbs the network, {"sense": {...}} injects a fault into the plant, {"fsync":
{"s": 2}} slows the disk down. Names that a module looks up at its start are replaced here before it
starts.
"""

import ctypes
import json
import os
import runpy
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import plant.process
import robot.run
from ground.launch.child_command import die_with_parent
from plant.model.configuration import Fault
from plant.process import Process
from protocol.bus.bus import Bus
from protocol.bus.link_faults import LinkFaults
from runtime.clock import WallClock
from runtime.units import NS_PER_S

FOREVER_S: Final = 1_000_000


class JumpingClock(WallClock):
    """A monotonic clock that may jump."""

    ahead_ns = 0

    def now_ns(self) -> int:
        """Return the monotonic time plus the jump."""
        return super().now_ns() + self.ahead_ns


def hang(_: Mapping[str, Any]) -> Callable[[], object]:
    """Block all Python threads: unlike a CDLL, a PyDLL holds the GIL during a call."""
    library = ctypes.PyDLL(None)
    return lambda: library.sleep(FOREVER_S)


def fail(_: Mapping[str, Any]) -> Callable[[], object]:
    """Raise an exception."""

    def act() -> None:
        raise ArithmeticError("a defect in the control core")

    return act


def jump(options: Mapping[str, Any]) -> Callable[[], object]:
    """Set the clock of the robot ahead."""
    clocks: list[JumpingClock] = []
    keep(robot.run, "WallClock", clocks, JumpingClock)

    def act() -> None:
        for clock in clocks:
            clock.ahead_ns = round(options["s"] * NS_PER_S)

    return act


def disturb(options: Mapping[str, Any]) -> Callable[[], object]:
    """Disturb the network of the process."""
    trouble = LinkFaults(**{**options, "paths": tuple(options.get("paths", ()))})
    buses: list[Bus] = []
    for module in (plant.process, robot.run):
        keep(module, "open_bus", buses)

    def act() -> None:
        for bus in buses:
            bus.faults.disturb(trouble)

    return act


def sense(options: Mapping[str, Any]) -> Callable[[], object]:
    """Inject a fault into the plant."""
    processes: list[Process] = []
    keep(plant.process, "Process", processes)

    def act() -> None:
        for process in processes:
            process.plant.inject(Fault(start_s=process.plant.now_ns / NS_PER_S, **options))

    return act


def slow(options: Mapping[str, Any]) -> Callable[[], object]:
    """Slow down each fsync."""
    whole, clock = os.fsync, WallClock()

    def fsync(number: int) -> None:
        clock.sleep_until(clock.now_ns() + round(options["s"] * NS_PER_S))
        whole(number)

    def act() -> None:
        os.fsync = fsync  # type: ignore[assignment]

    return act


def keep(module: Any, name: str, into: list[Any], make: Callable[..., Any] | None = None) -> None:
    """Replace a factory in a module by one that also appends what it makes to a list."""
    usual = make or getattr(module, name)

    def made(*words: Any, **more: Any) -> Any:
        into.append(usual(*words, **more))
        return into[-1]

    setattr(module, name, made)


INJECTIONS: Final[Mapping[str, Callable[[Mapping[str, Any]], Callable[[], object]]]] = {
    "hang": hang,
    "raise": fail,
    "jump": jump,
    "trouble": disturb,
    "sense": sense,
    "fsync": slow,
}


def main(argv: Sequence[str]) -> int:
    """Run the verb and return its exit code; the process ends with its parent."""
    parent, injection, *words = argv
    if not die_with_parent(int(parent)):
        return 1
    ((name, options),) = json.loads(injection).items()
    act = INJECTIONS[name](options)
    signal.signal(signal.SIGUSR1, lambda *_: act())
    sys.argv[:] = ["sidestep", *words]
    runpy.run_module("sidestep", run_name="__main__")  # the executable, which no module imports
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
