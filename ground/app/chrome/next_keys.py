"""Find the keys that the operator needs next, by the state of the robot and of the draft."""

from typing import Final, NamedTuple

from ground.app.panels.aged import live
from ground.app.stops.band import lost_in
from ground.map.scene import MapTarget
from ground.station.station import Station
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import MissionStatus, NavigatorStatus
from protocol.wire.reasons import Reason

DRIVING: Final = (GoalState.ACCEPTED, GoalState.DRIVING, GoalState.AVOIDING, GoalState.ALIGNING)


class NextKey(NamedTuple):
    """An action by id, its name on the key bar, and how often its key must be pressed.

    `others` are ids whose keys are shown, too, such as those of the other directions.
    """

    id: str
    name: str
    presses: int = 1
    others: tuple[str, ...] = ()


STOPS: Final = (Vehicle.EMERGENCY_STOP, Vehicle.FAILSAFE)
CURSOR: Final = (
    NextKey("goal-at-cursor", "Go"),
    NextKey("waypoint", "Waypoint"),
    NextKey("cursor-up", "Move", others=("cursor-down", "cursor-left", "cursor-right")),
    NextKey("map-menu", "Menu"),
    NextKey("cursor-turn-right", "Heading"),
    NextKey("leave-cursor", "Close"),
)
TELEOP: Final = (NextKey("teleop-end", "End"),)
FILTER: Final = NextKey("find", "Filter")
FILTERED: Final = (NextKey("close", "Clear filter"),)
REPLAY: Final = (
    NextKey("replay-play", "Play"),
    NextKey("replay-on", "Step"),
    NextKey("replay-mark", "Mark"),
    NextKey("replay-open", "Open"),
)
STOPPED: Final = (NextKey("clear-estop", "Clear E-STOP", 2),)
PLACE: Final = NextKey("place", "Set the place")
ARM: Final = NextKey("arm", "Arm")
GO_ON: Final = NextKey("resume", "Go on")
GOAL: Final = NextKey("goal", "Goal")
HELD: Final = (NextKey("resume", "Resume"), NextKey("abort", "Abort"), NextKey("goal", "Goal"))
UNDER_WAY: Final = (NextKey("hold", "Hold"), NextKey("abort", "Abort"), NextKey("explain", "Why"))
IDLE: Final = (NextKey("goal", "Goal"), NextKey("cursor", "Cursor"), NextKey("arm", "Arm"))
START_MISSION: Final = NextKey("missions", "Start mission")


def unsent(draft: tuple[MapTarget, ...], station: Station) -> tuple[MapTarget, ...]:
    """Return the waypoints of the draft, until the robot has them."""
    return () if draft == station.mission_items else draft


def mission_is_ready(station: Station) -> bool:
    """Return whether the robot has a mission that was not started."""
    mission = live(station.seen(MISSION))
    return isinstance(mission, MissionStatus) and mission.state == MissionState.READY


def mission_keys(station: Station, draft: tuple[MapTarget, ...]) -> tuple[NextKey, ...]:
    """Return the key that sends the draft, or that starts the mission which was sent, if any."""
    waypoints = len(unsent(draft, station))
    if waypoints:
        return (NextKey("missions", f"Send {waypoints} waypoint{'s' * (waypoints > 1)}"),)
    return (START_MISSION,) if mission_is_ready(station) else ()


def next_keys(station: Station, draft: tuple[MapTarget, ...]) -> tuple[NextKey, ...]:
    """Return the keys that continue from the present state, the first one first."""
    status = live(station.seen(STATUS))
    if not isinstance(status, NavigatorStatus):
        return ()
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        return STOPPED
    lost = lost_in(station, status) is not None
    if status.vehicle == Vehicle.FAILSAFE:
        place = (PLACE,) if status.vehicle_reason == Reason.FENCE_UNCHECKED else ()
        return (*place, ARM, GO_ON, GOAL) if lost else (*place, ARM, GOAL)
    mission = mission_keys(station, draft)
    if status.goal in DRIVING:
        return (*mission, *(HELD if status.mode == Mode.HOLD else UNDER_WAY))
    if mission or not lost:
        return (*mission, *IDLE)
    return (GO_ON, GOAL) if status.vehicle == Vehicle.ACTIVE else (ARM, GO_ON, GOAL)


def cursor_keys(station: Station, draft: tuple[MapTarget, ...]) -> tuple[NextKey, ...]:
    """Return the keys of the cursor, with that of the mission behind the first two.

    While the robot is stopped, the keys that lead out of the stop come instead.
    """
    status = live(station.seen(STATUS))
    if isinstance(status, NavigatorStatus) and status.vehicle in STOPS:
        return next_keys(station, draft)
    return (*CURSOR[:2], *mission_keys(station, draft), *CURSOR[2:])
