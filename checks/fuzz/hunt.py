"""Run inputs through a decoder, and keep those that crash, hang or take too much memory."""

import faulthandler
import os
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from types import FrameType, MappingProxyType
from typing import Final, NamedTuple

from checks.fuzz.gateway.targets import GATEWAY
from checks.fuzz.keys import KEYS
from checks.fuzz.logs import LOGS
from checks.fuzz.missions import MISSION
from checks.fuzz.settings import SETTING
from checks.fuzz.target import FuzzTarget
from checks.fuzz.typed import TYPED
from checks.fuzz.wire import WIRE
from checks.fuzz.worlds import WORLDS

TARGETS: Final[Mapping[str, FuzzTarget]] = MappingProxyType(
    {one.name: one for one in (*WIRE, *WORLDS, *MISSION, *SETTING, *LOGS, *TYPED, *KEYS, *GATEWAY)}
)
"""Every place that reads bytes of other programs or of users."""

LONGEST_S: Final = 5.0
"""Limit of the CPU time of one input; a megabyte of TOML takes its parser 2 s."""

MOST_MB: Final = 256.0
DEAD_S: Final = 60.0
"""Limit of wall time, after which the process is killed because the alarm had no effect."""

ARMED_S: Final = 5.0
KB: Final = 1024.0


class CpuTimeError(BaseException):
    """An input took too much CPU time. A BaseException, so that decoders do not catch it."""


class Finding(NamedTuple):
    """A defect and its input; `where` is the same for the same defect."""

    target: str
    number: int
    what: str
    where: str
    data: bytes


@dataclass(slots=True)
class FuzzTally:
    """The results of a block of inputs."""

    target: str
    inputs: int = 0
    accepted: int = 0
    cpu_s: float = 0.0
    finds: list[Finding] = field(default_factory=list)


def hunt(name: str, seed: int, begin: int, end: int) -> FuzzTally:
    """Try the inputs of these numbers; called in a process of its own."""
    target, tally = TARGETS[name], FuzzTally(name)
    begun_s, armed_s = cpu_s(), -inf
    with TemporaryDirectory() as folder, silence(), watch():
        for index in range(begin, end):
            if monotonic() - armed_s > ARMED_S:
                faulthandler.dump_traceback_later(DEAD_S, exit=True)
                armed_s = monotonic()
            data = target.input(seed, index)
            what, where = try_input(target, data, Path(folder), tally)
            tally.inputs += 1
            if what:
                tally.finds.append(Finding(name, index, what, where, data))
    tally.cpu_s = cpu_s() - begun_s
    faulthandler.cancel_dump_traceback_later()
    return tally


def try_input(target: FuzzTarget, data: bytes, folder: Path, tally: FuzzTally) -> tuple[str, str]:
    """Return the defect and its place; empty if the input was accepted or properly refused."""
    before_mb = peak_mb()
    try:
        with limited(LONGEST_S):
            tally.accepted += target.accepts(data, folder)
    except KeyboardInterrupt:
        raise
    except CpuTimeError as error:
        return f"hangs: more than {LONGEST_S:g} s of CPU", place_of(error)
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:300], place_of(error)
    grown_mb = peak_mb() - before_mb
    return (f"takes {grown_mb:.0f} MB", "memory") if grown_mb > MOST_MB else ("", "")


def place_of(error: BaseException) -> str:
    """Return the innermost line of the project, and the type of the error."""
    root = str(Path(__file__).parents[2])
    ours = [
        one
        for one in traceback.extract_tb(error.__traceback__)
        if one.filename.startswith(root) and one.filename != __file__
    ]
    last = ours[-1] if ours else None
    place = "nowhere" if last is None else f"{Path(last.filename).relative_to(root)}:{last.lineno}"
    return f"{place} {type(error).__name__}"


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Limit the CPU time, which does not depend on the load of the machine."""
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)


@contextmanager
def watch() -> Iterator[None]:
    """Raise at the alarm, treat warnings as errors, and limit the memory."""

    def too_long(_number: int, _frame: FrameType | None) -> None:
        raise CpuTimeError

    before = signal.signal(signal.SIGVTALRM, too_long)
    limits = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (4 << 30, limits[1]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, limits)
        signal.signal(signal.SIGVTALRM, before)


@contextmanager
def silence() -> Iterator[None]:
    """Discard the output of decoders."""
    sys.stdout.flush()
    before, nowhere = (os.dup(1), os.dup(2)), os.open(os.devnull, os.O_WRONLY)
    try:
        for number in (1, 2):
            os.dup2(nowhere, number)
        yield
    finally:
        for number, old in enumerate(before, start=1):
            os.dup2(old, number)
            os.close(old)
        os.close(nowhere)


def cpu_s() -> float:
    """Return the CPU time of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def peak_mb() -> float:
    """Return the peak memory of this process in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KB
