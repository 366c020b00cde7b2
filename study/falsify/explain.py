"""Describe a failure in one sentence, from the records of its trial."""

from protocol.wire.reasons import Reason, reason_text
from robot.core import states
from study.falsify.properties import ELLIPSE, ContactRecord, Evaluation, ratio_of

BRANCHES = {
    states.TO_GOAL: "while it drives straight to the goal",
    states.PASS_LEFT: "while it passes an obstacle on the left",
    states.PASS_RIGHT: "while it passes an obstacle on the right",
    states.ALIGN: "while it turns to the final heading",
}


def sentence_of(letter: str, navigator: str, one: Evaluation) -> str:
    """Return a sentence on the violation of a property."""
    outcome = one.outcome
    spent = f"after {outcome.time_s:.0f} s and {outcome.path_m:.1f} m"
    shortest = outcome.shortest_path_m
    exists = "" if shortest is None else f"although a way of {shortest:.2f} m exists"
    if letter == "a":
        return f"{navigator} {_end(one)} {spent} {exists}{_driven(one)}."
    if letter == "b":
        return (
            f"{navigator} calls the goal unreachable {spent} {exists}{_claimed(one)}{_driven(one)}."
        )
    if letter == "c":
        place = BRANCHES.get(one.contact_branch, "while it stands or turns")
        return (
            f"{navigator} touches {_touched(one.contact)} by its own motion {place}, at the latest"
            f" {spent}{_echo(one.contact)}{_driven(one)}."
        )
    if letter == "d":
        return (
            f"The position error of {navigator} is {one.mahalanobis2**0.5:.1f} times the claimed"
            f" standard deviation (limit {ELLIPSE**0.5:.1f}) in a drive of {outcome.path_m:.1f} m."
        )
    if letter == "e":
        return (
            f"{navigator} arrives on a way of {outcome.path_m:.1f} m, {ratio_of(outcome):.1f} times"
            f" the shortest{_driven(one)}."
        )
    end = f"{_end(one)} {spent}, and has not recognised that there is no way"
    return f"{navigator} {end}{_driven(one)}."


def _end(one: Evaluation) -> str:
    if one.kind == "timeout-still":
        return "no longer moves and is out of time"
    if one.kind == "timeout-moving":
        return "still drives and is out of time"
    if one.outcome.reached:
        return "arrives"
    return f"ends ({reason_text(Reason(one.goal_reason)).partition(':')[0]})"


def _claimed(one: Evaluation) -> str:
    """Return the records behind a claim: the last lap, and the doubt about the position."""
    lap, doubt_m = one.lap, one.outcome.doubt_m
    found = []
    if lap is not None:
        gaps = f"{lap.gaps} gap{'' if lap.gaps == 1 else 's'}" if lap.gaps else "no gap"
        found.append(f"a lap of {lap.length_m:.1f} m with {gaps} in the chain of echoes")
    if doubt_m is not None:
        found.append(f"a position doubt of {doubt_m:.2f} m")
    return f", with {' and '.join(found)}" if found else ""


def _touched(contact: ContactRecord | None) -> str:
    """Return the touched thing and the speed of the contact."""
    if contact is None:
        return "something"
    return f"{contact.touched} at {contact.speed_m_s:.2f} m/s"


def _echo(contact: ContactRecord | None) -> str:
    """Return the last echo towards the touched thing."""
    if contact is None:
        return ""
    if not contact.is_in_view:
        return ", where no sonar points"
    if contact.range_m is None or contact.age_s is None:
        return ", when the sonar towards it had measured no echo"
    return (
        f", when the sonar towards it had last measured {contact.range_m:.2f} m,"
        f" {contact.age_s:.2f} s before"
    )


def _driven(one: Evaluation) -> str:
    """Return what was recorded of the decisions, as the end of a sentence."""
    return (
        f" (obstacles passed: {one.avoidances}, changes of side: {one.side_changes}, nearest to the"
        f" goal: {one.nearest_goal_m:.2f} m)"
    )
