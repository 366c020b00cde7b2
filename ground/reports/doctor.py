"""`doctor`: listens for a moment, asks every service, and says what is missing and what to do."""

from collections.abc import Iterable
from dataclasses import dataclass
from time import time
from typing import Any, ClassVar, Final

from ground.client.diagnosis import Finding, Observed, Stream, examine, installation, lines
from ground.client.diagnosis import Report as Findings
from ground.client.link import Link, UnansweredError
from ground.client.operations import Session
from ground.client.presence import present_processes
from ground.client.telemetry import Telemetry
from ground.reports.report import Report
from protocol.bus.mailbox import Mailbox
from protocol.bus.tls.access import denial
from protocol.bus.tls.certificate import own_certificate
from protocol.topics import COMMAND, CYCLE, PARAMETERS, STATUS, TOPICS, WORLD, Role, Service
from protocol.wire.messages import CommandRequest
from runtime.cli.conflicts import conflicts
from runtime.errors import NotLetIn, PeerHangs, RemoteError
from runtime.units import NS_PER_S

LISTEN_S: Final = 1.0
ASK_S: Final = 0.5
NO_COMMAND: Final = 0
QUESTIONS: Final = ((COMMAND, Role.ROBOT), (PARAMETERS, Role.ROBOT), (WORLD, Role.PLANT))


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnose:
    """Listen for a moment, ask every service, and say what is missing and what to do."""

    verb: ClassVar[str] = "doctor"
    moves: ClassVar[bool] = False
    listen_s: float = LISTEN_S

    def perform(self, session: Session) -> Report:
        seen = observe(session.link, round(self.listen_s * NS_PER_S))
        return told_of(seen, examine(seen))

    def undialled(self, error: UnansweredError, endpoint: str) -> Report:
        """The report when nothing could be dialled."""
        what, do = told(error, endpoint)
        findings = [Finding(what, do), *installation(conflicts())]
        row = {"ok": False, "findings": as_json(findings), "streams": {}}
        return Report(False, lines(findings), row)


def told(error: UnansweredError, endpoint: str) -> tuple[str, str]:
    """What keeps us out, and what to do about it."""
    cause = error.__cause__
    if isinstance(cause, NotLetIn):
        return cause.why, cause.do
    if isinstance(cause, PeerHangs):
        return str(error), f"restart the process at {endpoint}, or use --connect"
    return str(error), f"start `sidestep robot` (or `sidestep router`) at {endpoint}, or --connect"


def observe(link: Link, listen_ns: int) -> Observed:
    """Everything there is to see, within the given time and that of the questions."""
    with link.subscribed(*TOPICS) as telemetry:
        return observed(link, telemetry, listen_ns)


def observed(link: Link, telemetry: Telemetry, listen_ns: int) -> Observed:
    link.wait(lambda: False, listen_ns)
    now_ns = link.clock.now_ns()
    processes = present_processes(link.bus.present())
    status, cycle = telemetry.latest(STATUS), telemetry.latest(CYCLE)
    return Observed(
        robot=link.robot,
        endpoint=link.endpoint,
        processes=processes,
        listened_ns=listen_ns,
        streams=tuple(stream_of(box, now_ns) for box in telemetry.boxes().values()),
        status=None if status is None else status[0],
        cycle=None if cycle is None else cycle[0],
        answers=tuple(
            (service.path, why)
            for service, role in QUESTIONS
            if processes.has(link.robot, role)
            and not denial(link.bus.holder, link.robot, service)
            and (why := unanswered(link, service))
        ),
        certified=own_certificate(link.bus.network.tls) if link.bus.network.tls else None,
        clock_s=time(),
        conflicts=tuple(conflicts()),
    )


def stream_of(box: Mailbox[Any], now_ns: int) -> Stream:
    newest = box.latest()
    age_ns = None if newest is None else now_ns - newest[1]
    return Stream(box.topic, age_ns, box.rejected, box.last_rejection)


def unanswered(link: Link, service: Service) -> str:
    """Why a service does not answer; empty when it does. The question changes nothing."""
    question = None
    if CommandRequest in service.requests:
        question = CommandRequest(
            request_id=link.ids.next(), param1=0.0, param2=0.0, command=NO_COMMAND
        )
    try:
        link.bus.ask(service, question, ASK_S, robot=link.robot)
    except RemoteError as error:
        return str(error)
    return ""


def as_json(findings: Iterable[Finding]) -> list[dict[str, object]]:
    return [{"what": one.what, "do": one.do, "bad": one.bad} for one in findings]


def told_of(seen: Observed, report: Findings) -> Report:
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
    there = ", ".join(sorted(f"{role} of {robot}" for robot, role in seen.processes.present))
    head = f"{'healthy' if report.healthy else 'not healthy'}: {there or 'nobody is there'}"
    text = "\n".join(part for part in (head, lines(report.findings)) if part)
    return Report(report.healthy, text, found)
