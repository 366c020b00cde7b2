"""One request after the other; the lease and a beat of the heart come before what moves."""

from collections.abc import Callable
from enum import Enum
from typing import Final, NamedTuple

from ground.client.link import run_exchange
from ground.client.requests import CommandExchange, RequestIds
from ground.client.results import Accepted, Refused
from ground.station.bus_protocols import ReadableBus
from ground.station.robot.background_requests import Job, JobResult, RequestWorker, outcome_of
from ground.station.robot.lease_holding import LeaseHolding
from protocol.topics import LEASE_SERVICE
from protocol.wire.enums import LeaseAction, Severity
from protocol.wire.limits import MAX_OPERATOR_NAME_BYTES
from protocol.wire.messages import LeaseRequest
from protocol.wire.reasons import reason_text
from runtime.clock import Clock
from runtime.units import NS_PER_MS

Tell = Callable[[str, Severity], None]
ATTEMPTS: Final = 3
PATIENCE_NS: Final = 400 * NS_PER_MS
DONE: Final = {
    LeaseAction.TAKE: "taken",
    LeaseAction.RELEASE: "released",
    LeaseAction.SEIZE: "SEIZED",
}


class CommandStage(Enum):
    TAKING = "taking the lease"
    SETTLING = "letting the robot hear its operator"
    RUNNING = "running"
    LEASE = "asking for or giving back the lease"


class Pending(NamedTuple):
    """What is under way, for which robot."""

    words: str
    robot: str
    tenure: LeaseHolding
    job: Job | None
    stage: CommandStage
    action: LeaseAction | None = None


class CommandQueue:
    """`last` is what was last asked and what came of it."""

    def __init__(
        self, bus: ReadableBus, clock: Clock, lane: RequestWorker, tell: Tell, name: str
    ) -> None:
        self.last = ""
        self._bus = bus
        self._clock = clock
        self._lane = lane
        self._tell = tell
        self._name = name.encode()[:MAX_OPERATOR_NAME_BYTES].decode(errors="ignore")
        self._ids = RequestIds()
        self._pending: Pending | None = None

    @property
    def busy(self) -> str:
        return "" if self._pending is None else self._pending.words

    def submit(
        self, words: str, robot: str, tenure: LeaseHolding, job: Job, *, moves: bool
    ) -> bool:
        """Begin; False, told, when another one is under way."""
        if self._engaged(words):
            return False
        if moves and not tenure.ours:
            self._ask_lease(
                Pending(words, robot, tenure, job, CommandStage.TAKING), LeaseAction.TAKE
            )
        elif moves and not tenure.settled(self._clock.now_ns()):
            self._pending = Pending(words, robot, tenure, job, CommandStage.SETTLING)
        else:
            self._run(Pending(words, robot, tenure, job, CommandStage.RUNNING), job)
        return True

    def lease(self, robot: str, tenure: LeaseHolding, action: LeaseAction) -> bool:
        """Ask for the lease, or give it back: then the heart stops at once."""
        words = f"lease {action.name.lower()}"
        if self._engaged(words):
            return False
        if action is LeaseAction.RELEASE:
            tenure.given_up(self._clock.now_ns())
        self._ask_lease(Pending(words, robot, tenure, None, CommandStage.LEASE, action), action)
        return True

    def request(self, action: LeaseAction) -> LeaseRequest:
        return LeaseRequest(request_id=self._ids.next(), action=action, name=self._name)

    def last_release(self, robot: str, tenure: LeaseHolding) -> JobResult:
        """Give the lease back at the end, once, here and now; call it in a thread."""
        tenure.given_up(self._clock.now_ns())
        request = self.request(LeaseAction.RELEASE)
        return outcome_of(lambda: ask_lease(self._bus, self._clock, robot, request, attempts=1))

    def poll(self, now_ns: int) -> None:
        """Go on with what is under way; its end is told."""
        pending = self._pending
        if pending is None:
            return
        if pending.stage is CommandStage.SETTLING:
            self._settle(pending, now_ns)
            return
        outcome = self._lane.done()
        if outcome is None:
            return
        self._pending = None
        self._ended(pending, outcome, now_ns)

    def _engaged(self, words: str) -> bool:
        if self._pending is None:
            return False
        self._tell(f"not sent: {words}: `{self._pending.words}` is under way", Severity.WARNING)
        return True

    def _ask_lease(self, pending: Pending, action: LeaseAction) -> None:
        request = self.request(action)
        self._run(pending, lambda: ask_lease(self._bus, self._clock, pending.robot, request))

    def _run(self, pending: Pending, job: Job) -> None:
        self._pending = pending
        self._lane.start(job)

    def _settle(self, pending: Pending, now_ns: int) -> None:
        if not pending.tenure.ours:
            self._pending = None
            self._tell(f"not sent: {pending.words}: the lease is ours no more", Severity.WARNING)
        elif pending.tenure.settled(now_ns) and pending.job is not None:
            self._run(pending._replace(stage=CommandStage.RUNNING), pending.job)

    def _ended(self, pending: Pending, outcome: JobResult, now_ns: int) -> None:
        if pending.stage is CommandStage.RUNNING:
            self.last = f"{pending.words}: {outcome.text}"
            several = "\n" in outcome.text.strip()
            self._told(outcome if several else outcome._replace(text=self.last))
            return
        if outcome.ok and pending.action is not LeaseAction.RELEASE:
            pending.tenure.granted(now_ns)
        if pending.stage is CommandStage.LEASE:
            self._told(outcome, loud=pending.action is LeaseAction.SEIZE)
        elif outcome.ok:
            self._told(outcome)
            self._pending = pending._replace(stage=CommandStage.SETTLING)
        else:
            self._told(JobResult(False, f"not sent: {pending.words}: {outcome.text}"))

    def _told(self, outcome: JobResult, *, loud: bool = False) -> None:
        usual = Severity.WARNING if loud else Severity.INFO
        for line in outcome.text.splitlines():
            self._tell(line, usual if outcome.ok else Severity.WARNING)


def ask_lease(
    bus: ReadableBus, clock: Clock, robot: str, request: LeaseRequest, attempts: int = ATTEMPTS
) -> JobResult:
    """Take, release or seize; the same request again when there is no answer."""
    asking = CommandExchange(request, clock.now_ns(), attempts=attempts, patience_ns=PATIENCE_NS)
    run_exchange(bus, clock, robot, asking, LEASE_SERVICE)
    answer = asking.outcome
    if isinstance(answer, Refused):
        return JobResult(False, f"lease of {robot} refused: {reason_text(answer.reason)}")
    if not isinstance(answer, Accepted):
        why = "no answer" if answer is None else answer.why
        return JobResult(False, f"lease of {robot}: {why}")
    took = f"{answer.took_ns / NS_PER_MS:.0f} ms"
    return JobResult(True, f"lease of {robot} {DONE[LeaseAction(request.action)]} ({took})")
