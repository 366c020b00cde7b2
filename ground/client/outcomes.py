"""Outcomes that several operations share: an answer of the robot, a report, and their display."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeAlias, TypeVar

from ground.client.emergency_stop import StopOutcome, outcome_words
from ground.client.lease_holder import holder_name
from ground.client.vocabulary import SHELL, Remedies
from ground.text.wording import Part
from protocol.outcome import LOST, REPLACED, detail_of, doubt_words, joined
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS


class Outcome(Protocol):
    """The end of an operation."""

    @property
    def ok(self) -> bool:
        """True if the operation succeeded."""

    @property
    def text(self) -> str:
        """The outcome for a person, in one or more lines."""

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the outcome for programs, with the verb and the robot where they belong."""


O_co = TypeVar("O_co", bound=Outcome, covariant=True)


class Operation(Protocol[O_co]):
    """Something that an operator can do with a robot."""

    @property
    def verb(self) -> str:
        """The name of the operation on the command line."""

    @property
    def moves(self) -> bool:
        """True if it can move the robot or change how it moves."""

    async def perform(self, robot: Any, /) -> O_co:
        """Carry it out on a robot and return the outcome.

        Raises UserError, RemoteError or UnansweredError if there is no outcome.
        """


class RefusedError(RemoteError):
    """A refusal as an exception, for callers that cannot go on without acceptance."""

    exit_code = 1


class Success:
    """An outcome without a failure, such as values that were read."""

    __slots__ = ()

    @property
    def ok(self) -> bool:
        """True."""
        return True


@dataclass(frozen=True, slots=True)
class Accepted(Success):
    """The robot accepted, `took_ns` after the first request.

    `note` is the `Reason` why that has changed nothing, if it has not. `cause` is why the robot
    cannot act on it yet, with its remedy.
    """

    took_ns: int
    note: int = field(default=Reason.NONE, kw_only=True)
    cause: str = field(default="", compare=False, kw_only=True)

    @property
    def text(self) -> str:
        """The duration, as in `ok 14 ms`, the note, and what keeps the robot from acting."""
        words = f": {reason_text(self.note)}" if self.note else ""
        but = f", but {self.cause}" if self.cause else ""
        return f"ok {self.took_ns / NS_PER_MS:.0f} ms{words}{but}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the acceptance as a row."""
        row = answer_row(verb, robot, Reason.NONE, self.took_ns)
        row |= {"note": reason_text(self.note)} if self.note else {}
        return row | ({"cause": self.cause} if self.cause else {})


@dataclass(frozen=True, slots=True)
class Refused:
    """The robot refused for a `Reason`.

    `holder` is the operator that holds the lease, if that is why. `cause` is what lies behind the
    reason, with its remedy, and is told instead of it. `remedies` are in the words of the command
    line or of Python.
    """

    reason: int
    took_ns: int
    holder: str = ""
    cause: str = field(default="", compare=False)
    remedies: Remedies = field(default=SHELL, compare=False, repr=False)

    @property
    def ok(self) -> bool:
        """False."""
        return False

    @property
    def words(self) -> str:
        """The reason, with the lease holder and the remedy where there is one."""
        return self.why(self.remedies.refusals)

    @property
    def text(self) -> str:
        """The reason, as in `refused: not armed: arm first`."""
        return self.in_words(self.remedies.refusals)

    def in_words(self, hints: Mapping[int, str]) -> str:
        """Return the reason with a remedy of `hints`, such as the keys of the app."""
        return f"refused: {self.why(hints)}"

    def why(self, hints: Mapping[int, str]) -> str:
        """Return the reason with a remedy of `hints`, for a line that tells what was refused."""
        words = refusal_words(reason_text(self.reason), self.reason, self.holder, hints)
        return self.cause or self.remedies.addressed(words)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the refusal as a row."""
        return answer_row(verb, robot, self.reason, self.took_ns)


Answer: TypeAlias = Accepted | Refused


def agreed(outcome: Outcome) -> None:
    """Raise RefusedError with the text of the outcome unless it is a success."""
    if not outcome.ok:
        raise RefusedError(outcome.text)


def refusal_words(text: str, reason: int, holder: str, hints: Mapping[int, str]) -> str:
    """Return why a request was refused, with the lease holder and the remedy."""
    words = f"{text}: {holder}" if holder else text
    hint = hints.get(reason)
    return f"{words} ({hint})" if hint else words


def answer_row(verb: str, robot: str, reason: int, took_ns: int) -> dict[str, object]:
    """Return the JSON row that all answers to commands share."""
    return {
        "verb": verb,
        "robot": robot,
        "ok": reason == Reason.NONE,
        "reason": reason_text(reason),
        "reason_code": reason,
        "took_ms": round(took_ns / NS_PER_MS, 3),
    }


@dataclass(frozen=True, slots=True)
class GoalEnded:
    """The end of a goal.

    `outcome` is reached, unreachable, lost, stuck, replaced, aborted or timeout.

    `distance_m` is the remaining distance to the goal, None without a status from the robot.
    `doubt_m` is the longer half axis of the confidence ellipse of the position, None if unknown.
    `wall_s` is the time since the operation began, by this machine's clock.
    """

    outcome: str
    reason: str
    distance_m: float | None
    wall_s: float
    doubt_m: float | None = None

    @property
    def ok(self) -> bool:
        """True if the robot reached the goal."""
        return self.outcome == "reached"

    @property
    def text(self) -> str:
        """Outcome, reason and duration."""
        words = self.outcome
        if self.reason != self.outcome:
            words = joined(self.outcome, detail_of(self.outcome, self.reason))
        if self.outcome == LOST:
            words += f"; {doubt_words(self.doubt_m)}"
        return f"{words} after {self.wall_s:.1f} s"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the outcome as a row."""
        return {
            "verb": verb,
            "robot": robot,
            "ok": self.ok,
            "outcome": self.outcome,
            "reason": self.reason,
            "distance_m": self.distance_m,
            "doubt_m": self.doubt_m,
            "wall_s": round(self.wall_s, 3),
        }


