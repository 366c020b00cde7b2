"""Outcomes that several operations share: the robot agreed, or it refused and why."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

from ground.client.vocabulary import HINTS
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS


class Outcome(Protocol):
    """The end of an operation: `text` is for a person, one or more lines."""

    @property
    def ok(self) -> bool: ...
    @property
    def text(self) -> str: ...
    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the outcome for programs, with the verb and the robot where they belong."""


class RefusedError(RemoteError):
    """A refusal, raised by a caller that needs an agreement."""

    exit_code = 1


@dataclass(frozen=True, slots=True)
class Accepted:
    """The robot agreed, `took_ns` after it was first asked."""

    took_ns: int

    @property
    def ok(self) -> bool:
        return True

    @property
    def text(self) -> str:
        return f"ok {self.took_ns / NS_PER_MS:.0f} ms"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        return answer_row(verb, robot, Reason.NONE, self.took_ns)


@dataclass(frozen=True, slots=True)
class Refused:
    """The robot refused: `reason` is one of `Reason`, `holder` the operator who holds the lease."""

    reason: int
    took_ns: int
    holder: str = ""

    @property
    def ok(self) -> bool:
        return False

    @property
    def words(self) -> str:
        """The reason, with the lease holder and the remedy where there is one."""
        return refusal_words(reason_text(self.reason), self.reason, self.holder)

    @property
    def text(self) -> str:
        return f"refused: {self.words}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        return answer_row(verb, robot, self.reason, self.took_ns)


Answer: TypeAlias = Accepted | Refused


def agreed(outcome: Outcome) -> None:
    """Raise RefusedError, with the words of the outcome, unless it is a success."""
    if not outcome.ok:
        raise RefusedError(outcome.text)


def refusal_words(text: str, reason: int, holder: str) -> str:
    """Return why something was refused, with the lease holder and the remedy."""
    words = f"{text}: {holder}" if holder else text
    hint = HINTS.get(reason)
    return f"{words} ({hint})" if hint else words


def answer_row(verb: str, robot: str, reason: int, took_ns: int) -> dict[str, object]:
    return {
        "verb": verb,
        "robot": robot,
        "ok": reason == Reason.NONE,
        "reason": reason_text(reason),
        "reason_code": reason,
        "took_ms": round(took_ns / NS_PER_MS, 3),
    }
