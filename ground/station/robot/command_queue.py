"""Send one request at a time; acquire the lease before a request that moves the robot."""

from collections import deque
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import Final, NamedTuple

from ground.client.link import run_exchange
from ground.client.outcomes import Accepted, Refused
from ground.client.requests import ATTEMPTS, CommandExchange, RequestIds
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
from runtime.watchdog import slowdown_in

AddNote = Callable[[str, Severity], None]
PATIENCE_NS: Final = 400 * NS_PER_MS
MAX_WAITING: Final = 4
"""Requests that wait for the pending one, such as commands that are typed ahead."""
DONE: Final = {
    LeaseAction.TAKE: "taken",
    LeaseAction.RELEASE: "released",
    LeaseAction.SEIZE: "SEIZED",
    LeaseAction.LEAVE: "given back",
}


class CommandStage(Enum):
    """Stage of the pending request."""

    TAKING = "taking the lease"
    SETTLING = "waiting until the robot has received a heartbeat"
    RUNNING = "running"
    LEASE = "requesting or releasing the lease"


class Pending(NamedTuple):
    """The pending request and its robot."""

    words: str
    robot: str
    holding: LeaseHolding
    job: Job | None
    stage: CommandStage
    action: LeaseAction | None = None
    had_lease: bool = False
    """True if the lease is only prolonged."""


class Waiting(NamedTuple):
    """A waiting request; `begin` starts it."""

    words: str
    begin: Callable[[], bool]


