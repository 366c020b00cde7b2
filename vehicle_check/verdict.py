"""The table of rows: number, title and what clients suffer; and the verdict of a row."""

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from vehicle_check.check import Check

MAX_EVIDENCE: Final = 400


class Status(StrEnum):
    """How a row ended."""

    PASS = "pass"
    FAIL = "fail"
    NOT_APPLICABLE = "not applicable"
    NOT_TRIED = "not tried"


class Verdict(NamedTuple):
    """How a row ended, and the frames that show it."""

    status: Status
    evidence: str


Judge: TypeAlias = Callable[["Check"], Verdict]


class Row(NamedTuple):
    """A row of the acceptance list. `suffers` names the clients that a failure troubles."""

    number: int
    title: str
    suffers: str
    judge: Judge


_ROWS: Final[dict[int, Row]] = {}


def row(number: int, title: str, *, suffers: str) -> Callable[[Judge], Judge]:
    """Enter a function into the table of rows."""

    def enter(judge: Judge) -> Judge:
        assert number not in _ROWS
        _ROWS[number] = Row(number, title, suffers, judge)
        return judge

    return enter


def rows() -> Mapping[int, Row]:
    """Return all rows, in the order in which they are judged."""
    from vehicle_check import rows as modules

    modules.load()
    return _ROWS


def passed(evidence: str) -> Verdict:
    """Return a pass."""
    return Verdict(Status.PASS, evidence[:MAX_EVIDENCE])


def failed(evidence: str) -> Verdict:
    """Return a failure."""
    return Verdict(Status.FAIL, evidence[:MAX_EVIDENCE])


def not_applicable(why: str) -> Verdict:
    """Return the verdict of a row that asks nothing of this vehicle."""
    return Verdict(Status.NOT_APPLICABLE, why[:MAX_EVIDENCE])


def not_tried(why: str) -> Verdict:
    """Return the verdict of a row that the options exclude."""
    return Verdict(Status.NOT_TRIED, why[:MAX_EVIDENCE])


class Findings:
    """The findings of one row: it passes if there is no fault."""

    def __init__(self) -> None:
        self._faults: list[str] = []
        self._facts: list[str] = []

    def expect(self, is_right: object, fact: str) -> bool:
        """Keep the fact as a fault unless it is right."""
        (self._facts if is_right else self._faults).append(fact)
        return bool(is_right)

    def fact(self, fact: str) -> None:
        """Keep a fact that is no fault."""
        self._facts.append(fact)

    def verdict(self) -> Verdict:
        """Return the verdict: the faults, or else the facts."""
        if self._faults:
            return failed("; ".join(self._faults))
        return passed("; ".join(self._facts))
