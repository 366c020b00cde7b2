"""`python -m checks.speed.counts`: count the work of the hot paths and compare it with a table.

On a shared machine a time differs by a fifth from one minute to the next. The executed bytecodes
and the called C functions are the same in every run, but for one in 100,000 where the threads of a
bus take part. Both are counted on each path, per tick or per message, and their weighted sum is
compared with `counts.toml`. That has a table for each version of Python, because each compiles to
other bytecodes. A path whose work has grown by more than `TOLERANCE` fails. Where it has become
less by as much, a line asks to commit the gain: otherwise it could be lost again without a failure.

`--accept` writes the figures of this Python into the table. `--functions N` shows the functions
that execute the most bytecodes of each path.

Some work is not seen. A C function counts the same for a long list and a short one, and a class
that is called, such as `tuple(...)`, counts as a bytecode only. The threads of the bus are not
counted, and compiled modules execute no bytecodes.
"""

import argparse
import gc
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final, NamedTuple
from unittest.mock import patch

from checks.harness.in_process import InProcess
from checks.speed.codec import COMPONENT, SYSTEM, sample_messages
from checks.speed.trials import begun_drive, recorded
from plant.process import Process as PlantProcess
from plant.world.file import load
from protocol.navigators import NAVIGATORS
from protocol.wire.codec import Encoder, decode
from protocol.wire.message import Message
from robot.core import brain
from robot.core.values import goal_of
from robot.process import RobotProcess
from runtime.errors import EXIT_USAGE
from runtime.units import PERIOD_S
from study.trial.trial import Trial, run_trial, start_of, wire_goal_of

TABLE: Final = Path(__file__).with_name("counts.toml")
COMMAND: Final = "python -m checks.speed.counts"
VERSION: Final = "{}.{}".format(*sys.version_info)
TOLERANCE: Final = 0.03
CALL_WEIGHT: Final = 5
"""A call of a C function takes about as many machine instructions as so many bytecodes. Cachegrind
counts about 30 for a bytecode, 80 for a call of `sqrt` and 300 for one of `min` or `len`."""

WORLD, DENSE = "forest_medium", "forest_dense"
TICKS: Final = 200
WARM_UP: Final = 20
"""Ticks of the stack after its goal was sent."""

SWITCHES: Final = (sys.settrace, sys.setprofile)


class Work(NamedTuple):
    """The bytecodes and the calls of C functions of one tick or one message."""

    bytecodes: float
    calls: float

    @property
    def total(self) -> float:
        """The weighted sum."""
        return self.bytecodes + CALL_WEIGHT * self.calls


Step = Callable[[FrameType, str, Any], Any]


