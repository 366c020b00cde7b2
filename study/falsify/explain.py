"""One sentence on a failure, from what was recorded of its trial."""

from protocol.wire.reasons import Reason, reason_text
from robot.core import states
from study.falsify.properties import ELLIPSE, Evaluation, ratio_of

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
        return f"{navigator} calls the goal unreachable {spent} {exists}{_driven(one)}."
    if letter == "c":
        place = BRANCHES.get(one.contact_branch, "while it stands or turns")
        return (
            f"{navigator} touches something by its own motion {place}, at the latest {spent}"
            f"{_driven(one)}."
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


def _driven(one: Evaluation) -> str:
    """Return what was recorded of the decisions, as the end of a sentence."""
    return (
        f" (obstacles passed: {one.avoidances}, changes of side: {one.side_changes}, nearest to the"
        f" goal: {one.nearest_goal_m:.2f} m)"
    )