class CommandQueue:
    """The pending request and the waiting ones; `last` is the last request with its result."""

    def __init__(
        self, bus: ReadableBus, clock: Clock, worker: RequestWorker, note: AddNote, name: str
    ) -> None:
        self.last = ""
        self._bus = bus
        self._clock = clock
        self._worker = worker
        self._note = note
        self._name = name.encode()[:MAX_OPERATOR_NAME_BYTES].decode(errors="ignore")
        self._ids = RequestIds()
        self._pending: Pending | None = None
        self._waiting: deque[Waiting] = deque()

    @property
    def busy(self) -> str:
        """Words of the pending request; empty without one."""
        return "" if self._pending is None else self._pending.words

    def submit(
        self,
        words: str,
        robot: str,
        holding: LeaseHolding,
        job: Job,
        refusal: Callable[[], str] | None,
    ) -> bool:
        """Queue a request; return False with a note in the log if too many wait.

        One that moves the robot has a `refusal`: why it is rejected now, empty if it is not.
        """
        if self._pending is not None:
            again = partial(self.submit, words, robot, holding, job, refusal)
            return self._let_wait(Waiting(words, again), self._pending)
        if refusal is not None and (why := refusal()):
            self._note(f"refused: {words}: {why}", Severity.WARNING)
        elif refusal is not None and not holding.is_sure(self._clock.now_ns()):
            taking = Pending(words, robot, holding, job, CommandStage.TAKING)
            self._ask_lease(taking._replace(had_lease=holding.is_used), LeaseAction.TAKE)
        elif refusal is not None and not holding.settled(self._clock.now_ns()):
            self._pending = Pending(words, robot, holding, job, CommandStage.SETTLING)
        else:
            if refusal is not None:
                holding.use(self._clock.now_ns())
            self._run(Pending(words, robot, holding, job, CommandStage.RUNNING), job)
        return True

    def lease(self, robot: str, holding: LeaseHolding, action: LeaseAction) -> bool:
        """Queue a request to acquire or release the lease.

        A release then stops the heartbeat at once.
        """
        words = f"lease {action.name.lower()}"
        if self._pending is not None:
            again = partial(self.lease, robot, holding, action)
            return self._let_wait(Waiting(words, again), self._pending)
        if action is LeaseAction.RELEASE:
            holding.release(self._clock.now_ns())
        self._ask_lease(Pending(words, robot, holding, None, CommandStage.LEASE, action), action)
        return True

    def cancel(self, why: str) -> None:
        """Drop the requests that have not been sent yet; still wait for the pending answer."""
        pending = self._pending
        dropped = [one.words for one in self._waiting]
        self._waiting.clear()
        if pending is not None and pending.stage in (CommandStage.TAKING, CommandStage.SETTLING):
            dropped.insert(0, pending.words)
            lease = pending._replace(words="lease take", job=None, stage=CommandStage.LEASE)
            self._pending = lease if pending.stage is CommandStage.TAKING else None
        for words in dropped:
            self._note(f"not sent: {words}: {why}", Severity.WARNING)

    def request(self, action: LeaseAction) -> LeaseRequest:
        """Return a request for the lease."""
        return LeaseRequest(request_id=self._ids.next(), action=action, name=self._name)

    def leave(self, robot: str, holding: LeaseHolding) -> JobResult:
        """Give the lease back at the end, unless another program of the same person uses it.

        There is one attempt. It blocks, so call it in a thread.
        """
        holding.release(self._clock.now_ns())
        request = self.request(LeaseAction.LEAVE)
        return outcome_of(lambda: ask_lease(self._bus, self._clock, robot, request, attempts=1))

    def poll(self, now_ns: int) -> None:
        """Continue the pending request and report its result; then start those that wait."""
        self._continue(now_ns)
        while self._pending is None and self._waiting:
            self._waiting.popleft().begin()

    def _continue(self, now_ns: int) -> None:
        pending = self._pending
        if pending is None:
            return
        if pending.stage is CommandStage.SETTLING:
            self._settle(pending, now_ns)
            return
        outcome = self._worker.done()
        if outcome is None:
            return
        self._pending = None
        self._finish(pending, outcome, now_ns)

    def _let_wait(self, request: Waiting, pending: Pending) -> bool:
        """Add a waiting request; return False with a note in the log if too many wait."""
        if len(self._waiting) == MAX_WAITING:
            words = f"not sent: {request.words}: `{pending.words}` is under way"
            self._note(words, Severity.WARNING)
            return False
        self._waiting.append(request)
        return True

    def _ask_lease(self, pending: Pending, action: LeaseAction) -> None:
        request = self.request(action)
        self._run(pending, lambda: ask_lease(self._bus, self._clock, pending.robot, request))

    def _run(self, pending: Pending, job: Job) -> None:
        self._pending = pending
        self._worker.start(job)

    def _settle(self, pending: Pending, now_ns: int) -> None:
        if not pending.holding.ours:
            self._pending = None
            self._note(
                f"not sent: {pending.words}: the lease of {pending.robot} was lost meanwhile",
                Severity.WARNING,
            )
        elif pending.holding.settled(now_ns) and pending.job is not None:
            self._run(pending._replace(stage=CommandStage.RUNNING), pending.job)

    def _finish(self, pending: Pending, outcome: JobResult, now_ns: int) -> None:
        if pending.stage is CommandStage.RUNNING:
            self.last = f"{pending.words}: {outcome.text}"
            several = "\n" in outcome.text.strip()
            self._report(outcome if several else outcome._replace(text=self.last))
            return
        if outcome.ok and pending.action is not LeaseAction.RELEASE:
            pending.holding.granted(now_ns)
        if pending.stage is CommandStage.LEASE:
            self._report(outcome, loud=pending.action is LeaseAction.SEIZE)
        elif outcome.ok:
            if not pending.had_lease:
                self._report(outcome)
            self._pending = pending._replace(stage=CommandStage.SETTLING)
        else:
            self._report(JobResult(False, f"not sent: {pending.words}: {outcome.text}"))

    def _report(self, outcome: JobResult, *, loud: bool = False) -> None:
        usual = Severity.WARNING if loud else Severity.INFO
        for line in outcome.text.splitlines():
            self._note(line, usual if outcome.ok else Severity.WARNING)


def ask_lease(
    bus: ReadableBus, clock: Clock, robot: str, request: LeaseRequest, attempts: int = ATTEMPTS
) -> JobResult:
    """Take, release or seize the lease; repeat the same request without an answer."""
    if attempts > 1:  # the one attempt at the end of a session must not delay it
        attempts = round(attempts * slowdown_in(clock)())
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
