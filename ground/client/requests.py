"""The operator's side of a command and of a goal, without any I/O: messages and time go in.

A request keeps its id however often it is repeated, so a retry never acts twice.
"""

import secrets
from dataclasses import dataclass
from typing import Final, Generic, TypeAlias, TypeVar

from protocol.wire.enums import AckResult, Command, GoalState
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason, reason_text
from runtime.sequence import MAX_LATE_NS, Order, order_of
from runtime.units import NS_PER_MS, NS_PER_S

ATTEMPTS: Final = 3
PATIENCE_NS: Final = 500 * NS_PER_MS
BEAT_NS: Final = 200 * NS_PER_MS
SILENCE_NS: Final = 3_000 * NS_PER_MS
UNSEEN_NS: Final = 3_000 * NS_PER_MS
ID_BITS: Final = 64

NO_COMMAND: Final = 0
ASK_AGAIN: Final = (Reason.TOO_MANY_REQUESTS, Reason.TOO_LATE)
"""Reasons that are no answer: the robot has not looked at the request."""

Out = TypeVar("Out")
Request: TypeAlias = CommandRequest | GoalRequest | LeaseRequest


class RequestIds:
    """Ids that nobody can guess, each drawn at random. 0 is never given."""

    def next(self) -> int:
        return secrets.randbits(ID_BITS) or 1


@dataclass(frozen=True, slots=True)
class Send:
    """Put the question, and listen for an answer for this long."""

    request: Message | None
    patience_ns: int


@dataclass(frozen=True, slots=True)
class Answered:
    """The robot has spoken: did it agree, and if not, why."""

    reason: int
    ok: bool
    took_ns: int

    @property
    def text(self) -> str:
        return reason_text(self.reason)


@dataclass(frozen=True, slots=True)
class GaveUp:
    """No answer to any attempt; `why` is what the last one came to."""

    why: str


class Exchange(Generic[Out]):
    """Questions, each repeated until it is answered: the one engine of all requests.

    Does no I/O: `due` says what to ask now, `receive` and `unanswered` take what came of it. It is
    over when there is an `outcome`. A retry is the same question, so it never acts twice.
    """

    def __init__(
        self,
        question: Message | None,
        now_ns: int,
        *,
        attempts: int = ATTEMPTS,
        patience_ns: int = PATIENCE_NS,
    ) -> None:
        self.next_ns = now_ns
        self.outcome: Out | GaveUp | None = None
        self._question = question
        self._attempts = self._left = attempts
        self._patience_ns = patience_ns
        self._why = "no answer"

    @property
    def over(self) -> bool:
        return self.outcome is not None

    def due(self, now_ns: int) -> list[Send]:
        """Return what to ask now; `next_ns` says when to call it again."""
        if self.over or now_ns < self.next_ns:
            return []
        if not self._left or self._is_out_of_time(now_ns):
            self.outcome = GaveUp(self._why)
            return []
        self._left -= 1
        self.next_ns = now_ns + self._patience_ns
        return [Send(self._question, self._patience_ns)]

    def receive(self, answer: object, now_ns: int) -> None:
        """Take an answer; one that does not fit counts as none."""
        if not self.over:
            self._take(answer, now_ns)

    def unanswered(self, why: str) -> None:
        """Note that an attempt came to nothing, for this reason."""
        self._why = why

    def _take(self, answer: object, now_ns: int) -> None:
        """Set the outcome, ask the next question or ask again."""
        raise NotImplementedError

    def _is_out_of_time(self, now_ns: int) -> bool:
        """Return whether to give up though there are attempts left."""
        return False

    def _ask_next(self, question: Message | None, now_ns: int) -> None:
        """Ask another question, or the same again, at once and with all attempts."""
        self._question, self._left, self.next_ns = question, self._attempts, now_ns


class Asking(Exchange[Answered]):
    """One command, goal or request for the lease until the robot acknowledges it."""

    def __init__(
        self,
        request: Request,
        now_ns: int,
        *,
        attempts: int = ATTEMPTS,
        patience_ns: int = PATIENCE_NS,
    ) -> None:
        super().__init__(request, now_ns, attempts=attempts, patience_ns=patience_ns)
        self._request = request
        self._started_ns = now_ns

    def _take(self, answer: object, now_ns: int) -> None:
        if not isinstance(answer, CommandAck):
            self.unanswered("the answer is no acknowledgement")
        elif answer.result == AckResult.TEMPORARILY_REJECTED or answer.result_param2 in ASK_AGAIN:
            self.unanswered(reason_text(answer.result_param2))
        elif not acknowledges(answer, self._request):
            self.unanswered(f"the answer is to command {answer.command}")
        else:
            accepted = answer.result == AckResult.ACCEPTED
            self.outcome = Answered(answer.result_param2, accepted, now_ns - self._started_ns)


def is_saving(answer: object) -> bool:
    """Return whether an answer is IN_PROGRESS: in force and being saved, so ask again."""
    return isinstance(answer, CommandAck) and answer.result == AckResult.IN_PROGRESS


