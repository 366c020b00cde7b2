"""Run a verb and cause a fault in its process on SIGUSR1.

`python -m verification.faults_matrix.fault_hook AFFLICTION VERB ...`

The process is the real one: the same main, in the same way. AFFLICTION is JSON: {"hang": {}} is a
C call that keeps the interpreter's lock, {"raise": {}} an exception in the main thread, {"jump":
{"s": 5}} a clock that is ahead from then on, {"trouble": {...}} a bad network, {"sense": {...}} a
fault of the plant, {"fsync": {"s": 2}} a slow
disk. What a module looks up when it starts is replaced here before it does.
"""

import ctypes
import json
import os
import runpy
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import plant.process.run
import robot.run
from ground.launch.child_command import die_with_parent
from plant.model.faults import Fault
from plant.process.loop import Process
from protocol.bus.bus import Bus
from protocol.bus.faults.link_faults import LinkFaults
from runtime.clock import WallClock
from runtime.units import NS_PER_S

FOREVER_S: Final = 1_000_000


class Jumping(WallClock):
    """The monotonic clock, that may jump."""

    ahead_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self.ahead_ns


def hang(_: Mapping[str, Any]) -> Callable[[], object]:
    """Unlike a CDLL, a PyDLL does not let go of the lock: no thread of Python runs any more."""
    library = ctypes.PyDLL(None)
    return lambda: library.sleep(FOREVER_S)


def fail(_: Mapping[str, Any]) -> Callable[[], object]:
    def act() -> None:
        raise ArithmeticError("a defect in the control core")

    return act


def jump(told: Mapping[str, Any]) -> Callable[[], object]:
    clocks: list[Jumping] = []
    keep(robot.run, "WallClock", clocks, Jumping)

    def act() -> None:
        for clock in clocks:
            clock.ahead_ns = round(told["s"] * NS_PER_S)

    return act


def disturb(told: Mapping[str, Any]) -> Callable[[], object]:
    trouble = LinkFaults(**{**told, "paths": tuple(told.get("paths", ()))})
    buses: list[Bus] = []
    for module in (plant.process.run, robot.run):
        keep(module, "open_bus", buses)

    def act() -> None:
        for bus in buses:
            bus.line.disturb(trouble)

    return act


def sense(told: Mapping[str, Any]) -> Callable[[], object]:
    processes: list[Process] = []
    keep(plant.process.run, "Process", processes)

    def act() -> None:
        for process in processes:
            process.plant.inject(Fault(start_s=process.plant.now_ns / NS_PER_S, **told))

    return act


def slow(told: Mapping[str, Any]) -> Callable[[], object]:
    whole, clock = os.fsync, WallClock()

    def fsync(number: int) -> None:
        clock.sleep_until(clock.now_ns() + round(told["s"] * NS_PER_S))
        whole(number)

    def act() -> None:
        os.fsync = fsync  # type: ignore[assignment]

    return act


def keep(module: Any, name: str, into: list[Any], make: Callable[..., Any] | None = None) -> None:
    """Whatever this name of a module makes from now on is kept in the list, too."""
    usual = make or getattr(module, name)

    def made(*words: Any, **more: Any) -> Any:
        into.append(usual(*words, **more))
        return into[-1]

    setattr(module, name, made)


AFFLICTIONS: Final[Mapping[str, Callable[[Mapping[str, Any]], Callable[[], object]]]] = {
    "hang": hang,
    "raise": fail,
    "jump": jump,
    "trouble": disturb,
    "sense": sense,
    "fsync": slow,
}


def main(argv: Sequence[str]) -> int:
    """The exit code of the verb; it ends with whoever started it."""
    parent, affliction, *words = argv
    if not die_with_parent(int(parent)):
        return 1
    ((name, told),) = json.loads(affliction).items()
    act = AFFLICTIONS[name](told)
    signal.signal(signal.SIGUSR1, lambda *_: act())
    sys.argv[:] = ["sidestep", *words]
    runpy.run_module("sidestep", run_name="__main__")  # the executable, which nobody imports
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
