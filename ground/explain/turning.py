"""Find the turning points of a run: changes of branch, side or guard."""

from typing import Final, NamedTuple

from ground.explain.names import branch_words
from protocol.wire.enums import Branch
from protocol.wire.messages import AvoidanceDecision
from protocol.wire.reasons import reason_text

SIDES: Final = (Branch.PASS_LEFT, Branch.PASS_RIGHT)


class TurningPoint(NamedTuple):
    """A change between two decisions; `time_ns` is the robot's stamp."""

    time_ns: int
    words: str
    previous: AvoidanceDecision
    decision: AvoidanceDecision


def turning_point(before: AvoidanceDecision, after: AvoidanceDecision) -> TurningPoint | None:
    """Return the turning point between two decisions, or None without a change."""
    found = changes(before, after)
    return TurningPoint(after.time_ns, "; ".join(found), before, after) if found else None


def changes(before: AvoidanceDecision, after: AvoidanceDecision) -> list[str]:
    """Return what changed between two decisions, in words."""
    found = []
    if before.branch != after.branch:
        sides = before.branch in SIDES and after.branch in SIDES
        words = f"{branch_words(before.branch)} -> {branch_words(after.branch)}"
        found.append(f"changes the side: {words}" if sides else words)
    if before.guard != after.guard:
        found.append(f"guard: {guard_words(before.guard)} -> {guard_words(after.guard)}")
    return found


def guard_words(number: int) -> str:
    """Return the reason of a guard without its prefix."""
    return reason_text(number).removeprefix("guard: ") if number else "nothing"