DRIVE_REPLACED: Final = "replaced by what was asked of the robot since; it may still drive"
"""The end of a drive by hand after which another one, or a goal, has begun."""

UNCONFIRMED: Final = "the robot has not confirmed its hold; without speeds it stops by itself"
"""The end of a drive by hand at which the robot did not answer."""


@dataclass(frozen=True, slots=True)
class DriveEnded:
    """The end of a drive by hand; `reason` is empty if its time was up."""

    reason: str

    @property
    def ok(self) -> bool:
        """True if the whole time was driven."""
        return not self.reason

    @property
    def text(self) -> str:
        """The reason, or that the robot holds."""
        if self.reason.startswith(REPLACED):
            return self.reason
        return f"stopped: {self.reason}" if self.reason else "done, the robot holds"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the outcome as a row."""
        return {"verb": verb, "robot": robot, "ok": self.ok, "reason": self.reason}


@dataclass(frozen=True, slots=True)
class LeaseShown(Success):
    """The robot's lease status; `ours`: the person of this program holds the lease."""

    status: LeaseStatus
    robot: str
    ours: bool

    @property
    def text(self) -> str:
        """The holder, and when the lease expires."""
        if not self.status.held:
            return "no operator holds the lease"
        holder = f"{holder_name(self.status)}{' (a program of yours)' if self.ours else ''}"
        left_s = self.status.lapses_ms / 1000
        expiry = f"without a heartbeat or a drive the lease expires in {left_s:.1f} s"
        return f"{holder} commands {self.robot}; {expiry}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the lease as a row; times in ms."""
        status = self.status
        return {
            "robot": robot,
            "ok": True,
            "held": bool(status.held),
            "holder": status.holder or None,
            "name": status.name or None,
            "lapses_ms": status.lapses_ms if status.held else None,
        }


@dataclass(frozen=True, slots=True)
class Stopped:
    """The end of an emergency stop; `ok` only if the robot's status shows it."""

    stop: StopOutcome
    robot: str

    @property
    def ok(self) -> bool:
        """True if the robot's status shows the stop."""
        return self.stop.acknowledged

    @property
    def text(self) -> str:
        """The duration and the number of tries, and the error if there is one."""
        return outcome_words(self.stop, self.robot)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the outcome as a row; without acknowledgement `reason_code` is None."""
        row = answer_row(verb, robot, Reason.NONE, self.stop.took_ns)
        if self.ok:
            return row
        return row | {"ok": False, "reason": self.stop.why, "reason_code": None}


@dataclass(frozen=True, slots=True)
class Marked:
    """The end of a remark; `ok` if a recorder received it."""

    remark: str
    ok: bool

    @property
    def reason(self) -> str:
        """The error, empty if a recorder received the remark."""
        return "" if self.ok else "no recorder is running: start one with sidestep rec start DIR"

    @property
    def text(self) -> str:
        """The remark, or the error."""
        return self.reason or f"marked: {self.remark}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return remark and error as a row."""
        return {"ok": self.ok, "mark": self.remark, "reason": self.reason}


@dataclass(frozen=True, slots=True)
class Unanswered:
    """A robot that did not answer."""

    text: str

    @property
    def ok(self) -> bool:
        """False."""
        return False

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the failure as a row; `reason_code` is None."""
        return {"verb": verb, "robot": robot, "ok": False, "reason": self.text, "reason_code": None}


@dataclass(frozen=True, slots=True)
class AllAnswered:
    """The outcomes of all robots by name; `ok` only if each one succeeded."""

    of: tuple[tuple[str, Stopped | Answer | Unanswered], ...]

    @property
    def ok(self) -> bool:
        """True if all robots did it."""
        return all(outcome.ok for _, outcome in self.of)

    @property
    def text(self) -> str:
        """One line for each robot."""
        return "\n".join(f"{robot}: {outcome.text}" for robot, outcome in self.of)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return a row for each robot."""
        rows = [outcome.as_json(verb, name) for name, outcome in self.of]
        return {"verb": verb, "ok": self.ok, "robots": rows}


class Progress(Protocol):
    """Displays what happens before the outcome of an operation."""

    @property
    def live(self) -> bool:
        """True if `line` replaces the line before, so that it may be called often."""

    def note(self, text: str) -> None:
        """Show a message."""

    def line(self, parts: Sequence[Part]) -> None:
        """Show the present state."""


class NoProgress:
    """A progress display that shows nothing."""

    live = False

    def note(self, text: str) -> None:
        """Ignore the message."""

    def line(self, parts: Sequence[Part]) -> None:
        """Ignore the state."""


@dataclass(frozen=True, slots=True)
class Report:
    """The outcome of a report; `ok` if all could be read and no fault was found."""

    ok: bool
    text: str
    row: Mapping[str, object] = field(default_factory=dict)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the row."""
        return dict(self.row)
