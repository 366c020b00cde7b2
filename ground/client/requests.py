"""The operator's side of requests and goals, without I/O: messages and time go in.

All repetitions of a request have one id, so a retry never acts twice.
"""

import secrets
from dataclasses import dataclass
from math import isfinite
from typing import Final, Generic, Protocol, TypeAlias, TypeVar

from ground.client.outcomes import Accepted, Answer, Refused
from protocol.outcome import REPLACED, goal_end, reason_words
from protocol.topics import LEASE, STATUS, Topic
from protocol.wire.enums import AckResult, Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    LeaseStatus,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason, reason_text
from runtime.cli.terminal import printable
from runtime.sequence import MAX_LATE_NS, Order, order_of
from runtime.units import NS_PER_MS, NS_PER_S

ATTEMPTS: Final = 3
PATIENCE_NS: Final = 500 * NS_PER_MS
BEAT_NS: Final = 200 * NS_PER_MS
SILENCE_NS: Final = 3_000 * NS_PER_MS
UNSEEN_NS: Final = 3_000 * NS_PER_MS
CROSSING_NS: Final = 300 * NS_PER_MS
"""A status sent before a change may arrive up to this time after the answer to the change."""
NAMED_NS: Final = 1_000 * NS_PER_MS
"""Longest wait for the name of the operator whose goal has replaced another one."""
BY_ANOTHER: Final = "by another"
ID_BITS: Final = 64

NO_COMMAND: Final = 0
ASK_AGAIN: Final = (Reason.TOO_MANY_REQUESTS, Reason.TOO_LATE)
"""Reasons why the robot has not processed a request, so that it is sent again."""

Out = TypeVar("Out")
M = TypeVar("M", bound=Message)
Request: TypeAlias = CommandRequest | GoalRequest | LeaseRequest
R = TypeVar("R", bound=Request)
T = TypeVar("T")


class Latest(Protocol):
    """Returns the newest message of a topic and its time of arrival."""

    def __call__(self, topic: Topic[M], /) -> tuple[M, int] | None:
        """Return both, None if none has arrived."""


class RequestIds:
    """Random request ids, which no other process can guess; never 0."""

    def next(self) -> int:
        """Return a new id of 64 bits."""
        return secrets.randbits(ID_BITS) or 1


@dataclass(frozen=True, slots=True)
class Attempt:
    """A request to send now, and how long to wait for the reply."""

    request: Message | None
    patience_ns: int


@dataclass(frozen=True, slots=True)
class GaveUp:
    """The result of an exchange without an answer; `why` is the error of the last attempt."""

    why: str


