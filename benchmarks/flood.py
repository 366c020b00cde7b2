"""A robot that drives, left alone and then under attack: does its control loop keep its period?

The attack: frames at 10,000 a second (recorded ones, broken ones, noise) on its senses, its
operator's heartbeat and teleop; questions (commands of strangers, nonsense, megabytes); and two
hundred connections. An operator holds the lease. Both runs are made in one call, on one machine.
The attackers are on it, too, and niced: elsewhere they would not take the robot's processor.
"""

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count, cycle
from threading import Event
from time import monotonic, monotonic_ns
from typing import Final

from benchmarks.figures import Figure, Report, percentile
from benchmarks.flood_attack import ACTED, BEAT, CONNECTIONS, REFUSED
from benchmarks.observed import Observer, observed, until
from benchmarks.robot import cpu_s, resident_mb
from protocol.codec import decode
from protocol.enums import Command, LeaseAction, Mode, Vehicle
from protocol.errors import NoAnswer
from protocol.messages import CommandRequest, CycleReport, GoalRequest, LeaseRequest
from protocol.reasons import reason_text
from protocol.timing import CONTROL_HZ
from protocol.topics import COMMAND, CYCLE, LEASE_SERVICE, OPERATOR
from protocol.wire_goal import wire_goal

RATE_HZ: Final = 10_000.0
ASKED_HZ: Final = 500.0
MORE_SHARE: Final = 0.01
BEAT_S: Final = 0.2
PRESS_S: Final = 10.0
AGAIN_S: Final = 0.25
ESTOP_AT_MOST_MS: Final = 500.0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=20.0, help="of each of the two runs")
    parser.add_argument("--rate", type=float, default=RATE_HZ, metavar="HZ", help="frames a second")
    parser.add_argument("--presses", type=int, default=10, metavar="N", help="emergency stops")
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--realtime", action="store_true", help="robot scheduled SCHED_FIFO")


def measure(options: argparse.Namespace) -> Report:
    idle = run(options, attacked=False)
    flood = run(options, attacked=True)
    return Report(benchmark="flood", figures=figures_of(idle, flood), notes=notes_of(flood))


@dataclass(slots=True)
class Run:
    """What the robot told of its ticks, what its process took, and how fast it stopped."""

    reports: list[CycleReport] = field(default_factory=list)
    heard_s: list[float] = field(default_factory=list)
    cpu_percent: float = 0.0
    resident_mb: float = 0.0
    estops_ms: list[float] = field(default_factory=list)
    shots: list[dict[str, object]] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)

    @property
    def answers(self) -> Counter[str]:
        """What came of the attackers' questions."""
        found = Counter[str]()
        for shot in self.shots:
            found.update({word: n for word, n in shot.items() if isinstance(n, int)})
        return found

    @property
    def missed(self) -> int:
        return self.reports[-1].missed - self.reports[0].missed

    @property
    def ticks(self) -> int:
        return self.reports[-1].tick - self.reports[0].tick

    @property
    def rate_hz(self) -> float:
        """Of the ticks that were made, by the clock of whoever heard of them."""
        return (len(self.heard_s) - 1) / (self.heard_s[-1] - self.heard_s[0])

    def late_us(self, share: float) -> float:
        return percentile([float(report.late_us) for report in self.reports], share)


def run(options: argparse.Namespace, *, attacked: bool) -> Run:
    """Drive for so long, then stop in an emergency again and again; with attackers all the time."""
    found, flags = Run(), ["--realtime"] if options.realtime else []
    with observed(options.world, *flags) as observer, ExitStack() as scope:
        crowd: list[subprocess.Popen[str]] = []
        if attacked:
            crowd = scope.enter_context(attackers(observer.endpoint, options.rate, found))
        operator = Operator(observer)
        operator.take()
        operator.set_off()
        for attacking in crowd:
            begin(attacking)
        observer.bus.stream(CYCLE, lambda _key, frame, _ns: note(found, frame), observer.robot)
        until(lambda: found.reports, "cycle reports")
        found.reports.clear()
        found.heard_s.clear()
        begun_s, begun_cpu_s = monotonic(), cpu_s(observer.pid)
        while monotonic() < begun_s + options.seconds:
            operator.keep_on(found)
        spent_s = cpu_s(observer.pid) - begun_cpu_s
        found.cpu_percent = 100.0 * spent_s / (monotonic() - begun_s)
        found.resident_mb = resident_mb(observer.pid)
        found.estops_ms = [operator.press() for _ in range(options.presses)]
    return found


def note(found: Run, frame: bytes) -> None:
    message = decode(frame).message
    if isinstance(message, CycleReport):
        found.reports.append(message)
        found.heard_s.append(monotonic())


