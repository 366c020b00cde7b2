"""Test that the key bar begins with the keys that continue from the present state."""

import msgspec

from ground.app.chrome.button_row import ButtonRow
from ground.app.chrome.key_bar import next_keys
from ground.app.input.keymap import KEYS, Keymap
from ground.app.stops.band import next_steps
from ground.app.widgets.rows import words_of
from ground.map.scene import MapTarget
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.underway import driving, status

WAYS = (MapTarget(1.0, 2.0), MapTarget(3.0, 4.0, 0.0))


def station_in(vehicle: Vehicle, goal: GoalState, mode: Mode) -> FakeStation:
    station = driving(FakeStation())
    now_ns = station.now_ns
    message = msgspec.structs.replace(status(now_ns, goal, vehicle), mode=mode)
    station.air.put(STATUS, message, now_ns)
    return station


@each(
    ("vehicle", "goal", "mode", "begins"),
    [
        (Vehicle.EMERGENCY_STOP, GoalState.ABORTED, Mode.HOLD, "D D Clear E-STOP"),
        (Vehicle.FAILSAFE, GoalState.ABORTED, Mode.HOLD, "a Arm  r Go on  g Goal"),
        (Vehicle.FAILSAFE, GoalState.NONE, Mode.HOLD, "a Arm  g Goal"),
        (Vehicle.STANDBY, GoalState.ABORTED, Mode.HOLD, "a Arm  r Go on  g Goal"),
        (Vehicle.ACTIVE, GoalState.ABORTED, Mode.HOLD, "r Go on  g Goal"),
        (Vehicle.ACTIVE, GoalState.AVOIDING, Mode.GUIDED, "h Hold  x Abort  e Why"),
        (Vehicle.ACTIVE, GoalState.DRIVING, Mode.HOLD, "r Resume  x Abort  g Goal"),
        (Vehicle.ACTIVE, GoalState.REACHED, Mode.GUIDED, "g Goal  G Cursor  a Arm"),
    ],
)
def test_key_bar_follows_the_state(
    vehicle: Vehicle, goal: GoalState, mode: Mode, begins: str
) -> None:
    async def story() -> None:
        async with staged(station=station_in(vehicle, goal, mode)) as stage:
            assert stage.words("keybar").startswith(f" space E-STOP  {begins} ")

    play(story)


def test_key_bar_follows_cursor_teleop_and_typing() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("G")
            assert stage.words("keybar").startswith(
                " space E-STOP  enter Go  w Waypoint  ↑↓←→ Move "
            )
            await stage.press("escape", "t")
            assert stage.words("keybar").startswith(" space E-STOP  esc End  ↑ Forward ")
            assert "esc ends" in stage.words("prompt")
            await stage.press("escape")
            assert not stage.commands.teleop
            await stage.press(":")
            assert stage.words("keybar").startswith(" f12 E-STOP  tab Complete ")

    play(story)


def test_way_out_of_a_stop_comes_before_the_keys_of_the_cursor() -> None:
    async def story() -> None:
        station = station_in(Vehicle.EMERGENCY_STOP, GoalState.ABORTED, Mode.HOLD)
        async with staged(station=station) as stage:
            await stage.press("G")
            assert stage.words("keybar").startswith(" space E-STOP  D D Clear E-STOP ")

    play(story)


def test_one_key_sends_starts_and_lists_the_mission() -> None:
    async def story() -> None:
        station = station_in(Vehicle.STANDBY, GoalState.NONE, Mode.HOLD)
        async with staged(station=station) as stage:
            stage.commands.draft_items = WAYS
            await stage.redraw()
            assert stage.words("keybar").startswith(" space E-STOP  W Send 2 waypoints ")
            await stage.press("W")
            station.items_now = WAYS
            ready = MissionStatus(
                time_ns=station.now_ns, hold_left_ms=0, state=MissionState.READY, current=0,
                count=2, reason=0, mission_id=1,
            )  # fmt: skip
            station.air.put(MISSION, ready, station.now_ns)
            await stage.redraw()
            assert stage.words("keybar").startswith(" space E-STOP  W Start mission ")
            await stage.press("W")
            running = msgspec.structs.replace(ready, state=MissionState.RUNNING)
            station.air.put(MISSION, running, station.now_ns)
            await stage.press("W")
            assert stage.commands.given == ["wp upload", "mission start", "mission list"]

    play(story)


def test_waypoint_ends_the_heading_of_the_cursor() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("G", ">", "w", "right", "w")
            first, second = stage.commands.given
            assert len(first.split()) == len(second.split()) + 1

    play(story)


@each("opening", ["v", "ctrl+p", "?"])
def test_below_a_dialog_the_key_bar_names_only_keys_that_work(opening: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            screen = stage.app.screen
            await stage.press(opening)
            rows = screen.query_one("#keybar", ButtonRow).rows
            words = " ".join(words_of(one) for one in rows).split()
            assert words[:2] == ["f12", "E-STOP"]
            assert not {"Hold", "Abort", "space"} & set(words)
            await stage.press("escape")
            assert stage.words("keybar").startswith(" space E-STOP ")

    play(story)


KEY = Keymap()
ANY_KEY = {one.id for one in KEYS}


@each("vehicle", Vehicle)
@each("mode", Mode)
def test_every_state_and_mode_has_a_next_key(vehicle: Vehicle, mode: Mode) -> None:
    for goal in GoalState:
        found = next_keys(station_in(vehicle, goal, mode), ())
        assert found
        assert {one.id for one in found} <= ANY_KEY


@each("reason", [one for one in Reason if 30 <= one < 60])
def test_every_failsafe_leads_to_driving(reason: Reason) -> None:
    stopped = msgspec.structs.replace(
        status(0, GoalState.ABORTED, Vehicle.FAILSAFE), vehicle_reason=reason
    )
    keys = [step.key for step in next_steps(stopped, None, lambda id: KEY[id].keys[0])]
    first = {Reason.FENCE_BREACHED: [":fence off"], Reason.FENCE_UNCHECKED: ["i"]}
    assert keys == [*first.get(reason, []), "a", "g"]


def test_unchecked_fence_asks_for_the_place() -> None:
    station = station_in(Vehicle.FAILSAFE, GoalState.NONE, Mode.HOLD)
    shown = status(station.now_ns, GoalState.NONE, Vehicle.FAILSAFE)
    shown = msgspec.structs.replace(shown, vehicle_reason=Reason.FENCE_UNCHECKED)
    station.air.put(STATUS, shown, station.now_ns)
    assert [one.id for one in next_keys(station, ())] == ["place", "arm", "goal"]
