"""Measure whether a robot under attack still stops at once and keeps its control period.

Each kind of attack is a run of its own, on an open bus and with access control, there with the
certificates of a viewer, of another robot and of another operator at a time. Attackers are
processes. In each run an operator holds the lease and drives; then the operator presses the
emergency stop of the app repeatedly. Measured is the time from the key to wheels at rest, by the
plant's samples. Strangers without a certificate, which only keep new sessions out, call from an
address of their own; there each stop is that of a fresh `estop`, from the start of its process on.

Attacks that may rightfully stop the robot, or that use the operator's name, pause while the robot
sets off and resume when the key is pressed. The attackers run on this machine at a lower priority:
elsewhere they would not take the robot's processor.
"""

import argparse
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from time import monotonic, monotonic_ns
from typing import Any, Final, NamedTuple

from checks.flood.attackers import (
    ACTED,
    KINDS,
    RATES_HZ,
    SOURCE,
    Access,
    Attack,
    StopStatus,
    Strangers,
    unfounded,
)
from checks.harness.figures import BenchmarkReport, Figure, figure, percentile
from checks.harness.observer import HOLDS, Observer, Seen, motion_since, observed, stood_s
from checks.harness.operator import ThreadedOperator
from checks.harness.processes import cpu_s, made_keys, resident_mb
from checks.harness.until import until
from ground.client.goal import destination
from ground.client.outcomes import Answer
from ground.launch.child_command import command
from protocol.topics import CYCLE, STATUS
from protocol.wire.codec import decode
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import CycleReport, NavigatorStatus
from protocol.wire.reasons import reason_text
from runtime.errors import RemoteError
from runtime.units import NS_PER_S, PERIOD_S

LOOK_S: Final = 0.2
PRESS_S: Final = 10.0
AGAIN_S: Final = 0.75
"""Longest wait for an answer, in three attempts."""
FAST_M_S: Final = 0.2
SETS_OFF_S: Final = 20.0
STANDS_S: Final = 1.0
"""A robot that still moves this long after the acknowledgement has not stopped."""


class StopTimes(NamedTuple):
    """The times from a key press until the wheels stopped and until the acknowledgement.

    None means never. `seen_ms` is the time of the newest sample of the robot's motion.
    """

    stood_ms: float | None
    acknowledged_ms: float | None
    seen_ms: float

    @property
    def is_false_acknowledgement(self) -> bool:
        """True if the stop was acknowledged although the robot did not stop."""
        if self.acknowledged_ms is None:
            return False
        over_ms = self.acknowledged_ms + STANDS_S * 1e3
        return self.seen_ms > over_ms and (self.stood_ms is None or self.stood_ms > over_ms)


