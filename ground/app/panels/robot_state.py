"""Make the side panel: pose, goal, state, sonars, and the cost of the control cycle."""

from math import degrees, inf, isfinite
from typing import Final

from ground.app.panels.aged import MISSING, aged, live, number, role_of
from ground.app.widgets.bars import EIGHTHS, bar
from ground.app.widgets.rows import Row, Span, cut, faint, head, row
from ground.client.status_line import PLACE_UNKNOWN, doing, knows_place
from ground.client.telemetry import AgedMessage
from ground.station.station import Station
from ground.text.state_roles import present_reason, state_role
from ground.text.wording import SONARS
from protocol.topics import CYCLE, DECISION, ODOMETRY, SONAR, STATUS
from protocol.wire.enums import GoalState
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from protocol.wire.reasons import reason_text

WIDTH: Final = 30
BAR: Final = 13
BARS: Final = f"{EIGHTHS.strip()}·"
STAGES: Final = "rongw"
"""Read, odometry, navigate, guard, write."""


def side_rows(station: Station, height: int, width: int = WIDTH) -> list[Row]:
    """Return the rows of all parts, separated by blank rows if there is space.

    With little space, sonars are shown as numbers only.
    """
    cycle = cycle_rows(station.seen(CYCLE), station.worst_cycle)
    parts = [place_rows(station), sonar_rows(station), cycle]
    if height < sum(map(len, parts)):
        parts = [place_rows(station)[:4], dense_sonar_rows(station), cycle[:1]]
    spare = height - sum(map(len, parts))
    rows: list[Row] = []
    for part in parts:
        if rows and spare > 0:
            rows.append(())
            spare -= 1
        rows += part
    return [cut(row, width) for row in rows]


def place_rows(station: Station) -> list[Row]:
    """Return pose, goal, distance, speed, state and the reason for it."""
    odometry, status = station.seen(ODOMETRY), station.seen(STATUS)
    remedy = station.place_remedy
    pose = aged(odometry, pose_words, "danger" if remedy else "text")
    why = why_words(live(status))
    return [
        row(head("pose  "), pose),
        *([row(head("      "), Span(f":{remedy}", "caution"))] if remedy else []),
        row(head("goal  "), aged(status, goal_words, "goal")),
        row(
            head("dist  "), aged(status, distance_words), head("  v "), aged(odometry, speed_words)
        ),
        row(head("state "), *state_spans(status, station.seen(DECISION))),
        *([row(head("why   "), Span(why, role_of(status, "caution")))] if why else []),
    ]


def pose_words(odometry: PlanarOdometry) -> str:
    """Return x, y and heading as text."""
    if not knows_place(odometry):
        return PLACE_UNKNOWN
    deg = whole(degrees(odometry.heading_rad))
    return f"{number(odometry.x_m, '6.2f')} {number(odometry.y_m, '6.2f')}  {number(deg, '4.0f')}°"


def whole(deg: float) -> float:
    """Round to whole degrees, without a minus zero."""
    return round(deg) + 0.0 if isfinite(deg) else deg


def goal_words(status: NavigatorStatus) -> str:
    """Return the goal as text."""
    if status.goal == GoalState.NONE:
        return "none"
    heading = number(whole(degrees(status.goal_heading_rad)), "4.0f", " any")
    degree = "°" if isfinite(status.goal_heading_rad) else ""
    return f"{number(status.goal_x_m, '6.2f')} {number(status.goal_y_m, '6.2f')}  {heading}{degree}"


def distance_words(status: NavigatorStatus) -> str:
    """Return the distance to the goal as text."""
    return f"{number(status.goal_distance_m, '6.2f')} m"


def speed_words(odometry: PlanarOdometry) -> str:
    """Return the speed as text."""
    return f"{number(odometry.speed_m_s, '.2f')} m/s"


def why_words(status: NavigatorStatus | None) -> str:
    """Return the reason of the vehicle's or the goal's state, or ""."""
    reason = 0 if status is None else present_reason(status)
    return reason_text(reason) if reason else ""


