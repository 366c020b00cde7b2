"""`doctor`: listen for a moment, call every service, and report faults and remedies."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import time
from typing import Any, ClassVar, Final

from ground.client.link import Link, UnansweredError
from ground.client.operations import Session
from ground.client.telemetry import Telemetry
from ground.reports.doctor_findings import Finding, Observed, Stream, examine, installation, lines
from ground.reports.doctor_findings import Report as Findings
from ground.reports.report import Report
from ground.text.statustext import StatustextAssembler, aged
from protocol.bus.certificate import own_certificate
from protocol.bus.mailbox import Mailbox
from protocol.bus.rights import denial
from protocol.topics import (
    COMMAND,
    CYCLE,
    ODOMETRY,
    PARAMETERS,
    STATUS,
    TEXT,
    TOPICS,
    WORLD,
    Role,
    Service,
)
from protocol.wire.codec import decode
from protocol.wire.messages import CommandRequest
from runtime.cli.conflicts import conflicts
from runtime.errors import AccessDeniedError, PeerHangsError, RemoteError
from runtime.units import NS_PER_S
from runtime.watchdog import slowdown_in

LISTEN_S: Final = 1.0
REQUEST_TIMEOUT_S: Final = 0.5
NO_COMMAND: Final = 0
SERVICES: Final = ((COMMAND, Role.ROBOT), (PARAMETERS, Role.ROBOT), (WORLD, Role.PLANT))


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnose:
    """Listen for `listen_s`, call every service, and report faults and remedies."""

    verb: ClassVar[str] = "doctor"
    moves: ClassVar[bool] = False
    listen_s: float = LISTEN_S

    def perform(self, session: Session) -> Report:
        """Examine the robot's system."""
        seen = observe(session.link, round(self.listen_s * NS_PER_S))
        return report_of(seen, examine(seen))

    def not_connected(self, error: UnansweredError, endpoint: str) -> Report:
        """Return the report for a connection that failed."""
        what, do = dial_fault(error, endpoint)
        findings = [Finding(what, do), *installation(conflicts())]
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


def observe(link: Link, listen_ns: int) -> Observed:
    """Observe all topics for the given time, then call the services."""
    texts, assembler, clock = [], StatustextAssembler(), link.clock

    def take(_key: str, frame: bytes, sent_ns: int) -> None:
        with suppress(RemoteError):
            if text := assembler.receive(decode(frame).message):
                texts.append(aged(text, clock.now_ns() - sent_ns))

    box = link.bus.mailbox(TEXT, link.robot, take=take)
    try:
        with link.subscribed(*TOPICS) as telemetry:
            return observed(link, telemetry, texts, listen_ns)
    finally:
        link.bus.unsubscribe(box)


def observed(link: Link, telemetry: Telemetry, texts: Sequence[str], listen_ns: int) -> Observed:
    """Collect tokens, streams, status and the replies of the services."""
    link.wait(lambda: False, listen_ns)
    now_ns = link.clock.now_ns()
    processes = link.processes()
    status, cycle = telemetry.latest(STATUS), telemetry.latest(CYCLE)
    odometry = telemetry.latest(ODOMETRY)
    return Observed(
        robot=link.robot,
        endpoint=link.endpoint,
        processes=processes,
        listened_ns=listen_ns,
        streams=tuple(stream_of(box, now_ns) for box in telemetry.boxes().values()),
        status=None if status is None else status[0],
        odometry=None if odometry is None else odometry[0],
        cycle=None if cycle is None else cycle[0],
        answers=tuple(
            (service.path, why)
            for service, role in SERVICES
            if processes.has(link.robot, role)
            and not denial(link.bus.holder, link.robot, service)
            and (why := unanswered(link, service))
        ),
        certified=own_certificate(link.bus.network.tls) if link.bus.network.tls else None,
        clock_s=time(),
        conflicts=tuple(conflicts()),
        texts=tuple(texts),
    )


def stream_of(box: Mailbox[Any], now_ns: int) -> Stream:
    """Return the age and the rejections of a mailbox."""
    newest = box.latest()
    age_ns = None if newest is None else now_ns - newest[1]
    return Stream(box.topic, age_ns, box.rejected, box.last_rejection)


def unanswered(link: Link, service: Service) -> str:
    """Return why a service does not answer, empty if it does. The request changes nothing."""
    request = None
    if CommandRequest in service.requests:
        request = CommandRequest(
            request_id=link.ids.next(), param1=0.0, param2=0.0, command=NO_COMMAND
        )
    try:
        timeout_s = REQUEST_TIMEOUT_S * slowdown_in(link.clock)()
        link.bus.ask(service, request, timeout_s, robot=link.robot)
    except RemoteError as error:
        return str(error)
    return ""


def as_json(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """Return the findings as rows."""
    return [{"what": one.what, "do": one.do, "bad": one.bad} for one in findings]


def report_of(seen: Observed, report: Findings) -> Report:
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
