"""The properties that a navigator must have, scores of a drive for each, and time limits."""

from dataclasses import dataclass
from math import inf, pi
from typing import Final, NamedTuple

from plant.model.configuration import body_of
from plant.model.geometry import edges, length_m
from protocol.outcome import RunOutcome
from protocol.wire.reasons import Reason
from protocol.world import World, WorldCircle, WorldPolygon

ELLIPSE: Final = 23.0
"""Largest squared Mahalanobis distance of the position: chi-square of two degrees at 1e-5."""

DETOUR: Final = 20.0
"""Default of the longest way that is no violation, as a multiple of the shortest."""

START_UP_S: Final = 60.0
"""Part of each time limit that does not depend on the world."""

REACH_FACTOR: Final = 25.0
MAX_REACH_S: Final = 900.0
LEAST_FACTOR: Final = 8.0
"""Time limit of a reachable goal: START_UP_S, and REACH_FACTOR times the shortest way at top speed.

It is at most MAX_REACH_S, but never less than START_UP_S and LEAST_FACTOR times the shortest way.
"""

LAPS: Final = 3.0
"""Time limit for an unreachable goal: START_UP_S, and this many laps along all walls at top speed.

A lap follows both sides of all walls, and the outer boundary.
"""

MIN_LENGTH_M: Final = 0.5
"""A path shorter than this counts as this long in ratios, since turning takes time, too."""


class Property(NamedTuple):
    """A property: its letter and its statement."""

    letter: str
    states: str


PROPERTIES: Final = (
    Property("a", "a reachable goal is reached in time"),
    Property("b", "a goal that is called unreachable is unreachable"),
    Property("c", "the robot touches nothing by its own motion"),
    Property(
        "d", f"the position error is within the claimed ellipse (chi-square {ELLIPSE:g}: 1 in 10^5)"
    ),
    Property("e", "the way is at most K times the shortest (--detour K)"),
    Property("f", "an unreachable goal is recognised in time"),
)
LETTERS: Final = "".join(one.letter for one in PROPERTIES)


class LapRecord(NamedTuple):
    """The last lap along a boundary: its length, and the gaps that its chain of echoes crossed."""

    length_m: float
    gaps: int


class ContactRecord(NamedTuple):
    """The first contact: the thing touched, the speed, and the last echo of the sonar towards it.

    `is_in_view`: a sonar points there. `range_m` and `age_s` are None if it has had no echo.
    """

    touched: str
    speed_m_s: float
    is_in_view: bool
    range_m: float | None
    age_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """One trial: its world and seed, its end, its records, and the properties it violates.

    `kind` is the kind of end, a part of the class of a finding. `scores` has one number for each
    property, larger nearer to a violation; -inf where the property states nothing.
    """

    world: World
    seed: int
    kind: str
    violated: str
    scores: dict[str, float]
    outcome: RunOutcome
    goal_reason: int
    avoidances: int
    side_changes: int
    mahalanobis2: float
    nearest_goal_m: float
    contact_branch: int
    moved_late_m: float
    lap: LapRecord | None = None
    contact: ContactRecord | None = None


def time_limit_s(world: World) -> float:
    """Return the time limit of a trial in a world whose shortest path is known."""
    speed_m_s = body_of(world).max_speed_m_s
    if world.shortest_path_m is None:
        return round(START_UP_S + LAPS * both_sides_m(world) / speed_m_s)
    wanted_s = START_UP_S + REACH_FACTOR * max(MIN_LENGTH_M, world.shortest_path_m) / speed_m_s
    least_s = START_UP_S + LEAST_FACTOR * world.shortest_path_m / speed_m_s
    return round(max(least_s, min(wanted_s, MAX_REACH_S)))


def both_sides_m(world: World) -> float:
    """Return the length of a way once along both sides of all walls and along the rim."""
    total_m = 2.0 * (world.size_m[0] + world.size_m[1])
    for obstacle in world.obstacles:
        if isinstance(obstacle, WorldCircle):
            total_m += 2.0 * pi * obstacle.radius_m
        elif isinstance(obstacle, WorldPolygon):
            total_m += length_m(
                [point for edge in edges(obstacle.points_m, closed=True) for point in edge]
            )
        else:
            total_m += 2.0 * length_m(obstacle.points_m)
    return total_m


def violated_by(
    outcome: RunOutcome, reason: int, mahalanobis2: float, detour: float, *, reachable: bool
) -> str:
    """Return the letters of the violated properties."""
    claimed = reason == Reason.UNREACHABLE
    found = ""
    if reachable and not outcome.reached and not claimed and not outcome.own_contacts:
        found += "a"
    if reachable and claimed:
        found += "b"
    if outcome.own_contacts:
        found += "c"
    if mahalanobis2 > ELLIPSE:
        found += "d"
    if reachable and outcome.reached and ratio_of(outcome) > detour:
        found += "e"
    if not reachable and not claimed and not outcome.own_contacts:
        found += "f"
    return found


def ratio_of(outcome: RunOutcome) -> float:
    """Return the length of the way as a multiple of the shortest."""
    return outcome.path_m / max(MIN_LENGTH_M, outcome.shortest_path_m or 0.0)


def scores_of(
    outcome: RunOutcome, mahalanobis2: float, limit_s: float, *, reachable: bool
) -> dict[str, float]:
    """Return the score of each property.

    A wrong claim follows loops, and loops lengthen the way, so that the ratio is the score of (b).
    """
    ratio = ratio_of(outcome) if reachable else -inf
    late = outcome.time_s / limit_s
    return {
        "a": late if reachable else -inf,
        "b": ratio,
        "c": -outcome.min_clearance_m,
        "d": mahalanobis2,
        "e": ratio,
        "f": -inf if reachable else late,
    }
