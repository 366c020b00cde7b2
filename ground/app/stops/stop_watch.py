"""Notice that a robot stops or arrives: each event once, for all watched robots."""

from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from ground.client.telemetry import Age
from ground.station.fleet import RosterEntry
from ground.station.station import Station
from protocol.bus.network import MAX_ROBOTS
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import reason_text
from runtime.units import NS_PER_MS

MOST_KEPT: Final = 2 * MAX_ROBOTS
"""With more robots, those that are watched no more are forgotten."""
ARRIVED_NS: Final = 500 * NS_PER_MS
"""A goal that is reached for this long was the last one: a mission sets its next goal at once."""


class EventKind(Enum):
    """The events that an operator is called for."""

    EMERGENCY_STOP = "EMERGENCY STOP"
    FAILSAFE = "FAILSAFE"
    REACHED = "goal reached"


KNOWN: Final = frozenset(Vehicle)
STOPPED: Final = {
    Vehicle.EMERGENCY_STOP: EventKind.EMERGENCY_STOP,
    Vehicle.FAILSAFE: EventKind.FAILSAFE,
}


class StopEvent(NamedTuple):
    """A robot has stopped or arrived; `cause` is empty without a reason."""

    robot: str
    kind: EventKind
    cause: str = ""


class GoalKey(NamedTuple):
    """What tells one goal of a robot from the next."""

    goal_id: int
    started_ns: int


@dataclass(slots=True)
class Watched:
    """What was seen of one robot; `since_ns` is when its vehicle state began to be seen."""

    vehicle: int
    since_ns: int
    under_way: GoalKey | None = None
    reached_ns: int | None = None


class StopWatch:
    """Compares the status of each robot with the one before.

    A robot that disappears keeps its state, so that its return is no new event.
    """

    def __init__(self) -> None:
        self._station: Station | None = None
        self._robots: dict[str, Watched] = {}
        self._looked: dict[str, RosterEntry] = {}
        """The entries that were compared last: each is another one when its robot was polled."""

    def look(self, station: Station) -> list[StopEvent]:
        """Note the present states and return what has happened since the last look."""
        if station is not self._station:
            self._station, self._robots, self._looked = station, {}, {}
        events: list[StopEvent] = []
        roster = station.roster()
        if max(len(self._robots), len(self._looked)) > MOST_KEPT:
            names = {entry.robot for entry in roster}
            self._robots = {robot: one for robot, one in self._robots.items() if robot in names}
            self._looked = {}
        for entry in roster:
            if self._looked.get(entry.robot) is entry:
                continue
            self._looked[entry.robot] = entry
            status = entry.status.message
            if isinstance(status, NavigatorStatus) and entry.status.age is not Age.GONE:
                events += self._compare(entry.robot, status, station.now_ns)
        return events

    def since_ns(self, robot: str) -> int | None:
        """Return when the present vehicle state of a robot was first seen."""
        watched = self._robots.get(robot)
        return None if watched is None else watched.since_ns

    def is_stopped(self, robot: str, kind: EventKind) -> bool:
        """Return whether a robot was last seen in the stop of a kind."""
        watched = self._robots.get(robot)
        return watched is not None and any(
            watched.vehicle == vehicle and kind is stop for vehicle, stop in STOPPED.items()
        )

    def _compare(self, robot: str, status: NavigatorStatus, now_ns: int) -> list[StopEvent]:
        before = self._robots.get(robot)
        watched = before or self._robots.setdefault(robot, Watched(status.vehicle, now_ns))
        events: list[StopEvent] = []
        if before is None or watched.vehicle != status.vehicle:
            watched.vehicle, watched.since_ns = status.vehicle, now_ns
            kind = STOPPED.get(Vehicle(status.vehicle)) if is_known(status.vehicle) else None
            if kind is not None:
                cause = reason_text(status.vehicle_reason) if status.vehicle_reason else ""
                events.append(StopEvent(robot, kind, cause))
        if has_arrived(watched, status, now_ns):
            events.append(StopEvent(robot, EventKind.REACHED))
        return events


def is_known(vehicle: int) -> bool:
    """Return whether this station knows a vehicle state."""
    return vehicle in KNOWN


def has_arrived(watched: Watched, status: NavigatorStatus, now_ns: int) -> bool:
    """Note the state of the goal; return True once, when a goal that was under way is reached."""
    key = GoalKey(status.goal_id, status.goal_started_ns)
    if GoalState.ACCEPTED <= status.goal <= GoalState.ALIGNING:
        watched.under_way, watched.reached_ns = key, None
        return False
    if status.goal != GoalState.REACHED or watched.under_way != key:
        watched.under_way = None
        return False
    if watched.reached_ns is None:
        watched.reached_ns = now_ns
    if now_ns - watched.reached_ns < ARRIVED_NS:
        return False
    watched.under_way = None
    return True
