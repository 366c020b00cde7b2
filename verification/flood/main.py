"""A robot that drives under attack: does its stop always stop, does its loop keep its period?

Each kind of attack is a run of its own, on an open bus and behind locked doors, there with the
certificates of a viewer, of another robot and of another operator at a time. Attackers are
processes. In each run an operator holds the lease and drives; then the emergency stop of the app is
pressed again and again, from the key to standing wheels, as the plant has it. Attacks that stop the
robot by right, or speak in the operator's name, are held while the robot sets off, and go on at the
very moment of the key. The attackers are on this machine and niced: elsewhere they would not take
the robot's processor.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Final

from protocol.topics import CYCLE, STATUS
from protocol.wire.codec import decode
from protocol.wire.enums import Vehicle
from protocol.wire.messages import CycleReport, NavigatorStatus
from verification.flood.acknowledgements import Shown, unfounded
from verification.flood.attack import Attack, Door
from verification.flood.kinds import ACTED, KINDS
from verification.flood.operator import Operator, Pressed
from verification.harness.certificates import made_keys
from verification.harness.figures import Figure, Report, percentile
from verification.harness.observer import Observer, observed
from verification.harness.process_stats import cpu_s, resident_mb
from verification.harness.until import until

ALONE: Final = "none"
STOPS: Final = "stops"
OPEN, LOCKED = "open", "locked"
OPERATORS: Final = ("anna", "eve")
OPERATOR: Final = "ground-anna"
ROLES: Final = ("viewer", "robot-r2", "ground-eve")
STOP_AT_MOST_MS: Final = 250.0
KIB_PER_MB: Final = 1024


def add_options(parser: argparse.ArgumentParser) -> None:
    kinds = (ALONE, *KINDS)
    says = f"of attack ({', '.join(kinds)})"
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds, help=says, metavar="K")
    doors = (OPEN, LOCKED)
    parser.add_argument("--doors", nargs="+", choices=doors, default=doors, help="(both)")
    says = f"whose certificates attackers have ({', '.join(ROLES)})"
    parser.add_argument("--roles", nargs="+", default=ROLES, help=says, metavar="R")
    parser.add_argument("--seconds", type=float, default=5.0, help="of driving, in each run (5)")
    parser.add_argument("--presses", type=int, default=3, metavar="N", help="in each run (3)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="of each attacker (its kind's)")
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--realtime", action="store_true", help="robot scheduled SCHED_FIFO")


def measure(options: argparse.Namespace) -> Report:
    figures: list[Figure] = []
    notes: list[str] = []
    with TemporaryDirectory(prefix="sidestep-flood-") as folder:
        keys = made_keys(Path(folder) / "keys", OPERATORS) if LOCKED in options.doors else None
        for door in options.doors:
            for kind in options.kinds:
                name = f"{door}, {kind}"
                print(f"{name} ...", file=sys.stderr, flush=True)
                found = run(options, kind, keys if door == LOCKED else None)
                figures += figures_of(name, found)
                notes += notes_of(name, found)
    return Report(benchmark="flood", figures=tuple(figures), notes=tuple(notes))


@dataclass(slots=True)
class Run:
    """What the robot told of its ticks, what its process took, and how fast it stopped."""

    judged: bool = False
    held: bool = False
    broken: str = ""
    reports: list[CycleReport] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    cpu_percent: float = 0.0
    resident_mb: float = 0.0
    grown_mb: float = 0.0
    presses: list[Pressed] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    attacks: list[Attack] = field(default_factory=list)

    @property
    def answers(self) -> Counter[str]:
        """What came of the attackers' questions."""
        found = Counter[str]()
        for attack in self.attacks:
            found.update({word: n for word, n in attack.told.items() if isinstance(n, int)})
        return found

    @property
    def missed(self) -> int:
        return self.reports[-1].missed - self.reports[0].missed

    @property
    def ticks(self) -> int:
        return self.reports[-1].tick - self.reports[0].tick

    def late_ms(self, share: float) -> float:
        return percentile([report.late_us / 1e3 for report in self.reports], share)


def run(options: argparse.Namespace, kind: str, keys: Path | None) -> Run:
    """Drive for so long, then stop in an emergency again and again; with attackers all the time."""
    flags = ["--realtime"] if options.realtime else []
    with (
        observed(options.world, *flags, keys=keys, operator="ground-anna") as observer,
        ExitStack() as scope,
    ):
        found = Run()
        for topic in (CYCLE, STATUS):
            observer.bus.stream(topic, partial(note, found), observer.robot)
        if kind != ALONE:
            found.judged, found.held = KINDS[kind].judged, KINDS[kind].held
            for door in doors(observer, keys, options.roles):
                attack = Attack(kind, door, options.rate)
                found.attacks.append(scope.enter_context(attack))
        operator = Operator(observer)
        operator.take()
        operator.set_off()
        until(lambda: found.reports, "cycle reports")
        found.reports.clear()
        before_mb, begun_s, begun_cpu_s = peak_mb(observer.pid), monotonic(), cpu_s(observer.pid)
        try:
            flood(found, operator, options.seconds)
            for _ in range(options.presses):
                found.presses.append(press(found, operator))
        except RuntimeError as error:  # the run is over, and what there was is told
            found.broken = str(error)
        spent_s = cpu_s(observer.pid) - begun_cpu_s
        found.cpu_percent = 100.0 * spent_s / (monotonic() - begun_s)
        found.resident_mb = resident_mb(observer.pid)
        found.grown_mb = peak_mb(observer.pid) - before_mb
        found.stopped = [] if found.held else operator.stopped
    return found


