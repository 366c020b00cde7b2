"""`doctor`: listen for a moment, call every service, and report faults and remedies.

Faults are found in liveliness tokens and in the age of each stream, without I/O.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from time import time
from typing import Any, Final

from ground.client.outcomes import Report
from ground.client.parameter import parameters_in
from ground.client.presence import (
    PresentProcesses,
    explain_silence,
    explain_standstill,
    present_processes,
)
from ground.client.requests import NO_COMMAND, RequestIds
from ground.client.robot_link import UnansweredError
from ground.client.status_line import knows_place
from ground.client.telemetry import Telemetry
from ground.commands.command import OperatorCommand, command, option, seconds
from ground.robot import Robot
from ground.text.wording import aged
from protocol.bus.certificate import EXPIRES_SOON, RENEW, CertificateStatus, own_certificate, remedy
from protocol.bus.mailbox import Mailbox
from protocol.bus.peers import ID_TAKEN
from protocol.bus.rights import RECORDER, VIEWER, denial
from protocol.ring import SONARS
from protocol.topics import (
    CLOCK,
    COMMAND,
    CYCLE,
    HEARTBEAT,
    MCU,
    MOTION,
    ODOMETRY,
    OPERATOR,
    PARAMETERS,
    SONAR,
    STATUS,
    TELEOP,
    TEXT,
    TOPICS,
    WHEELS,
    WORLD,
    Role,
    Service,
    Topic,
)
from protocol.wire.codec import decode
from protocol.wire.enums import Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from protocol.wire.reasons import Reason, reason_text
from protocol.wire.statustext import StatustextAssembler
from runtime.cli.packages import Conflict, conflicts
from runtime.cli.verb import LOOK
from runtime.errors import AccessDeniedError, PeerHangsError, RemoteError
from runtime.units import NS_PER_MS, NS_PER_S, PERIOD_MS
from runtime.watchdog import slowdown_in

STALE_FACTOR: Final = 3
MIN_PERIODS: Final = 1.5
DAY_S: Final = 86_400.0
SENSES: Final = (SONAR, WHEELS)
"""What a driver publishes, and a plant too."""
MIN_SCANS: Final = 10
DENSE_MS: Final = 2 * PERIOD_MS
"""What is necessary if each sonar measures in each period."""


@dataclass(frozen=True, slots=True)
class ObservedTopic:
    """One topic, as observed while listening; `age_ns` is None if nothing has arrived."""

    topic: Topic[Any]
    age_ns: int | None
    rejected: int = 0
    last_rejection: str = ""

    @property
    def fresh(self) -> bool:
        """True if a message arrived within three times the topic's stale-after."""
        limit_ns = self.topic.stale_after_ns
        return self.age_ns is not None and (not limit_ns or self.age_ns <= STALE_FACTOR * limit_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """All observations of one run of `doctor`.

    `keys` is the configuration file on a locked bus.
    `answers` holds pairs of service path and the reason why it did not answer. `certified` is the
    certificate of this process on a bus with TLS. `clock_s` is this machine's time since 1970.
    `texts` are those of the robot, cached ones included. `scans` are all that arrived, and
    `sonar_stale_ms` is that parameter of the robot.
    """

    robot: str
    endpoint: str
    processes: PresentProcesses
    streams: tuple[ObservedTopic, ...]
    status: NavigatorStatus | None = None
    odometry: PlanarOdometry | None = None
    cycle: CycleReport | None = None
    answers: tuple[tuple[str, str], ...] = ()
    listened_ns: int = 1000 * NS_PER_MS
    certified: CertificateStatus | None = None
    clock_s: float = 0.0
    conflicts: tuple[Conflict, ...] = ()
    texts: tuple[str, ...] = ()
    scans: tuple[SonarScan, ...] = ()
    sonar_stale_ms: float | None = None
    keys: str | None = None


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One fault and its remedy; `bad` if the system cannot work with it."""

    what: str
    do: str
    bad: bool = True


@dataclass
class Diagnoses:
    """All findings of one examination."""

    findings: list[Diagnosis] = field(default_factory=list)

    @property
    def healthy(self) -> bool:
        """True if no finding is bad."""
        return not any(finding.bad for finding in self.findings)


def examine(seen: Observed) -> Diagnoses:
    """Return all findings, the most basic first."""
    return Diagnoses(
        [
            *installation(seen.conflicts),
            *certificate(seen),
            *taken_ids(seen.texts),
            *processes(seen),
            *streams(seen),
            *sonars(seen),
            *services(seen),
            *state(seen.status),
            *place(seen.odometry),
            *pace(seen.cycle),
        ]
    )


def installation(conflicts: Iterable[Conflict]) -> Iterator[Diagnosis]:
    """Yield Python packages that shadow ours or mix with them."""
    for conflict in conflicts:
        yield Diagnosis(conflict.what, conflict.do, bad=conflict.wins)


def certificate(seen: Observed) -> Iterator[Diagnosis]:
    """Yield findings about this process's certificate: its rights and its expiry."""
    own = seen.certified
    if own is None:
        return
    if own.name and (why := denial(own.name, seen.robot, COMMAND)):
        observes = own.name in (VIEWER, RECORDER)
        yield Diagnosis(why, "use --config DIR/ground.toml to command", bad=not observes)
    if own.trouble:
        yield Diagnosis(own.trouble, remedy(own), bad=True)
    elif own.until_s is not None and own.until_s - seen.clock_s < EXPIRES_SOON.total_seconds():
        days = max(0.0, (own.until_s - seen.clock_s) / DAY_S)
        what = f"the certificate of {own.name} expires in {days:.0f} days"
        yield Diagnosis(what, RENEW, bad=False)


def taken_ids(texts: Iterable[str]) -> Iterator[Diagnosis]:
    """Yield the links that used the session id of another certificate."""
    for text in dict.fromkeys(texts):
        if text.startswith(ID_TAKEN):
            do = (
                "find out who has the key of the certificate that is named first, and `sidestep "
                "keys revoke` it; if it is the rightful one, it opens a fresh session by itself"
            )
            yield Diagnosis(text, do, bad=False)


def stands(seen: Observed) -> bool:
    """Return whether no simulated time passes for the robot: it sends its heartbeat, no status."""
    fresh = {one.topic.path: one.fresh or one.rejected > 0 for one in seen.streams}
    is_there = seen.processes.has(seen.robot, Role.ROBOT) and fresh.get(HEARTBEAT.path, False)
    return is_there and not fresh.get(STATUS.path, True)


def processes(seen: Observed) -> Iterator[Diagnosis]:
    """Yield the processes that are missing or hang, or that simulated time stands still."""
    if stands(seen):
        why = explain_standstill(seen.processes, seen.robot, seen.endpoint, seen.keys)
        what, _, do = why.partition(": ")
        yield Diagnosis(what, do)
        return
    heartbeat = next((stream for stream in seen.streams if stream.topic is HEARTBEAT), None)
    unreadable = (
        heartbeat is not None and heartbeat.age_ns is None and heartbeat.rejected > 0
    )  # reported as a stream
    is_beating = heartbeat is not None and (heartbeat.fresh or unreadable)
    has_robot = seen.processes.has(seen.robot, Role.ROBOT)
    if not has_robot or not is_beating:
        why = explain_silence(
            seen.processes, seen.robot, seen.endpoint, is_beating=is_beating, keys=seen.keys
        )
        what, _, do = why.partition(": ")
        yield Diagnosis(what, do or "restart the robot")
    if not has_plant(seen) and not seen.processes.has(seen.robot, Role.DRIVER):
        do = (
            "start `sidestep run plant --world W` with the same endpoint, W being the robot's"
            " world, or the driver of a real robot"
        )
        yield Diagnosis("no plant is running", do)


def has_plant(seen: Observed) -> bool:
    """Return whether a plant runs; one simulates all robots of a world."""
    return any(role == Role.PLANT.value for _, role in seen.processes.present)


def sonars(seen: Observed) -> Iterator[Diagnosis]:
    """Yield sonars that do not measure, and that ranges count as missing between two of one sonar.

    The sonars of a real ring ping one after the other, so that each scan has a part of them. The
    median tells the firing order from single pings that are lost.
    """
    if len(seen.scans) < MIN_SCANS:
        return
    times_ms = [
        [scan.time_ns // NS_PER_MS for scan in seen.scans if scan.valid >> i & 1]
        for i in range(SONARS)
    ]
    if silent := [str(i) for i, times in enumerate(times_ms) if not times]:
        what = f"no measurement of sonar {', '.join(silent)} in {len(seen.scans)} scans"
        yield Diagnosis(what, "check its wiring: the robot does not see there", bad=False)
    gaps_ms = [
        sorted(later - at for at, later in pairwise(times))[(len(times) - 1) // 2]
        for times in times_ms
        if times[1:]
    ]
    need_ms = (round(max(gaps_ms, default=0) / PERIOD_MS) + 1) * PERIOD_MS
    if seen.sonar_stale_ms is not None and gaps_ms and need_ms > max(seen.sonar_stale_ms, DENSE_MS):
        what = (
            f"each sonar measures every {need_ms - PERIOD_MS} ms, and its range counts as missing "
            f"after {seen.sonar_stale_ms:g} ms"
        )
        do = (
            f"set sonar_stale_ms = {need_ms} below [parameters] of the robot's file, and restart it"
        )
        yield Diagnosis(what, do, bad=False)


def streams(seen: Observed) -> Iterator[Diagnosis]:
    """Yield streams that are missing, late or unreadable.

    A stream whose publisher does not run is left out: that process is a finding already.
    """
    has_time = not stands(seen)
    for stream in seen.streams:
        topic = stream.topic
        if stream.rejected:
            yield rejection(stream)
        if not (has_time and expected(seen, topic)) or stream.fresh or topic is HEARTBEAT:
            continue
        sender = topic.publisher.value
        if topic in SENSES and not has_plant(seen):
            sender = Role.DRIVER.value
        if stream.age_ns is None and seen.listened_ns * topic.rate_hz < MIN_PERIODS * NS_PER_S:
            continue  # too slow for this listening time
        if stream.age_ns is None:
            yield Diagnosis(f"nothing on {topic.path}", f"restart the {sender} unless it is paused")
        else:
            age = f"{stream.age_ns / NS_PER_MS:.0f} ms"
            yield Diagnosis(f"{topic.path} is {age} old", f"the {sender} is slow or hangs")


def rejection(stream: ObservedTopic) -> Diagnosis:
    """Return the finding about unreadable messages on a topic."""
    path, times = stream.topic.path, stream.rejected
    what = f"{times} unreadable messages on {path}, the last: {stream.last_rejection}"
    if "has dialect" in stream.last_rejection:
        return Diagnosis(what, "run the same version of sidestep everywhere")
    return Diagnosis(what, "find the other process that publishes on this key")


def expected(seen: Observed, topic: Topic[Any]) -> bool:
    """Return whether a topic must be alive, given the processes that run.

    Only a robot whose core runs on a board publishes MCU; MOTION is of plants that share a world.
    """
    if not topic.rate_hz or topic in (OPERATOR, TELEOP, CLOCK, MCU, MOTION):
        return False
    if topic.publisher is Role.PLANT:
        is_driven = topic in SENSES and seen.processes.has(seen.robot, Role.DRIVER)
        return is_driven or has_plant(seen)
    return seen.processes.has(seen.robot, topic.publisher)


def services(seen: Observed) -> Iterator[Diagnosis]:
    """Yield services that did not answer."""
    for path, why in seen.answers:
        yield Diagnosis(f"{path} does not answer: {why}", "restart the process that serves it")


def state(status: NavigatorStatus | None) -> Iterator[Diagnosis]:
    """Yield what the vehicle state asks the operator to do."""
    if status is None:
        return
    reason = reason_text(status.vehicle_reason)
    if status.vehicle == Vehicle.BOOT:
        do = "start the plant, or the driver of a real robot"
        yield Diagnosis("the robot has received no sensor data yet", do)
    elif status.vehicle == Vehicle.FAILSAFE:
        yield Diagnosis(f"failsafe: {reason}", "remove the cause, then sidestep arm", bad=False)
    elif status.vehicle == Vehicle.EMERGENCY_STOP:
        do = "sidestep clear-estop, then sidestep arm"
        yield Diagnosis(f"emergency stop: {reason}", do, bad=False)
    elif status.vehicle_reason != Reason.NONE:
        yield Diagnosis(f"vehicle: {reason}", "sidestep watch", bad=False)


def place(odometry: PlanarOdometry | None) -> Iterator[Diagnosis]:
    """Yield that the robot does not know its place."""
    if odometry is not None and not knows_place(odometry):
        do = "sidestep pose set X Y DEG, or sidestep pose truth in a simulation"
        yield Diagnosis("the robot does not know where it is", do, bad=False)


def pace(cycle: CycleReport | None) -> Iterator[Diagnosis]:
    """Yield ticks that the control loop missed, and frames that it rejected."""
    if cycle is None:
        return
    if cycle.rejected:
        what = f"the robot rejected {cycle.rejected} unreadable frames"
        yield Diagnosis(what, "find the other process that publishes on its keys", bad=False)
    if cycle.missed:
        what = f"the robot has missed {cycle.missed} of {cycle.tick + 1} ticks"
        yield Diagnosis(
            what, "reduce other load on the machine, or start the robot with --realtime", bad=False
        )


def lines(findings: Iterable[Diagnosis]) -> str:
    """Format findings for a person: each fault, then its remedy."""
    return "\n".join(
        f"{'E' if finding.bad else 'W'} {finding.what}\n  -> {finding.do}" for finding in findings
    )


LISTEN_S: Final = 1.0
REQUEST_TIMEOUT_S: Final = 0.5
SERVICES: Final = ((COMMAND, Role.ROBOT), (PARAMETERS, Role.ROBOT), (WORLD, Role.PLANT))


@command(LOOK, 30, "doctor --timeout 5")
class Diagnose(OperatorCommand):
    """Find problems, and how to fix them."""

    listen_s: float = option(
        "--timeout",
        default=LISTEN_S,
        parse=seconds,
        metavar="S",
        help=f"listen for this time (default {LISTEN_S:g})",
        after="json",
    )

    async def perform(self, robot: Robot) -> Report:
        """Listen, call every service, and report faults and remedies."""
        seen = await observe(robot, round(self.listen_s * NS_PER_S))
        return report_of(seen, examine(seen))

    def not_connected(self, error: UnansweredError, endpoint: str) -> Report:
        """Return the report for a connection that failed."""
        what, do = dial_fault(error, endpoint)
        findings = [Diagnosis(what, do), *installation(conflicts())]
        row = {"ok": False, "findings": as_json(findings), "streams": {}}
        return Report(False, lines(findings), row)


def dial_fault(error: UnansweredError, endpoint: str) -> tuple[str, str]:
    """Return the fault of a failed connection, and its remedy."""
    cause = error.__cause__
    if isinstance(cause, AccessDeniedError):
        return cause.why, cause.do
    if isinstance(cause, PeerHangsError):
        return str(error), f"restart the process at {endpoint}, or use --connect"
    return str(
        error
    ), f"start `sidestep run robot` (or `sidestep run router`) at {endpoint}, or --connect"


async def observe(robot: Robot, listen_ns: int) -> Observed:
    """Observe all topics for the given time, then call the services."""
    texts, assembler, clock = [], StatustextAssembler(), robot.clock
    scans: list[SonarScan] = []

    def take(_key: str, frame: bytes, sent_ns: int) -> None:
        with suppress(RemoteError):
            if text := assembler.receive(decode(frame).message):
                texts.append(aged(text, clock.now_ns() - sent_ns))

    def take_scan(_key: str, frame: bytes, _sent_ns: int) -> None:
        with suppress(RemoteError):
            if isinstance(scan := decode(frame).message, SonarScan):
                scans.append(scan)

    text_box = robot.bus.mailbox(TEXT, robot.name, take=take)
    scan_box = robot.bus.mailbox(SONAR, robot.name, take=take_scan)
    try:
        with robot.subscribed(*TOPICS) as telemetry:
            return await observed(robot, telemetry, texts, scans, listen_ns)
    finally:
        robot.bus.unsubscribe(text_box)
        robot.bus.unsubscribe(scan_box)


async def observed(
    robot: Robot,
    telemetry: Telemetry,
    texts: Sequence[str],
    scans: Sequence[SonarScan],
    listen_ns: int,
) -> Observed:
    """Collect tokens, streams, status and the replies of the services."""
    await robot.wait(lambda: False, listen_ns)
    now_ns = robot.clock.now_ns()
    processes = present_processes(await robot.in_own_thread(robot.bus.present))
    status, cycle = telemetry.latest(STATUS), telemetry.latest(CYCLE)
    odometry = telemetry.latest(ODOMETRY)
    answers = {
        service: await answered(robot, service)
        for service, role in SERVICES
        if processes.has(robot.name, role) and not denial(robot.bus.holder, robot.name, service)
    }
    return Observed(
        robot=robot.name,
        endpoint=robot.endpoint,
        processes=processes,
        listened_ns=listen_ns,
        streams=tuple(stream_of(box, now_ns) for box in telemetry.boxes().values()),
        status=None if status is None else status[0],
        odometry=None if odometry is None else odometry[0],
        cycle=None if cycle is None else cycle[0],
        answers=tuple(
            (service.path, str(why))
            for service, why in answers.items()
            if isinstance(why, RemoteError)
        ),
        certified=own_certificate(robot.bus.network.tls) if robot.bus.network.tls else None,
        clock_s=time(),
        conflicts=tuple(conflicts()),
        texts=tuple(texts),
        scans=tuple(scans),
        sonar_stale_ms=stale_ms_in(answers.get(PARAMETERS)),
        keys=robot.common.keys,
    )


def stream_of(box: Mailbox[Any], now_ns: int) -> ObservedTopic:
    """Return the age and the rejections of a mailbox."""
    newest = box.latest()
    age_ns = None if newest is None else now_ns - newest[1]
    return ObservedTopic(box.topic, age_ns, box.rejected, box.last_rejection)


def stale_ms_in(answer: Message | bytes | RemoteError | None) -> float | None:
    """Return `sonar_stale_ms` of the robot's list of parameters, None without a valid list."""
    with suppress(RemoteError):
        if isinstance(answer, bytes):
            return next(
                (one.value for one in parameters_in(answer) if one.name == "sonar_stale_ms"), None
            )
    return None


async def answered(robot: Robot, service: Service) -> Message | bytes | RemoteError:
    """Return the answer of a service, or why there is none. The request changes nothing."""
    request = None
    if CommandRequest in service.requests:
        request = CommandRequest(
            request_id=RequestIds().next(), param1=0.0, param2=0.0, command=NO_COMMAND
        )
    timeout_s = REQUEST_TIMEOUT_S * slowdown_in(robot.clock)()
    try:
        return await robot.in_own_thread(
            lambda: robot.bus.ask(service, request, timeout_s, robot=robot.name)
        )
    except RemoteError as error:
        return error


def as_json(findings: Iterable[Diagnosis]) -> list[dict[str, object]]:
    """Return the findings as rows."""
    return [{"what": one.what, "do": one.do, "bad": one.bad} for one in findings]


def report_of(seen: Observed, report: Diagnoses) -> Report:
    """Return the report of an examination."""
    found: dict[str, object] = {
        "ok": report.healthy,
        "robot": seen.robot,
        "processes": sorted(f"{role} {robot}" for robot, role in seen.processes.present),
        "findings": as_json(report.findings),
        "streams": {
            stream.topic.path: None if stream.age_ns is None else stream.age_ns / NS_PER_S
            for stream in seen.streams
        },
    }
    present = ", ".join(sorted(f"{role} of {robot}" for robot, role in seen.processes.present))
    head = f"{'healthy' if report.healthy else 'not healthy'}: {present or 'no process is running'}"
    text = "\n".join(part for part in (head, lines(report.findings)) if part)
    return Report(report.healthy, text, found)
