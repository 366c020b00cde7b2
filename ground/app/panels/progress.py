"""Show the way to the goal: distance, time driven, time left, share done, and the waypoint."""

from typing import Final

from ground.app.panels.aged import MISSING, aged, live, number, role_of
from ground.app.widgets.bars import bar
from ground.app.widgets.rows import Row, Span, faint, head, row, width_of
from ground.client.telemetry import AgedMessage
from ground.station.station import Station
from protocol.outcome import LOST, doubt_of, doubt_words, goal_end
from protocol.topics import MISSION, ODOMETRY, STATUS
from protocol.wire.enums import GoalState, MissionState
from protocol.wire.messages import MissionStatus, NavigatorStatus, PlanarOdometry
from runtime.units import NS_PER_S

LEAST_BAR: Final = 8
FULL: Final = 40
"""From so many columns on, the time driven is named."""
UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)
ENDED: Final = (GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED)


def progress_rows(station: Station, width: int) -> list[Row]:
    """Return the distance with the times, and a bar with the share of the way."""
    seen = station.seen(STATUS)
    status: NavigatorStatus | None = live(seen)
    if status is None:
        return [row(head("to go "), aged(seen, lambda _: "")), bar_row(None, (), width, "faint")]
    if status.goal in (GoalState.NONE, GoalState.REFUSED) or not status.goal_id:
        return [row(faint("no goal")), bar_row(None, (), width, "faint")]
    share = station.progress.share
    waypoint = waypoint_words(station)
    after = (Span(f"  {waypoint}", "mission"),) if waypoint else ()
    return [
        row(head("to go "), *way_spans(station, status, seen, width)),
        bar_row(share, after, width, role_of(seen, "goal")),
    ]


def way_spans(station: Station, status: NavigatorStatus, seen: AgedMessage, width: int) -> Row:
    """Return distance, time driven and time left; the outcome when the goal has ended."""
    role = role_of(seen)
    driven = f"{driven_s(status):.1f} s"
    if status.goal in ENDED:
        words = f"{end_words(status)} {driven}{doubt_after(station, status)}"
        return row(Span(f"{number(status.goal_distance_m)} m  {words}", role))
    left_s = station.progress.left_s
    left = MISSING if left_s is None else f"~{left_s:.0f}"
    return row(
        Span(f"{number(status.goal_distance_m, '5.2f')} m ", role),
        Span(f"{driven:>7} {'driven ' if width >= FULL else ''}", role_of(seen, "faint")),
        Span(f"{left:>4} s left", role),
    )


def end_words(status: NavigatorStatus) -> str:
    """Return how the goal ended, as the beginning of a duration."""
    end = goal_end(status.goal, status.goal_reason)
    return "reached in" if end == "reached" else f"{end} after"


def doubt_after(station: Station, status: NavigatorStatus) -> str:
    """Return the doubt about the position of a robot that is lost, else an empty text."""
    pose: PlanarOdometry | None = live(station.seen(ODOMETRY))
    if goal_end(status.goal, status.goal_reason) != LOST:
        return ""
    return f", {doubt_words(None if pose is None else doubt_of(pose))}"


def bar_row(share: float | None, after: Row, width: int, role: str) -> Row:
    """Return a bar in the whole width, with the share in percent and what follows it."""
    percent = f" {MISSING if share is None else f'{100.0 * share:.0f}':>3} %"
    cells = max(LEAST_BAR, width - len(percent) - width_of(after))
    return row(Span(bar(share or 0.0, cells), role), Span(percent, role), *after)


def driven_s(status: NavigatorStatus) -> float:
    """Return how long the goal has been driven to, by the robot's clock."""
    until_ns = status.goal_ended_ns or status.time_ns
    return (until_ns - status.goal_started_ns) / NS_PER_S


def waypoint_words(station: Station) -> str:
    """Return which waypoint of the mission is under way; empty without a running mission."""
    status = live(station.seen(MISSION))
    if not isinstance(status, MissionStatus) or status.state not in UNDER_WAY:
        return ""
    return f"waypoint {min(status.current + 1, status.count)} of {status.count}"
