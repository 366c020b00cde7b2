"""Make the key bar: the keys of the present screen, those that the operator needs next first.

The state of the robot and of the draft decides which those are.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.input.keymap import SET_OFF, KeyBinding, Situation, keys_for, shown
from ground.app.panels.aged import live
from ground.app.stops.band import lost_in
from ground.app.widgets.rows import Span, row
from ground.client.lost_drive import NOTHING
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


def keys_when(situation: Situation) -> tuple[NextKey, ...]:
    """Return the keys that the table names for a situation, the first one first."""
    return tuple(
        NextKey(key.id, one.name or key.short, one.presses, one.others)
        for key, one in keys_for(situation)
    )


STOP_STATES: Final = (Vehicle.EMERGENCY_STOP, Vehicle.FAILSAFE)
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
    return (START_MISSION,) if mission_is_ready(station) and not station.place_remedy else ()


def next_keys(station: Station, draft: tuple[MapTarget, ...]) -> tuple[NextKey, ...]:
    """Return the keys that continue from the present state, the first one first."""
    status = live(station.seen(STATUS))
    if not isinstance(status, NavigatorStatus):
        return ()
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        return keys_when(Situation.STOPPED)
    lost = lost_in(station, status) is not None
    if status.vehicle == Vehicle.FAILSAFE:
        return way_out(status, lost=lost)
    mission = mission_keys(station, draft)
    if status.goal in DRIVING:
        held = status.mode == Mode.HOLD
        return (*mission, *keys_when(Situation.HELD if held else Situation.UNDER_WAY))
    if mission or not lost:
        return (*mission, *keys_when(Situation.IDLE))
    return way_out(status, lost=lost)


def way_out(status: NavigatorStatus, *, lost: bool) -> tuple[NextKey, ...]:
    """Return the keys that lead from a stop to driving; on to the goal, if that was lost."""
    needed = {
        "place": status.vehicle == Vehicle.FAILSAFE
        and status.vehicle_reason == Reason.FENCE_UNCHECKED,
        "arm": status.vehicle != Vehicle.ACTIVE,
        "resume": lost,
    }
    return tuple(one for one in keys_when(Situation.WAY_OUT) if needed.get(one.id, True))


def cursor_keys(station: Station, draft: tuple[MapTarget, ...]) -> tuple[NextKey, ...]:
    """Return the keys of the cursor, with that of the mission behind the first two.

    While the robot is stopped, the keys that lead out of the stop come instead.
    """
    status = live(station.seen(STATUS))
    if isinstance(status, NavigatorStatus) and status.vehicle in STOP_STATES:
        return next_keys(station, draft)
    keys = keys_when(Situation.CURSOR)
    return (*keys[:2], *mission_keys(station, draft), *keys[2:])


def refusal_of(key: KeyBinding, station: Station) -> str:
    """Return why a key would be refused in the state that is shown; empty if it is accepted.

    What stops or holds the robot is never refused here, nor the release of a stop that may have
    been lost from sight.
    """
    if not (station.live and key.needs_lease):
        return ""
    if station.lease.others:
        return station.lease.taken
    if key.id == "clear-estop":
        return ""
    loss = station.loss()
    if loss is not None:
        return f"{loss.kind.value.lower()}: {loss.cause}"
    if not station.ready:
        return f"reading {station.waiting_for}"
    if key.id in SET_OFF and station.place_remedy:
        return f"place unknown: `{station.place_remedy}` first"
    status = live(station.seen(STATUS))
    if key.id == "resume" and isinstance(status, NavigatorStatus):
        is_kept = status.goal in DRIVING or lost_in(station, status) is not None
        return "" if is_kept else NOTHING
    return ""


STOPS: Final = ("estop-here", "estop")
STOP: Final = "E-STOP"
LAST: Final = ("palette", "help")
Sides = tuple[list[Button], list[Button]]


def key_buttons(keys: Sequence[KeyBinding], width: int, following: Sequence[NextKey] = ()) -> Sides:
    """Return as many keys as fit, each once: the stop, the keys that follow now, all others.

    The palette and the help keep their place at the end.
    """
    known = {key.id: key for key in keys if key.keys}
    stop = next((known[id] for id in STOPS if id in known), None)
    first = [one for one in following if one.id in known]
    taken = {*STOPS, *LAST, *(id for one in first for id in (one.id, *one.others))}
    others = [key for key in known.values() if key.short and key.id not in taken]
    others.sort(key=lambda key: key.bar)
    tail = [button(known[id], known[id].short) for id in LAST if id in known]
    buttons = [
        *([] if stop is None else [button(stop, STOP, "alarm")]),
        *(
            button(known[one.id], one.name, presses=one.presses, others=keys_of(one.others, known))
            for one in first
        ),
        *(button(key, key.short) for key in others),
    ]
    room = width - buttons_width(tail)
    while buttons and buttons_width(buttons) > room:
        buttons.pop()
    return buttons, tail


def keys_of(ids: Sequence[str], known: Mapping[str, KeyBinding]) -> str:
    """Return the first keys of these actions, as they are shown."""
    return "".join(shown(known[id].keys[:1]) for id in ids if id in known)


def button(
    key: KeyBinding, name: str, role: str = "key", *, presses: int = 1, others: str = ""
) -> Button:
    """Return a button: the key, repeated as often as it must be pressed, `others`, and a name."""
    words = " ".join([shown(key.keys[:1])] * presses) + others
    return Button(row(" ", Span(words, role), Span(f" {name} ")), f"do('{key.id}')")