class WorkCounter:
    """Counts the work of the functions that `run` calls, in this thread."""

    def __init__(self) -> None:
        self._steps: dict[CodeType, tuple[Step, Callable[[], int]]] = {}
        self.calls = 0

    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function, count its work and return what it returns."""
        steps = self._steps

        def enter(frame: FrameType, _event: str, _argument: Any) -> Step:
            step, _ = steps.get(frame.f_code) or steps.setdefault(frame.f_code, counting_step())
            # In this order: Python 3.13 does not trace the bytecodes of a frame without a function.
            frame.f_trace, frame.f_trace_lines, frame.f_trace_opcodes = step, False, True
            return step

        def profile(_: FrameType, event: str, called: Any) -> None:
            self.calls += event == "c_call" and called not in SWITCHES

        before, collects = (sys.gettrace(), sys.getprofile()), gc.isenabled()
        gc.disable()  # the threads of the bus decide when it runs
        # Python 3.12 traces bytecodes only if some frame has asked for it before.
        sys._getframe().f_trace_opcodes = True
        sys.setprofile(profile)
        sys.settrace(enter)
        try:
            return function(*arguments)
        finally:
            sys.settrace(before[0])
            sys.setprofile(before[1])
            if collects:
                gc.enable()

    def bytecodes(self) -> Counter[CodeType]:
        """Return the number of executed bytecodes by the code that contains them."""
        return Counter({code: count() for code, (_, count) in self._steps.items()})


def counting_step() -> tuple[Step, Callable[[], int]]:
    """Return a function that is called at each bytecode, and one that returns how often."""
    count = 0

    def step(_frame: FrameType, event: str, _argument: Any) -> Step:
        nonlocal count
        count += event == "opcode"
        return step

    return step, lambda: count


class CountedPath(NamedTuple):
    """A path: its name, what it was counted for, and how many of these."""

    name: str
    unit: str
    units: int
    counter: WorkCounter

    @property
    def work(self) -> Work:
        """The work of one tick or message."""
        counter = self.counter
        per = (counter.bytecodes().total() / self.units, counter.calls / self.units)
        return Work(*(round(figure, 2) for figure in per))


def counted_paths() -> Iterator[CountedPath]:
    """Count and yield each path."""
    for navigator in NAVIGATORS:
        yield core_step(navigator)
    yield trial()
    yield from stack()
    yield from codec()


def core_step(navigator: str) -> CountedPath:
    """Count the steps of the control core in a recorded drive."""
    world = load(WORLD)
    first, *inputs = recorded(Trial(world=world, navigator=navigator, timeout_s=TICKS * PERIOD_S))
    goal = goal_of(*wire_goal_of(world))
    state, params = begun_drive(first, start_of(world), goal, NAVIGATORS[navigator])
    counter = WorkCounter()
    for one in inputs:
        counter.run(brain.step, state, one, params)
    return CountedPath(f"core step, {navigator}", "tick", len(inputs), counter)


def trial() -> CountedPath:
    """Count a trial with its set-up, without what is computed once for a world."""
    short = Trial(world=load(DENSE), timeout_s=TICKS * PERIOD_S)
    run_trial(short)
    counter = WorkCounter()
    counter.run(run_trial, short)
    return CountedPath("trial", "tick", TICKS, counter)


def stack() -> Iterator[CountedPath]:
    """Count a cycle of the robot and a tick of the plant, with a bus between them."""
    cycle, tick = WorkCounter(), WorkCounter()
    with InProcess(WORLD) as running:
        running.arm()
        running.goto_goal()
        running.forward(WARM_UP * PERIOD_S)
        with (
            counting(cycle, RobotProcess, "cycle"),
            counting(tick, PlantProcess, "publish"),
            counting(tick, PlantProcess, "advance"),
        ):
            running.forward(TICKS * PERIOD_S)
    yield CountedPath("robot cycle", "tick", TICKS, cycle)
    yield CountedPath("plant tick", "tick", TICKS, tick)


def counting(counter: WorkCounter, owner: type, name: str) -> Any:
    """Return a context in which the calls of a method are counted."""
    method = getattr(owner, name)
    return patch.object(owner, name, lambda *arguments: counter.run(method, *arguments))


def codec() -> Iterator[CountedPath]:
    """Count one encoding and one decoding of each message of a tick."""
    encoder = Encoder(SYSTEM, COMPONENT)

    def encode(cls: type[Message], values: dict[str, Any]) -> bytes:
        return encoder.encode(cls(**values))

    for cls, values in sample_messages():
        frame = encode(cls, values)
        decode(frame)
        encoding, decoding = WorkCounter(), WorkCounter()
        encoding.run(encode, cls, values)
        decoding.run(decode, frame)
        yield CountedPath(f"encode {cls.__name__}", "message", 1, encoding)
        yield CountedPath(f"decode {cls.__name__}", "message", 1, decoding)


def read() -> dict[str, dict[str, Work]]:
    """Return the accepted figures of each path, by version of Python."""
    tables = tomllib.loads(TABLE.read_text(encoding="utf-8")) if TABLE.exists() else {}
    return {
        version: {name: Work(**figures) for name, figures in paths.items()}
        for version, paths in tables.items()
    }


def write(tables: Mapping[str, Mapping[str, Work]]) -> None:
    """Write the accepted figures."""
    lines = [f"# Bytecodes and calls of C functions, by version of Python: {COMMAND} --accept"]
    for version, paths in sorted(tables.items()):
        lines += ["", f'["{version}"]']
        for name, work in paths.items():
            figures = f"bytecodes = {work.bytecodes:.2f}, calls = {work.calls:.2f}"
            lines.append(f'"{name}" = {{ {figures} }}')
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")


def compared(
    found: Mapping[str, Work], accepted: Mapping[str, Work]
) -> tuple[list[str], list[str]]:
    """Return what has become worse, and what has become better, a line for each path."""
    worse = [f"{name}: no figure is accepted" for name in found if name not in accepted]
    worse += [f"{name}: is not counted any more" for name in accepted if name not in found]
    better = []
    for name in accepted.keys() & found.keys():
        now, was = found[name], accepted[name]
        change = now.total / was.total - 1.0
        line = (
            f"{name}: {change:+.1%} work, {was.total:.0f} -> {now.total:.0f}"
            f" (bytecodes {was.bytecodes:.0f} -> {now.bytecodes:.0f},"
            f" calls {was.calls:.0f} -> {now.calls:.0f})"
        )
        if change > TOLERANCE:
            worse.append(line)
        elif change < -TOLERANCE:
            better.append(line)
    return sorted(worse), sorted(better)


def shown(path: CountedPath, functions: int) -> Iterator[str]:
    """Yield the work of a path, and its functions with the most bytecodes."""
    work = path.work
    yield (
        f"{path.name:<28} {work.total:>9.1f} per {path.unit:<8}"
        f" {work.bytecodes:>9.1f} bytecodes {work.calls:>7.1f} calls"
    )
    for code, count in path.counter.bytecodes().most_common(functions):
        file = "/".join(Path(code.co_filename).parts[-2:])
        yield f"  {count / path.units:>9.1f} {code.co_qualname} ({file}:{code.co_firstlineno})"


def main(argv: Sequence[str] | None = None) -> int:
    """Count and compare; return 0, or 1 if the work of a path has grown."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--accept", action="store_true", help="write the figures into the table")
    parser.add_argument("--functions", type=int, default=0, metavar="N")
    options = parser.parse_args(argv)
    if not str(brain.__file__).endswith(".py"):
        print(f"{COMMAND}: compiled modules execute no bytecodes", file=sys.stderr)
        return EXIT_USAGE
    tables = read()
    if not (options.accept or options.functions or VERSION in tables):
        print(f"counts: not counted for Python {VERSION}: `{COMMAND} --accept` adds it")
        return 0
    paths = []
    for path in counted_paths():
        paths.append(path)
        print(*shown(path, options.functions), sep="\n", flush=True)
    found = {path.name: path.work for path in paths}
    if options.accept:
        write({**tables, VERSION: found})
        return 0
    worse, better = compared(found, tables.get(VERSION, {}))
    for line in better:
        print(f"counts: {line}: commit this gain, by `{COMMAND} --accept`")
    for line in worse:
        print(f"counts: FAILED: {line}")
    if worse:
        print(f"counts: if this work is worth it, `{COMMAND} --accept` accepts the new figures")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