def doors(observer: Observer, keys: Path | None, roles: Sequence[str]) -> Iterator[Door]:
    """Through which each of the attackers comes."""
    if keys is None:
        yield Door(observer.endpoint)
        return
    for role in roles:
        yield Door(observer.endpoint, keys, role)


def note(found: Run, _key: str, frame: bytes, arrived_ns: int) -> None:
    message = decode(frame).message
    if isinstance(message, CycleReport):
        found.reports.append(message)
    elif isinstance(message, NavigatorStatus):
        found.shown.append(Shown(arrived_ns, message.vehicle == Vehicle.EMERGENCY_STOP))


def flood(found: Run, operator: Operator, seconds: float) -> None:
    """Attack for so long; where it cannot be given orders meanwhile the robot is only watched."""
    tell(found, go=True)
    if found.held:
        operator.wait(seconds)
        tell(found, go=False)
        operator.clear()
    else:
        operator.drive(seconds)


def press(found: Run, operator: Operator) -> Pressed:
    """Set off, press the stop, have it cleared again."""
    operator.set_off()
    if found.held:
        tell(found, go=True)
    pressed = operator.press()
    if found.held:
        tell(found, go=False)
    operator.clear()
    return pressed


def tell(found: Run, *, go: bool) -> None:
    for attack in found.attacks:
        attack.go() if go else attack.hold()


def peak_mb(pid: int) -> float:
    """Return the most resident memory that a process has had."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(status.partition("VmHWM:")[2].split()[0]) / KIB_PER_MB


def figures_of(name: str, found: Run) -> Iterator[Figure]:
    attacked = bool(found.attacks)
    stood_ms = [one.stood_ms for one in found.presses if one.stood_ms is not None]
    if stood_ms:
        yield Figure(name=f"{name}: key to standing", unit="ms", values=tuple(stood_ms))
        worst = f"{name}: key to standing, worst of {len(stood_ms)}"
        yield figure(worst, max(stood_ms), STOP_AT_MOST_MS, "ms")
    told_ms = [one.acknowledged_ms for one in found.presses if one.acknowledged_ms is not None]
    if told_ms:
        yield Figure(name=f"{name}: key to acknowledgement", unit="ms", values=tuple(told_ms))
    never = len(found.presses) - min(len(stood_ms), len(told_ms))
    yield figure(f"{name}: never stood or acknowledged", never, 0.0)
    yield figure(f"{name}: operator could not go on", bool(found.broken), 0.0)
    none = sum(one.was_none for one in found.presses)
    yield figure(f"{name}: acknowledgements that were none", none, 0.0)
    if any(attack.kind == STOPS for attack in found.attacks):
        answers = found.answers[ACTED]
        unmet = sum(unfounded(attack.accepted, found.shown) for attack in found.attacks)
        yield figure(f"{name}: attackers' stops that were none, of {answers}", unmet, 0.0)
    yield figure(f"{name}: ticks missed of {found.ticks}", found.missed, 0.0)
    if attacked and not found.held:
        yield figure(f"{name}: seen stopped", len(found.stopped), 0.0)
    if found.judged:
        yield figure(f"{name}: forged commands acted upon", found.answers[ACTED], 0.0)
    yield figure(f"{name}: late, worst", found.late_ms(1.0), None, "ms")
    yield figure(f"{name}: CPU of one core", found.cpu_percent, None, "%")
    yield figure(f"{name}: resident", found.resident_mb, None, "MB")
    yield figure(f"{name}: grown", found.grown_mb, None, "MB")


def figure(name: str, value: float, at_most: float | None = None, unit: str = "") -> Figure:
    return Figure(name=name, unit=unit, values=(float(value),), at_most=at_most)


def notes_of(name: str, found: Run) -> Iterator[str]:
    for attack in found.attacks:
        told = ", ".join(f"{word} {n}" for word, n in attack.told.items())
        yield f"{name}, {attack.door.role or 'anybody'}: {told or attack.errors}"
    if found.broken:
        yield f"{name}: {found.broken}"
    for words in dict.fromkeys(found.stopped):
        yield f"{name}, stopped: {words}"