class DrivingOperator(ThreadedOperator):
    """Drives the robot to and fro between the start of the world and its goal.

    After an emergency stop the robot continues to the same end, because turning takes long. After
    a failsafe, such as contact with a tree, it drives to the other end.
    """

    def __init__(self, observer: Observer) -> None:
        super().__init__(observer.bus, observer.robot, "anna")
        self.stopped: list[str] = []
        """The reasons of stops that the operator did not command."""
        self._observer = observer
        start, goal = observer.world.start, observer.world.goal
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])
        self._place = next(self._places)
        self._pause = Event()

    def take_lease(self) -> None:
        """Take the lease."""
        until(lambda: self._ask(self.robot.lease.take()), "the lease", PRESS_S)

    def set_off(self) -> None:
        """Command a goal until the robot drives fast.

        Clear the emergency stop repeatedly: a stop of an attacker may arrive after the last
        clearing.
        """
        deadline_s = monotonic() + SETS_OFF_S
        while not (self._observer.on_its_way and self._observer.speed_m_s > FAST_M_S):
            if monotonic() > deadline_s:
                raise RuntimeError(f"the robot does not drive: {self._observer.status}")
            self.clear()
            self.go_on()
            self._pause.wait(0.02)

    def go_on(self) -> None:
        """Send a goal unless the robot drives to one."""
        if not self._observer.on_its_way:
            status = self._observer.status
            ended = status.goal in (GoalState.REACHED, GoalState.STUCK)
            if ended or status.vehicle == Vehicle.FAILSAFE:
                self._place = next(self._places)
            goal = destination([*self._place], position_tolerance_m=0.1)
            self._ask(self.robot.arm(timeout_s=AGAIN_S))
            self._ask(self.send_goal(goal))

    def drive(self, seconds: float) -> None:
        """Keep the robot driving for a time; note why it stopped, and set off again."""
        until_s = monotonic() + seconds
        while monotonic() < until_s:
            self._pause.wait(LOOK_S)
            self.note()
            self.go_on()

    def press(self) -> StopTimes:
        """Press the stop as the app does, and wait until the robot is at rest."""
        self.note()
        pressed_ns = monotonic_ns()
        outcome = self.wait(self.robot.emergency_stop(timeout_s=PRESS_S)).stop
        return self._times(pressed_ns, outcome.took_ns, is_acknowledged=outcome.acknowledged)

    def press_elsewhere(
        self, key: Callable[[], int], acknowledged: Callable[[], bool]
    ) -> StopTimes:
        """Press a key of another program; wait until it shows the end and the robot is at rest.

        `key` returns when it was pressed.
        """
        self.note()
        pressed_ns = key()
        until_ns = pressed_ns + round(PRESS_S * NS_PER_S)
        while not (shown := acknowledged()) and monotonic_ns() < until_ns:
            self._pause.wait(PERIOD_S / 10)
        return self._times(pressed_ns, monotonic_ns() - pressed_ns, is_acknowledged=shown)

    def press_freshly(self, words: Sequence[str]) -> StopTimes:
        """Stop by an `estop` that is started now, and wait until the robot is at rest."""
        self.note()
        started_ns = monotonic_ns()
        with subprocess.Popen(
            command(("estop", *words), os.getpid()),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process:
            while process.poll() is None:
                self._pause.wait(PERIOD_S / 10)
        took_ns = monotonic_ns() - started_ns
        return self._times(started_ns, took_ns, is_acknowledged=process.returncode == 0)

    def _times(self, pressed_ns: int, took_ns: int, *, is_acknowledged: bool) -> StopTimes:
        """Wait until the robot is at rest after a stop that took so long."""
        enough_s = took_ns / NS_PER_S + STANDS_S + HOLDS * PERIOD_S
        until_s = monotonic() + PRESS_S
        seen = motion_since(self._observer.truths, pressed_ns)
        while stood_s(seen) is None and seen_s(seen) <= enough_s and monotonic() < until_s:
            self._pause.wait(PERIOD_S)
            seen = motion_since(self._observer.truths, pressed_ns)
        found = stood_s(seen)
        return StopTimes(
            None if found is None else found * 1e3,
            took_ns / 1e6 if is_acknowledged else None,
            seen_s(seen) * 1e3,
        )

    def clear(self) -> None:
        """Clear the emergency stop; RuntimeError when the robot stays in it."""
        deadline_s = monotonic() + PRESS_S
        while self._observer.status.vehicle == Vehicle.EMERGENCY_STOP:
            if monotonic() > deadline_s:
                raise RuntimeError("the emergency stop cannot be cleared")
            shown = self._observer.status.stop_id
            self._ask(self.robot.clear_emergency_stop(shown, timeout_s=AGAIN_S))
            self._pause.wait(PERIOD_S)

    def note(self) -> None:
        """Note why the robot has stopped, if it has."""
        status = self._observer.status
        if status.vehicle != Vehicle.ACTIVE:
            why = reason_text(status.vehicle_reason)
            self.stopped.append(f"{Vehicle(status.vehicle).name} {why}")

    def _ask(self, work: Coroutine[Any, Any, Answer]) -> bool:
        """Return whether the robot accepts it; no answer is no success."""
        with suppress(RemoteError):
            return self.wait(work).ok
        return False


def seen_s(seen: Sequence[Seen]) -> float:
    """Return the time of the newest sample of the robot's motion."""
    return seen[-1].at_s if seen else 0.0


ALONE: Final = "none"
STOPS: Final = "stops"
OPEN, LOCKED = "open", "locked"
OPERATORS: Final = ("anna", "eve")
OPERATOR_NAME: Final = "ground-anna"
ROLES: Final = ("viewer", "robot-r2", "ground-eve")
STOP_AT_MOST_MS: Final = 250.0
FRESH_AT_MOST_MS: Final = 1000.0
KIB_PER_MB: Final = 1024


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench flood`."""
    kinds = (ALONE, *KINDS, *RATES_HZ)
    text = f"kinds of attack ({', '.join(kinds)})"
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds, help=text, metavar="K")
    doors = (OPEN, LOCKED)
    parser.add_argument("--doors", nargs="+", choices=doors, default=doors, help="(both)")
    text = f"roles whose certificates the attackers have ({', '.join(ROLES)})"
    parser.add_argument("--roles", nargs="+", default=ROLES, help=text, metavar="R")
    parser.add_argument("--seconds", type=float, default=5.0, help="driving time of each run (5)")
    parser.add_argument("--presses", type=int, default=3, metavar="N", help="stops per run (3)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="rate per attacker (its kind's)")
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--realtime", action="store_true", help="robot scheduled SCHED_FIFO")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Run each kind of attack and report its figures."""
    figures: list[Figure] = []
    notes: list[str] = []
    with TemporaryDirectory(prefix="sidestep-flood-") as folder:
        keys = made_keys(Path(folder) / "keys", OPERATORS) if LOCKED in options.doors else None
        for door in options.doors:
            for kind in options.kinds:
                if door == OPEN and kind in KINDS and KINDS[kind].locked_only:
                    continue
                name = f"{door}, {kind}"
                print(f"{name} ...", file=sys.stderr, flush=True)
                found = run(options, kind, keys if door == LOCKED else None)
                figures += figures_of(name, found)
                notes += notes_of(name, found)
    return BenchmarkReport(benchmark="flood", figures=tuple(figures), notes=tuple(notes))


@dataclass(slots=True)
class FloodRun:
    """The robot's cycle reports, the cost of its process and its emergency stops in a run."""

    judged: bool = False
    pauses: bool = False
    broken: str = ""
    reports: list[CycleReport] = field(default_factory=list)
    shown: list[StopStatus] = field(default_factory=list)
    cpu_percent: float = 0.0
    resident_mb: float = 0.0
    grown_mb: float = 0.0
    presses: list[StopTimes] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    attacks: list[Attack] = field(default_factory=list)
    strangers: Strangers | None = None

    @property
    def answers(self) -> Counter[str]:
        """The answers to all attackers, by outcome."""
        found = Counter[str]()
        for attack in self.attacks:
            found.update({word: n for word, n in attack.summary.items() if isinstance(n, int)})
        return found

    @property
    def missed(self) -> int:
        """The number of control periods that were missed."""
        return self.reports[-1].missed - self.reports[0].missed

    @property
    def ticks(self) -> int:
        """The number of control periods."""
        return self.reports[-1].tick - self.reports[0].tick

    def late_ms(self, share: float) -> float:
        """Return a percentile of the lateness of ticks."""
        return percentile([report.late_us / 1e3 for report in self.reports], share)


def run(options: argparse.Namespace, kind: str, keys: Path | None) -> FloodRun:
    """Drive under attack for a time, then press the emergency stop repeatedly."""
    flags = ["--realtime"] if options.realtime else []
    with (
        observed(options.world, *flags, keys=keys, operator="ground-anna") as observer,
        ExitStack() as scope,
    ):
        found = FloodRun()
        for topic in (CYCLE, STATUS):
            observer.bus.stream(topic, partial(note, found), observer.robot)
        # Ends after the attacks: it leaves the lease then, and an open robot obeys whoever asks.
        operator = scope.enter_context(DrivingOperator(observer))
        if kind in RATES_HZ:
            rate_hz = RATES_HZ[kind] if options.rate is None else options.rate
            found.strangers = Strangers(observer.endpoint, kind, rate_hz, SOURCE)
        elif kind != ALONE:
            found.judged, found.pauses = KINDS[kind].judged, KINDS[kind].pauses
            for access in accesses(observer, keys, options.roles):
                attack = Attack(kind, access, options.rate)
                found.attacks.append(scope.enter_context(attack))
        operator.take_lease()
        operator.set_off()
        until(lambda: found.reports, "cycle reports")
        found.reports.clear()
        before_mb, begun_s, begun_cpu_s = peak_mb(observer.pid), monotonic(), cpu_s(observer.pid)
        if found.strangers is not None:
            scope.enter_context(found.strangers)
        words = ["--connect", observer.endpoint, "--id", observer.robot]
        words += [] if keys is None else ["--config", str(keys / f"{OPERATOR_NAME}.toml")]
        try:
            flood(found, operator, options.seconds)
            for _ in range(options.presses):
                found.presses.append(press(found, operator, words))
        except RuntimeError as error:  # report what was measured until then
            found.broken = str(error)
        spent_s = cpu_s(observer.pid) - begun_cpu_s
        found.cpu_percent = 100.0 * spent_s / (monotonic() - begun_s)
        found.resident_mb = resident_mb(observer.pid)
        found.grown_mb = peak_mb(observer.pid) - before_mb
        found.stopped = [] if found.pauses else operator.stopped
    return found


def accesses(observer: Observer, keys: Path | None, roles: Sequence[str]) -> Iterator[Access]:
    """Yield the access of each attacker: one without a certificate, or one per role."""
    if keys is None:
        yield Access(observer.endpoint)
        return
    for role in roles:
        yield Access(observer.endpoint, keys, role)


def note(found: FloodRun, _key: str, frame: bytes, arrived_ns: int) -> None:
    """Keep a cycle report or a status."""
    message = decode(frame).message
    if isinstance(message, CycleReport):
        found.reports.append(message)
    elif isinstance(message, NavigatorStatus):
        found.shown.append(StopStatus(arrived_ns, message.vehicle == Vehicle.EMERGENCY_STOP))


def flood(found: FloodRun, operator: DrivingOperator, seconds: float) -> None:
    """Attack for a time; the robot drives, or is only observed if the attack must pause."""
    switch(found, on=True)
    if found.pauses:
        Event().wait(seconds)
        switch(found, on=False)
        operator.clear()
    else:
        operator.drive(seconds)


def press(found: FloodRun, operator: DrivingOperator, words: Sequence[str]) -> StopTimes:
    """Set off, press the emergency stop and clear it.

    Strangers can only keep new sessions out. So the stop is that of a fresh `estop` with these
    words then.
    """
    operator.set_off()
    if found.strangers is not None:
        times = operator.press_freshly(words)
        operator.clear()
        return times
    if found.pauses:
        switch(found, on=True)
    times = operator.press()
    if found.pauses:
        switch(found, on=False)
    operator.clear()
    return times


def switch(found: FloodRun, *, on: bool) -> None:
    """Resume or pause all attacks."""
    for attack in found.attacks:
        attack.go() if on else attack.hold()


def peak_mb(pid: int) -> float:
    """Return the peak resident memory of a process in MiB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(status.partition("VmHWM:")[2].split()[0]) / KIB_PER_MB


def figures_of(name: str, found: FloodRun) -> Iterator[Figure]:
    """Yield the figures of a run."""
    attacked = bool(found.attacks) or found.strangers is not None
    key, at_most_ms = "key", STOP_AT_MOST_MS
    if found.strangers is not None:
        key, at_most_ms = "start of estop", FRESH_AT_MOST_MS
    stood_ms = [one.stood_ms for one in found.presses if one.stood_ms is not None]
    if stood_ms:
        yield figure(f"{name}: {key} to standstill", stood_ms, "ms")
        worst = f"{name}: {key} to standstill, worst of {len(stood_ms)}"
        yield figure(worst, max(stood_ms), "ms", at_most=at_most_ms)
    answered_ms = [one.acknowledged_ms for one in found.presses if one.acknowledged_ms is not None]
    if answered_ms:
        named = f"{name}: {key} to acknowledgement"
        yield figure(named, answered_ms, "ms")
    never = len(found.presses) - min(len(stood_ms), len(answered_ms))
    yield figure(f"{name}: never stopped or acknowledged", never, at_most=0.0)
    yield figure(f"{name}: operator had to give up", bool(found.broken), at_most=0.0)
    false = sum(one.is_false_acknowledgement for one in found.presses)
    yield figure(f"{name}: false acknowledgements", false, at_most=0.0)
    if any(attack.kind == STOPS for attack in found.attacks):
        answers = found.answers[ACTED]
        unmet = sum(unfounded(attack.accepted, found.shown) for attack in found.attacks)
        yield figure(
            f"{name}: false acknowledgements to attackers, of {answers}", unmet, at_most=0.0
        )
    yield figure(f"{name}: ticks missed of {found.ticks}", found.missed, at_most=0.0)
    if attacked and not found.pauses:
        yield figure(f"{name}: unexpected stops", len(found.stopped), at_most=0.0)
    if found.judged:
        yield figure(f"{name}: forged commands acted upon", found.answers[ACTED], at_most=0.0)
    yield figure(f"{name}: late, worst", found.late_ms(1.0), "ms")
    yield figure(f"{name}: CPU of one core", found.cpu_percent, "%")
    yield figure(f"{name}: resident", found.resident_mb, "MB")
    yield figure(f"{name}: grown", found.grown_mb, "MB")


def notes_of(name: str, found: FloodRun) -> Iterator[str]:
    """Yield what the attackers sent and received, and why the robot stopped unexpectedly."""
    for attack in found.attacks:
        counts = ", ".join(f"{word} {n}" for word, n in attack.summary.items())
        yield f"{name}, {attack.access.role or 'no certificate'}: {counts or attack.errors}"
    if found.strangers is not None:
        yield f"{name}: {found.strangers.called} connections"
    if found.broken:
        yield f"{name}: {found.broken}"
    for words in dict.fromkeys(found.stopped):
        yield f"{name}, stopped: {words}"