class Exchange(Generic[Out]):
    """Requests to one service, each repeated until it is answered: the engine of all requests.

    Does no I/O: `due` returns the attempts to send now, `receive` and `unanswered` take their
    results. It is over once it has an `outcome`. All attempts of a request are identical, so a
    retry never acts twice.
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
        """True once there is an outcome."""
        return self.outcome is not None

    def due(self, now_ns: int) -> list[Attempt]:
        """Return the attempts to send now; `next_ns` is when to call this again."""
        if self.over or now_ns < self.next_ns:
            return []
        if not self._left or self._is_out_of_time(now_ns):
            self.outcome = GaveUp(self._why)
            return []
        self._left -= 1
        self.next_ns = now_ns + self._patience_ns
        return [Attempt(self._question, self._patience_ns)]

    def receive(self, answer: object, now_ns: int) -> None:
        """Process a reply; ignore one that does not fit."""
        if not self.over:
            self._take(answer, now_ns)

    def unanswered(self, why: str) -> None:
        """Note why an attempt was not answered."""
        self._why = why

    def _take(self, answer: object, now_ns: int) -> None:
        """Set the outcome, or prepare the next request."""
        raise NotImplementedError

    def _is_out_of_time(self, now_ns: int) -> bool:
        """Return whether to give up although attempts are left."""
        return False

    def _ask_next(self, question: Message | None, now_ns: int) -> None:
        """Send this request next, at once and with all attempts."""
        self._question, self._left, self.next_ns = question, self._attempts, now_ns


class CommandExchange(Exchange[Answer]):
    """One command, goal or lease request, repeated until the robot acknowledges it."""

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
            self.unanswered("the reply is not an acknowledgement")
        elif answer.result == AckResult.TEMPORARILY_REJECTED or answer.result_param2 in ASK_AGAIN:
            self.unanswered(reason_text(answer.result_param2))
        elif not acknowledges(answer, self._request):
            self.unanswered(f"the reply is for command {answer.command}")
        else:
            took_ns = now_ns - self._started_ns
            reason, is_accepted = answer.result_param2, answer.result == AckResult.ACCEPTED
            self.outcome = (
                Accepted(took_ns, note=reason) if is_accepted else Refused(reason, took_ns)
            )


def is_saving(answer: object) -> bool:
    """Return whether a reply is IN_PROGRESS: the value is in force and still being saved."""
    return isinstance(answer, CommandAck) and answer.result == AckResult.IN_PROGRESS


def acknowledges(answer: CommandAck, request: Request) -> bool:
    """Return whether a reply belongs to this request. A refusal may leave out the command."""
    if answer.command == command_of(request):
        return True
    return answer.command == NO_COMMAND and answer.result != AckResult.ACCEPTED


def command_of(request: Request) -> int:
    """Return the command in the acknowledgement of a request."""
    if isinstance(request, GoalRequest):
        return Command.DO_REPOSITION
    return request.command if isinstance(request, CommandRequest) else NO_COMMAND


@dataclass(frozen=True, slots=True)
class GoalEnd:
    """The end of a goal: reached, unreachable, lost, stuck, replaced, aborted or timeout.

    `abort`: the robot may still be driving, so send it an abort.
    """

    outcome: str
    reason: str
    abort: bool = False


def replaced_by(by: NavigatorStatus, driver: str) -> str:
    """Return which goal has replaced another one, and whose it is unless that is unknown."""
    of = f" of {driver}" if driver else ""
    has_place = isfinite(by.goal_x_m) and isfinite(by.goal_y_m)
    where = f"by the goal {by.goal_x_m:z.1f} {by.goal_y_m:z.1f}" if has_place else BY_ANOTHER
    return f"{where}{of}"


class HeartbeatTimer:
    """Decides when to send the heartbeat, by this machine's clock or the robot's time stamps.

    Whichever of the two is ahead counts, because simulated time may run faster.
    """

    def __init__(self) -> None:
        self._sent_ns: int | None = None
        self._sent_stamp_ns = 0

    def due(self, now_ns: int, stamp_ns: int) -> bool:
        """Return True once per heartbeat interval."""
        since_ns = BEAT_NS if self._sent_ns is None else now_ns - self._sent_ns
        if max(since_ns, stamp_ns - self._sent_stamp_ns) < BEAT_NS:
            return False
        self._sent_ns, self._sent_stamp_ns = now_ns, stamp_ns
        return True


class GoalWatch:
    """Follows one goal to its end and decides when to send the operator's heartbeat.

    A goal that another one replaces ends once the lease status names the operator of the other one,
    or shortly after.
    Simulated time may run faster than this machine's: the heartbeat and the time limit follow the
    clock that is ahead, ours or that of the robot's time stamps. With `stamps_only` the limit
    depends on the time stamps alone, which a repeatable run needs. The time limit counts from
    `asked_ns`, if it was asked for before `now_ns`.
    """

    def __init__(
        self,
        goal_id: int,
        now_ns: int,
        timeout_ns: int | None,
        *,
        asked_ns: int | None = None,
        stamps_only: bool = False,
    ) -> None:
        self._goal_id = goal_id
        self._timeout_ns = timeout_ns
        self._stamps_only = stamps_only
        self._asked_ns = now_ns if asked_ns is None else asked_ns
        self._accepted_ns = self._received_ns = now_ns
        self._heartbeat = HeartbeatTimer()
        self._started_stamp_ns: int | None = None
        self._stamp_ns = 0
        self._seen = False
        self._replacement: NavigatorStatus | None = None
        self._replaced_ns = 0
        self._is_other_shown = False
        self._driver: tuple[int, str] = (0, "")
        self.end: GoalEnd | None = None

    def look(self, latest: Latest) -> None:
        """Process the newest status and lease status, with their times of arrival."""
        if (lease := latest(LEASE)) is not None:
            self.receive_driver(lease[0])
        if (status := latest(STATUS)) is not None:
            self.receive(*status)

    def receive_driver(self, lease: LeaseStatus) -> None:
        """Note which program began the newest drive."""
        self._driver = lease.drive_id, printable(lease.driver)

    def receive(self, status: NavigatorStatus, now_ns: int) -> None:
        """Process a status of the robot; set `end` if the goal has ended."""
        if self.end is not None:
            return
        self._received_ns = now_ns
        if self._replacement is not None:
            self._end_replaced(self._replacement, now_ns)
            return
        order = order_of(status.time_ns, self._stamp_ns, MAX_LATE_NS)
        if self._seen and order is Order.RESTARTED:
            self.end = GoalEnd("aborted", "the robot has restarted")
        if self._seen and order in (Order.LATE, Order.RESTARTED):
            return
        self._stamp_ns = status.time_ns
        if status.goal_id == self._goal_id:
            self._seen = True
            self._started_stamp_ns = status.goal_started_ns
            self.end = _end_in(status)
        elif not (self._seen or now_ns - self._accepted_ns > UNSEEN_NS):
            is_crossed = now_ns - self._accepted_ns <= CROSSING_NS
            self._is_other_shown = bool(status.goal_id) and not is_crossed
            return
        elif not status.goal_id:
            self.end = GoalEnd("aborted", "the robot has restarted and lost the goal")
        else:
            self._replacement, self._replaced_ns = status, now_ns
            self._end_replaced(status, now_ns)

    @property
    def is_shown(self) -> bool:
        """False until the robot's status shows the goal, and when another one replaces it."""
        return self._seen and self._replacement is None

    def _end_replaced(self, by: NavigatorStatus, now_ns: int) -> None:
        """End a goal that another one replaces, when that one's operator is known.

        Several goals may be accepted in one tick. If ours was never shown, the one that is shown
        need not be the one that replaced it, and is not named.
        """
        if not self._seen:
            self.end = GoalEnd(REPLACED, BY_ANOTHER)
            return
        drive_id, driver = self._driver
        is_named = bool(driver) and drive_id == by.goal_id
        if is_named or now_ns - self._replaced_ns >= NAMED_NS:
            self.end = GoalEnd(REPLACED, replaced_by(by, driver if is_named else ""))

    def due(self, now_ns: int) -> bool:
        """Return whether to send the heartbeat now; set `end` at a time-out or after silence."""
        if self.end is not None:
            return False
        if self._replacement is None:
            self._check_time(now_ns)
        else:
            self._end_replaced(self._replacement, now_ns)
        return self.end is None and self._heartbeat.due(now_ns, self._stamp_ns)

    def outrun(self, latest: Latest) -> GoalEnd | None:
        """Return how the goal had ended by itself before its clean-up, if that is known by now."""
        newest = latest(STATUS)
        end = _end_in(newest[0]) if newest and newest[0].goal_id == self._goal_id else None
        return None if end is None or end.outcome == "aborted" else end

    def silent_ns(self, now_ns: int) -> int:
        """Return the time since the last status of the robot."""
        return now_ns - self._received_ns

    def _check_time(self, now_ns: int) -> None:
        started_ns = self._started_stamp_ns
        driven_ns = 0 if started_ns is None else self._stamp_ns - started_ns
        elapsed_ns = driven_ns if self._stamps_only else max(driven_ns, now_ns - self._asked_ns)
        if self._timeout_ns is not None and elapsed_ns >= self._timeout_ns:
            why = f"goal not reached within {self._timeout_ns / NS_PER_S:g} s"
            self.end = GoalEnd("timeout", why, abort=True)
        elif self.silent_ns(now_ns) < SILENCE_NS:
            return
        elif self._is_other_shown:
            self.end = GoalEnd(REPLACED, BY_ANOTHER)
        else:
            why = f"no message from the robot for {self.silent_ns(now_ns) / NS_PER_S:.1f} s"
            self.end = GoalEnd("aborted", why, abort=True)


def _end_in(status: NavigatorStatus) -> GoalEnd | None:
    outcome = goal_end(status.goal, status.goal_reason)
    if outcome is None:
        return None
    reason = status.goal_reason
    words = outcome if reason == Reason.NONE else reason_words(reason, status.ended_by)
    return GoalEnd(outcome, words)
