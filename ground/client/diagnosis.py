"""What is wrong with a running system, out of who is there and how old each stream is.

Each finding says what is missing and what to do. Nothing here talks to anybody.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from ground.client.presence import Crew, why_silent
from protocol.bus.tls.access import ALL, barred, grant_of
from protocol.bus.tls.certificate import CertificateStatus
from protocol.topics import CLOCK, COMMAND, HEARTBEAT, OPERATOR, TELEOP, Role, Topic
from protocol.wire.enums import Vehicle
from protocol.wire.messages import CycleReport, NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.cli.packages import Conflict
from runtime.units import NS_PER_MS, NS_PER_S

LATE_FACTOR: Final = 3
PERIODS: Final = 1.5
DAY_S: Final = 86_400.0
SOON_S: Final = 30 * DAY_S


@dataclass(frozen=True, slots=True)
class Stream:
    """One topic as it was seen while listening."""

    topic: Topic[Any]
    age_ns: int | None
    rejected: int = 0
    last_rejection: str = ""

    @property
    def fresh(self) -> bool:
        limit_ns = self.topic.stale_after_ns
        return self.age_ns is not None and (not limit_ns or self.age_ns <= LATE_FACTOR * limit_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """Everything that was seen."""

    robot: str
    endpoint: str
    crew: Crew
    streams: tuple[Stream, ...]
    status: NavigatorStatus | None = None
    cycle: CycleReport | None = None
    answers: tuple[tuple[str, str], ...] = ()  # service path, why it did not answer
    listened_ns: int = 1000 * NS_PER_MS
    certified: CertificateStatus | None = None  # where doors are locked
    clock_s: float = 0.0  # of this machine, since 1970
    conflicts: tuple[Conflict, ...] = ()  # of our packages with those of others


@dataclass(frozen=True, slots=True)
class Finding:
    """`bad`: the system cannot work like this."""

    what: str
    do: str
    bad: bool = True


@dataclass
class Report:
    findings: list[Finding] = field(default_factory=list)

    @property
    def healthy(self) -> bool:
        return not any(finding.bad for finding in self.findings)


def examine(seen: Observed) -> Report:
    """All findings, the most basic first."""
    return Report(
        [
            *installation(seen.conflicts),
            *certificate(seen),
            *processes(seen),
            *streams(seen),
            *services(seen),
            *state(seen.status),
            *pace(seen.cycle),
        ]
    )


def installation(conflicts: Iterable[Conflict]) -> Iterator[Finding]:
    """Packages of others in place of ours, or among them."""
    for conflict in conflicts:
        yield Finding(conflict.what, conflict.do, bad=conflict.wins)


def certificate(seen: Observed) -> Iterator[Finding]:
    """What ours lets us do, and for how long."""
    own = seen.certified
    if own is None:
        return
    grant = grant_of(own.name)
    if why := barred(own.name, seen.robot, COMMAND):
        hears = grant is not None and grant.hears == ALL
        yield Finding(why, "use --config DIR/ground.toml to command", bad=not hears)
    if own.until_s is not None and own.until_s - seen.clock_s < SOON_S:
        days = max(0.0, (own.until_s - seen.clock_s) / DAY_S)
        what = f"the certificate of {own.name} expires in {days:.0f} days"
        yield Finding(what, "make a new set with `sidestep keys new`", bad=False)


def processes(seen: Observed) -> Iterator[Finding]:
    heart = next((stream for stream in seen.streams if stream.topic is HEARTBEAT), None)
    unreadable = heart is not None and heart.age_ns is None and heart.rejected > 0  # told below
    beats = heart is not None and (heart.fresh or unreadable)
    robot_there = seen.crew.has(seen.robot, Role.ROBOT)
    if not robot_there or not beats:
        why = why_silent(seen.crew, seen.robot, seen.endpoint, beats=beats)
        what, _, do = why.partition(": ")
        yield Finding(what, do or "restart the robot")
    if not any(role == Role.PLANT.value for _, role in seen.crew.there):
        yield Finding("no plant is there", "sidestep plant --world box, with the same endpoint")


def streams(seen: Observed) -> Iterator[Finding]:
    """Only of processes that are there: for others their absence is the finding."""
    for stream in seen.streams:
        topic = stream.topic
        if stream.rejected:
            yield rejection(stream)
        if not expected(seen, topic) or stream.fresh or topic is HEARTBEAT:
            continue
        sender = topic.publisher.value
        if stream.age_ns is None and seen.listened_ns * topic.rate_hz < PERIODS * NS_PER_S:
            continue  # it may just not have been its turn
        if stream.age_ns is None:
            yield Finding(f"nothing on {topic.path}", f"is the {sender} paused? else restart it")
        else:
            age = f"{stream.age_ns / NS_PER_MS:.0f} ms"
            yield Finding(f"{topic.path} is {age} old", f"the {sender} hangs or is overloaded")


def rejection(stream: Stream) -> Finding:
    path, times = stream.topic.path, stream.rejected
    what = f"{times} unreadable on {path}, the last one: {stream.last_rejection}"
    if "speaks" in stream.last_rejection:
        return Finding(what, "run the same version of sidestep everywhere")
    return Finding(what, "find out who else writes on this key")


def expected(seen: Observed, topic: Topic[Any]) -> bool:
    """Must this topic be alive, given who is there?"""
    if not topic.rate_hz or topic in (OPERATOR, TELEOP, CLOCK):
        return False
    if topic.publisher is Role.PLANT:
        return any(role == Role.PLANT.value for _, role in seen.crew.there)
    return seen.crew.has(seen.robot, topic.publisher)


def services(seen: Observed) -> Iterator[Finding]:
    for path, why in seen.answers:
        yield Finding(f"{path} does not answer: {why}", "restart the process that serves it")


def state(status: NavigatorStatus | None) -> Iterator[Finding]:
    if status is None:
        return
    reason = reason_text(status.vehicle_reason)
    if status.vehicle == Vehicle.BOOT:
        yield Finding("the robot has no senses yet", "start the plant")
    elif status.vehicle == Vehicle.FAILSAFE:
        yield Finding(f"failsafe: {reason}", "remove the cause, then sidestep arm", bad=False)
    elif status.vehicle == Vehicle.EMERGENCY_STOP:
        do = "sidestep clear-estop, then sidestep arm"
        yield Finding(f"emergency stop: {reason}", do, bad=False)
    elif status.vehicle_reason != Reason.NONE:
        yield Finding(f"vehicle: {reason}", "sidestep watch", bad=False)


def pace(cycle: CycleReport | None) -> Iterator[Finding]:
    if cycle is None:
        return
    if cycle.rejected:
        what = f"the robot could not read {cycle.rejected} frames"
        yield Finding(what, "find out who else writes on its keys", bad=False)
    if cycle.missed:
        what = f"the robot has missed {cycle.missed} of {cycle.tick + 1} ticks"
        yield Finding(what, "other load on the machine? sidestep robot --realtime", bad=False)


def lines(findings: Iterable[Finding]) -> str:
    """For a person: what, then what to do."""
    return "\n".join(
        f"{'E' if finding.bad else 'W'} {finding.what}\n  -> {finding.do}" for finding in findings
    )