class Operator:
    """Holds the lease, beats its heart, and keeps the robot going to and fro."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._bus = observer.bus
        self._beat = observer.bus.publisher(OPERATOR, observer.robot)
        start, goal = observer.world.start, observer.world.goal
        self._places = cycle([(goal.x_m, goal.y_m), (start.x_m, start.y_m)])
        self._requests = count(monotonic_ns())
        self._pause = Event()

    def take(self) -> None:
        self._observer.ask(
            LEASE_SERVICE,
            lambda n: LeaseRequest(request_id=n, action=LeaseAction.TAKE, name="anna"),
        )

    def set_off(self) -> None:
        """Towards the other end of the world, unless it is on its way."""
        self._beat.put(BEAT)
        if not self._observer.on_its_way:
            place = wire_goal(*next(self._places), None, 0.1, 0.1)._asdict()
            self._ask(arm(next(self._requests)))
            self._ask(GoalRequest(request_id=next(self._requests), mode=Mode.GUIDED, **place))

    def keep_on(self, found: Run) -> None:
        """A heartbeat; what stopped the robot is noted, and it sets off again."""
        self._beat.put(BEAT)
        self._pause.wait(BEAT_S)
        status = self._observer.status
        if status.vehicle != Vehicle.ACTIVE:
            why = reason_text(status.vehicle_reason)
            found.stopped.append(f"{Vehicle(status.vehicle).name} {why}")
        self.set_off()

    def press(self) -> float:
        """From the press to the robot's own word that it has stopped, ms; then it is cleared.

        Asked again until it is acknowledged, as the app does.
        """
        self.set_off()
        pressed_s = monotonic()
        while self._observer.status.vehicle != Vehicle.EMERGENCY_STOP:
            if monotonic() > pressed_s + PRESS_S:
                raise RuntimeError(f"no emergency stop within {PRESS_S:g} s")
            self._ask(order(next(self._requests), Command.DO_FLIGHTTERMINATION))
        took_ms = (monotonic() - pressed_s) * 1e3
        while self._observer.status.vehicle == Vehicle.EMERGENCY_STOP:
            self._ask(order(next(self._requests), Command.SIDESTEP_CLEAR_EMERGENCY_STOP))
        return took_ms

    def _ask(self, request: CommandRequest | GoalRequest) -> None:
        self._beat.put(BEAT)
        with suppress(NoAnswer):
            self._bus.ask(COMMAND, request, AGAIN_S, self._observer.robot)


def order(request_id: int, command: Command, param1: float = 0.0) -> CommandRequest:
    return CommandRequest(request_id=request_id, param1=param1, param2=0.0, command=command)


def arm(request_id: int) -> CommandRequest:
    return order(request_id, Command.COMPONENT_ARM_DISARM, 1.0)


@contextmanager
def attackers(endpoint: str, rate_hz: float, found: Run) -> Iterator[list["subprocess.Popen[str]"]]:
    """All of them, connected and waiting; at the end what each has sent is noted."""
    kinds = (("frames", rate_hz), ("questions", ASKED_HZ), ("connections", 50.0))
    with ExitStack() as scope:
        children = [scope.enter_context(attacker(kind, endpoint, hz)) for kind, hz in kinds]
        try:
            yield children
        finally:
            for child in children:
                child.terminate()
            told = [child.communicate()[0] for child in children]
            found.shots = [json.loads(line) for line in told if line]


def attacker(kind: str, endpoint: str, rate_hz: float) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "benchmarks.flood_attack", kind, endpoint, str(rate_hz)]
    child = subprocess.Popen(
        ["nice", *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stderr is not None
    if "ready" not in child.stderr.readline():
        raise RuntimeError(f"the attacker ({kind}) did not get in")
    return child


def begin(child: "subprocess.Popen[str]") -> None:
    assert child.stdin is not None
    child.stdin.write("\n")
    child.stdin.flush()


def figures_of(idle: Run, flood: Run) -> tuple[Figure, ...]:
    allowed = idle.missed + MORE_SHARE * flood.ticks
    found = [
        Figure(name="alone, missed ticks", unit="", values=(float(idle.missed),)),
        Figure(
            name="attacked, missed ticks",
            unit="",
            values=(float(flood.missed),),
            at_most=allowed,
        ),
        Figure(
            name="attacked, ticks a second",
            unit="Hz",
            values=(flood.rate_hz,),
            at_least=(1.0 - MORE_SHARE) * CONTROL_HZ,
            at_most=(1.0 + MORE_SHARE) * CONTROL_HZ,
        ),
        Figure(
            name="attacked, emergency stop",
            unit="ms",
            values=tuple(flood.estops_ms),
            at_most=ESTOP_AT_MOST_MS,
        ),
        Figure(
            name="attacked, seen stopped",
            unit="",
            values=(float(len(flood.stopped)),),
            at_most=0.0,
        ),
    ]
    for name, word, most in (("acted upon", ACTED, 0.0), ("refused", REFUSED, None)):
        value = (float(flood.answers[word]),)
        found.append(Figure(name=f"forged commands {name}", unit="", values=value, at_most=most))
    for name, one in (("alone", idle), ("attacked", flood)):
        found += [
            Figure(name=f"{name}, ticks", unit="", values=(float(one.ticks),)),
            Figure(name=f"{name}, late p50", unit="us", values=(one.late_us(0.5),)),
            Figure(name=f"{name}, late p99", unit="us", values=(one.late_us(0.99),)),
            Figure(name=f"{name}, late max", unit="us", values=(one.late_us(1.0),)),
            Figure(name=f"{name}, CPU of one core", unit="%", values=(one.cpu_percent,)),
            Figure(name=f"{name}, resident", unit="MB", values=(one.resident_mb,)),
        ]
    found.append(Figure(name="alone, emergency stop", unit="ms", values=tuple(idle.estops_ms)))
    return tuple(found)


def notes_of(flood: Run) -> tuple[str, ...]:
    shots = [", ".join(f"{k} {v}" for k, v in one.items()) for one in flood.shots]
    stopped = [f"stopped: {words}" for words in dict.fromkeys(flood.stopped)]
    return (f"{CONNECTIONS} connections at a time", *shots, *stopped)