def acknowledges(answer: CommandAck, request: Request) -> bool:
    """Return whether an answer is one to this request. A refusal may leave out the command."""
    if answer.command == command_of(request):
        return True
    return answer.command == NO_COMMAND and answer.result != AckResult.ACCEPTED


def command_of(request: Request) -> int:
    """Return the command that acknowledges a request."""
    if isinstance(request, GoalRequest):
        return Command.DO_REPOSITION
    return request.command if isinstance(request, CommandRequest) else NO_COMMAND


@dataclass(frozen=True, slots=True)
class Beat:
    """Let the robot hear the operator's heartbeat."""


@dataclass(frozen=True, slots=True)
class GoalEnd:
    """How it ended: reached, stuck, aborted or timeout; `abort` when the robot must be told."""

    outcome: str
    reason: str
    abort: bool = False

    @property
    def reached(self) -> bool:
        return self.outcome == "reached"


ENDS: Final = {
    GoalState.REACHED: "reached",
    GoalState.STUCK: "stuck",
    GoalState.ABORTED: "aborted",
    GoalState.REFUSED: "aborted",
}


class Pace:
    """When the heart must beat: by our clock or by the robot's stamps, whichever is ahead."""

    def __init__(self) -> None:
        self._beaten_ns: int | None = None
        self._beaten_stamp_ns = 0

    def due(self, now_ns: int, stamp_ns: int) -> bool:
        """True once per beat."""
        since_ns = BEAT_NS if self._beaten_ns is None else now_ns - self._beaten_ns
        if max(since_ns, stamp_ns - self._beaten_stamp_ns) < BEAT_NS:
            return False
        self._beaten_ns, self._beaten_stamp_ns = now_ns, stamp_ns
        return True


class GoalWatch:
    """Follows one goal to its end, and says when the operator's heart must beat.

    Simulated time may run faster than ours: the heartbeat and the time limit go by whichever of the
    two clocks, ours and that of the robot's stamps, is ahead. With `stamps_only` the limit goes by
    the stamps alone, as a run that can be repeated needs it.
    """

    def __init__(
        self, goal_id: int, now_ns: int, timeout_ns: int | None, *, stamps_only: bool = False
    ) -> None:
        self._goal_id = goal_id
        self._timeout_ns = timeout_ns
        self._stamps_only = stamps_only
        self._asked_ns = self._heard_ns = now_ns
        self._pace = Pace()
        self._started_stamp_ns: int | None = None
        self._stamp_ns = 0
        self._seen = False
        self.end: GoalEnd | None = None

    def receive(self, status: NavigatorStatus, now_ns: int) -> None:
        """A status of the robot; may set `end`."""
        if self.end is not None:
            return
        self._heard_ns = now_ns
        order = order_of(status.time_ns, self._stamp_ns, MAX_LATE_NS)
        if self._seen and order is Order.RESTARTED:
            self.end = GoalEnd("aborted", "the robot has been restarted")
        if self._seen and order in (Order.LATE, Order.RESTARTED):
            return
        self._stamp_ns = status.time_ns
        if status.goal_id == self._goal_id:
            self._seen = True
            self._started_stamp_ns = status.goal_started_ns
            self.end = _end_in(status)
        elif self._seen or now_ns - self._asked_ns > UNSEEN_NS:
            self.end = _pushed_out(status)

    def due(self, now_ns: int) -> list[Beat]:
        """What to do now; may set `end` when time is up or nothing has been heard for too long."""
        if self.end is not None:
            return []
        self._judge_time(now_ns)
        beats = self.end is None and self._pace.due(now_ns, self._stamp_ns)
        return [Beat()] if beats else []

    def silent_ns(self, now_ns: int) -> int:
        """How long nothing has been heard of the robot."""
        return now_ns - self._heard_ns

    def _judge_time(self, now_ns: int) -> None:
        started_ns = self._started_stamp_ns
        driven_ns = 0 if started_ns is None else self._stamp_ns - started_ns
        elapsed_ns = driven_ns if self._stamps_only else max(driven_ns, now_ns - self._asked_ns)
        if self._timeout_ns is not None and elapsed_ns >= self._timeout_ns:
            said = f"not there after {self._timeout_ns / NS_PER_S:g} s"
            self.end = GoalEnd("timeout", said, abort=True)
        elif self.silent_ns(now_ns) >= SILENCE_NS:
            said = f"the robot has been silent for {self.silent_ns(now_ns) / NS_PER_S:.1f} s"
            self.end = GoalEnd("aborted", said, abort=True)


def _end_in(status: NavigatorStatus) -> GoalEnd | None:
    known = status.goal in GoalState.__members__.values()
    outcome = ENDS.get(GoalState(status.goal)) if known else None
    if outcome is None:
        return None
    reason = status.goal_reason
    return GoalEnd(outcome, outcome if reason == Reason.NONE else reason_text(reason))


def _pushed_out(status: NavigatorStatus) -> GoalEnd:
    if status.goal_id:
        return GoalEnd("aborted", reason_text(Reason.REPLACED))
    return GoalEnd("aborted", "the robot knows nothing of the goal: it has been restarted")