def state_spans(status: AgedMessage, decision: AgedMessage) -> list[Span]:
    """Return the state, and the angle γ between the chosen direction and the goal."""
    turned: AvoidanceDecision | None = live(decision)
    now: NavigatorStatus | None = live(status)
    role = "faint" if now is None else state_role(now)
    spans = [aged(status, lambda status: f"{doing(status).upper():<10}", role)]
    if turned is not None and isfinite(turned.rotation_rad):
        angle = f"γ {degrees(turned.rotation_rad):+.0f}°"
        spans += [Span(" "), Span(angle, role_of(decision, "virtual"))]
    return spans


def sonar_rows(station: Station) -> list[Row]:
    """Return a row for each sonar from left to right.

    `!` marks an echo within the zone, `!!` one within the distance at which the guard stops.
    """
    seen = station.seen(SONAR)
    scan: SonarScan | None = live(seen)
    decision: AvoidanceDecision | None = live(station.seen(DECISION))
    zone_m = decision.zone_m if decision is not None else -inf
    stop_m = parameter(station, "guard_stop_m", -inf)
    longest_m = parameter(station, "sonar_max_m", 3.0)
    rows: list[Row] = []
    for index in reversed(range(len(SONARS))):
        name = head(f"{SONARS[index]} ")
        if scan is None:
            rows.append(row(name, faint("·" * BAR), faint(f" {aged(seen, lambda _: '').text}")))
            continue
        rows.append(row(name, *echo_spans(range_of(scan, index), zone_m, stop_m, longest_m, seen)))
    return rows


def dense_sonar_rows(station: Station) -> list[Row]:
    """Return two rows of ranges: the left and the right sonars, each from the outside in."""
    every = [
        row(*(Span(span.text.strip(BARS), span.role) for span in one))
        for one in sonar_rows(station)
    ]
    left, right = every[:4], every[:3:-1]
    return [
        row(head("left  "), *(span for one in left for span in one[1:])),
        row(head("right "), *(span for one in right for span in one[1:])),
    ]


def range_of(scan: SonarScan, index: int) -> float | None:
    """Return a range in metres: inf without an echo, None when the sonar is missing."""
    bit = 1 << index
    if not scan.valid & bit:
        return None
    return scan.range_mm[index] / 1000 if scan.echo & bit else inf


def echo_spans(
    range_m: float | None, zone_m: float, stop_m: float, longest_m: float, seen: AgedMessage
) -> list[Span]:
    """Return a bar and the range of one sonar."""
    if range_m is None:
        return [faint("·" * BAR), faint(f"   {MISSING}")]
    if range_m == inf:
        return [Span(bar(1.0, BAR), role_of(seen, "ok")), faint("  none")]
    near, marks = "ok", ""
    if range_m < stop_m:
        near, marks = "danger", " !!"
    elif range_m < zone_m:
        near, marks = "caution", " !"
    painted = Span(bar(range_m / longest_m, BAR), role_of(seen, near))
    return [painted, Span(f" {range_m:5.2f}", role_of(seen)), Span(marks, near)]


def parameter(station: Station, name: str, otherwise: float) -> float:
    """Return the value of a parameter, or `otherwise` when it is unknown."""
    for one in station.parameters or ():
        if one.name == name:
            return float(one.value)
    return otherwise


def cycle_rows(seen: AgedMessage, report: CycleReport | None) -> list[Row]:
    """Return the most expensive control cycle of the last second, and its stages.

    The cost is compared with the budget; stages are in microseconds.
    """
    if live(seen) is None or report is None:
        return [row(head("cycle "), aged(seen, lambda _: "")), ()]
    spent, budget = sum(report.stage_us), report.budget_us
    over = "danger" if spent > budget else "mission"
    gauge = Span(bar(spent / budget if budget else 1.0, 8), role_of(seen, over))
    marks = Span(" !", "danger") if spent > budget else Span("")
    stages = zip(STAGES, report.stage_us, strict=True)
    shares = (
        piece for name, us in stages for piece in (head(f"{name}"), Span(f"{us} ", role_of(seen)))
    )
    return [
        row(head("cycle≤ "), gauge, Span(f" {spent}/{budget} us", role_of(seen)), marks),
        row(*shares),
    ]
