"""Outcomes that several operations share: the robot accepted a request, or refused it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

from ground.client.vocabulary import SHELL, Remedies
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
    """The robot accepted, `took_ns` after the first request."""

    took_ns: int

    @property
    def text(self) -> str:
        """The duration, as in `ok 14 ms`."""
        return f"ok {self.took_ns / NS_PER_MS:.0f} ms"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the acceptance as a row."""
        return answer_row(verb, robot, Reason.NONE, self.took_ns)


@dataclass(frozen=True, slots=True)
class Refused:
    """The robot refused for a `Reason`.

    `holder` is the operator that holds the lease, if that is why. `remedies` are in the
    words of the command line or of Python.
    """

    reason: int
    took_ns: int
    holder: str = ""
    remedies: Remedies = field(default=SHELL, compare=False, repr=False)

    @property
    def ok(self) -> bool:
        """False."""
        return False

    @property
    def words(self) -> str:
        """The reason, with the lease holder and the remedy where there is one."""
        return refusal_words(
            reason_text(self.reason), self.reason, self.holder, self.remedies.refusals
        )

    @property
    def text(self) -> str:
        """The reason, as in `refused: not armed: arm first`."""
        return self.in_words(self.remedies.refusals)

    def in_words(self, hints: Mapping[int, str]) -> str:
        """Return the reason with a remedy of `hints`, such as the keys of the app."""
        words = refusal_words(reason_text(self.reason), self.reason, self.holder, hints)
        return f"refused: {words}"

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
