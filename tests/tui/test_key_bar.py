"""Tab bar, key bar and last answer: what fits, what comes next, and what a click does."""

from pathlib import Path

import msgspec
import pytest

from checks.harness.messages import make
from ground.app.chrome.answers import SHOWN_S, answer_row, hint_row
from ground.app.chrome.button_row import Button, ButtonRow, buttons_width
from ground.app.chrome.key_bar import key_buttons, next_keys
from ground.app.chrome.tabs import UnreadWarnings, tab_buttons
from ground.app.input.keymap import KEYS, Keymap, Layer
from ground.app.screens import SCREENS
from ground.app.start import is_first_start
from ground.app.stops.band import next_steps
from ground.app.widgets.rows import width_of, words_of
from ground.map.scene import MapTarget
from ground.station.history.event_log import EventLog, LogLine
from ground.station.link.loss import Loss, LossKind
from ground.station.robot.lease_state import LeaseView
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_S as S
from tests.support.app import FakeStation, driving, staged, status
from tests.support.each import each


@each("width", [0, 1, 20, 40, 80, 160])
def test_key_bar_fits_and_begins_with_the_stop(width: int) -> None:
    keys = Keymap().of(Layer.STOP, Layer.DRIVE, Layer.ROBOT, Layer.FLEET, Layer.STATION)
    left, right = key_buttons(keys, width)
    if width >= 40:
        assert buttons_width([*left, *right]) <= width
        assert words(left).startswith(" space E-STOP")
        assert words(right).endswith("? Help ")


def words(buttons: list[Button]) -> str:
    return "".join(words_of(one.row) for one in buttons)


@each(
    ("width", "text"),
    [
        (200, " 1 Drive  2 Plots ▌3 Params▐ 4 Log ▲2  5 Links  6 Worlds  7 Faults  8 Replay "),
        (80, " 1 Drive  2 Plots ▌3 Params▐ 4 Log ▲2  5 Links  6 Worlds  7 Faults  8 Replay "),
        (40, " 1  2 ▌3 Params▐ 4 ▲2  5  6  7  8 "),
        (20, "▌3 Params▐"),
        (3, "▌3 Params▐"),
    ],
)
def test_tabs_are_shortened_but_name_the_present_screen(width: int, text: str) -> None:
    assert words(tab_buttons("params", 2, width)) == text


def test_tabs_mark_the_present_screen_in_ascii() -> None:
    assert words(tab_buttons("drive", 0, 80, ascii_only=True)).startswith("[1 Drive] 2 Plots  3")


def test_warnings_are_unread_until_the_log_is_shown() -> None:
    unread, log = UnreadWarnings(), EventLog()
    for severity in (Severity.WARNING, Severity.INFO, Severity.CRITICAL):
        log.add(LogLine(0.0, severity, "r1", "text"))
    unread.look(log, reading=False)
    unread.look(log, reading=False)
    assert unread.count == 2
    unread.look(log, reading=True)
    log.add(LogLine(1.0, Severity.WARNING, "r1", "text"))
    unread.look(log, reading=False)
    assert unread.count == 1


async def test_click_on_a_tab_shows_its_screen() -> None:
    async with staged() as stage:
        await stage.pilot.click("#tabs", offset=(stage.words("tabs").index("Links"), 0))
        await stage.redraw()
        assert stage.app.current_mode == "links"
        assert "▌5 Links▐" in stage.words("tabs")


async def test_click_on_the_stop_in_the_key_bar_stops() -> None:
    async with staged() as stage:
        await stage.pilot.click("#keybar", offset=(stage.words("keybar").index("E-STOP"), 0))
        assert stage.station.stops == 1


async def test_warnings_are_counted_on_the_tab_of_the_log() -> None:
    async with staged() as stage:
        stage.station.note("refused", Severity.WARNING)
        await stage.redraw()
        assert "4 Log ▲1" in stage.words("tabs")
        await stage.press("4", "1")
        assert "▲" not in stage.words("tabs")


@each("size", [(20, 5), (40, 12), (80, 24), (200, 60)])
async def test_tab_bar_leaves_room_on_a_low_terminal(size: tuple[int, int]) -> None:
    async with staged(size) as stage:
        assert stage.app.screen.query_one("#tabs").display == (size[1] >= 10)
        assert stage.app.screen.query_one("#keybar").region.bottom == size[1]


WAYS = (MapTarget(1.0, 2.0), MapTarget(3.0, 4.0, 0.0))


def station_in(vehicle: Vehicle, goal: GoalState, mode: Mode) -> FakeStation:
    station = driving(FakeStation())
    now_ns = station.now_ns
    message = msgspec.structs.replace(status(now_ns, goal, vehicle), mode=mode)
    station.bus.say(STATUS, message)
    return station


def ready_mission(now_ns: int) -> MissionStatus:
    return make(MissionStatus, time_ns=now_ns, state=MissionState.READY, count=2, mission_id=1)


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
async def test_key_bar_follows_the_state(
    vehicle: Vehicle, goal: GoalState, mode: Mode, begins: str
) -> None:
    async with staged(station=station_in(vehicle, goal, mode)) as stage:
        assert stage.words("keybar").startswith(f" space E-STOP  {begins} ")


async def test_key_bar_follows_cursor_teleop_and_typing() -> None:
    async with staged() as stage:
        await stage.press("G")
        assert stage.words("keybar").startswith(" space E-STOP  enter Go  w Waypoint  ↑↓←→ Move ")
        await stage.press("escape", "t")
        assert stage.words("keybar").startswith(" space E-STOP  esc End  ↑ Forward ")
        assert "esc ends" in stage.words("prompt")
        await stage.press("escape")
        assert not stage.commands.teleop
        await stage.press(":")
        assert stage.words("keybar").startswith(" f12 E-STOP  tab Complete ")


async def test_way_out_of_a_stop_comes_before_the_keys_of_the_cursor() -> None:
    station = station_in(Vehicle.EMERGENCY_STOP, GoalState.ABORTED, Mode.HOLD)
    async with staged(station=station) as stage:
        await stage.press("G")
        assert stage.words("keybar").startswith(" space E-STOP  D D Clear E-STOP ")


async def test_one_key_sends_starts_and_lists_the_mission() -> None:
    station = station_in(Vehicle.STANDBY, GoalState.NONE, Mode.HOLD)
    async with staged(station=station) as stage:
        stage.commands.draft_items = WAYS
        await stage.redraw()
        assert stage.words("keybar").startswith(" space E-STOP  W Send 2 waypoints ")
        await stage.press("W")
        station.mission_items_now = WAYS
        ready = ready_mission(station.now_ns)
        station.bus.say(MISSION, ready)
        await stage.redraw()
        assert stage.words("keybar").startswith(" space E-STOP  W Start mission ")
        await stage.press("W")
        running = msgspec.structs.replace(ready, state=MissionState.RUNNING)
        station.bus.say(MISSION, running)
        await stage.press("W")
        assert stage.commands.given == ["wp upload", "mission start", "mission list"]


async def test_waypoint_ends_the_heading_of_the_cursor() -> None:
    async with staged() as stage:
        await stage.press("G", ">", "w", "right", "w")
        first, second = stage.commands.given
        assert len(first.split()) == len(second.split()) + 1


@each("opening", ["v", "ctrl+p", "?"])
async def test_below_a_dialog_the_key_bar_names_only_keys_that_work(opening: str) -> None:
    async with staged() as stage:
        screen = stage.app.screen
        await stage.press(opening)
        rows = screen.query_one("#keybar", ButtonRow).rows
        words = " ".join(words_of(one) for one in rows).split()
        assert words[:2] == ["f12", "E-STOP"]
        assert not {"Hold", "Abort", "space"} & set(words)
        await stage.press("escape")
        assert stage.words("keybar").startswith(" space E-STOP ")


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


def test_a_stopped_robot_without_a_place_is_given_one() -> None:
    stopped = status(0, GoalState.ABORTED, Vehicle.EMERGENCY_STOP)
    steps = next_steps(stopped, None, lambda id: KEY[id].keys[0], is_placed=False)
    assert [step.key for step in steps] == ["D D", "i", "a", "g"]


def test_unchecked_fence_asks_for_the_place() -> None:
    station = station_in(Vehicle.FAILSAFE, GoalState.NONE, Mode.HOLD)
    shown = status(station.now_ns, GoalState.NONE, Vehicle.FAILSAFE)
    shown = msgspec.structs.replace(shown, vehicle_reason=Reason.FENCE_UNCHECKED)
    station.bus.say(STATUS, shown)
    assert [one.id for one in next_keys(station, ())] == ["place", "arm", "goal"]


@pytest.mark.usefixtures("worlds")
async def test_refusal_is_shown_on_every_screen_for_some_seconds() -> None:
    async with staged() as stage:
        for key in map(str, SCREENS.values()):
            await stage.press(key)
            stage.station.note(f"set side 0.{key}: not a whole number", Severity.WARNING)
            await stage.redraw()
            assert f"▲ set side 0.{key}: not a whole number" in stage.words("answer"), key
            stage.station.clock.advance(round((SHOWN_S + 0.1) * S))
            await stage.redraw()
            assert stage.words("answer") == "", key


async def test_answer_is_shown_while_the_explanation_covers_the_log() -> None:
    async with staged() as stage:
        await stage.press("e", "y")
        assert "no command to copy yet" in stage.words("answer")
        await stage.press("escape")
        assert stage.app.screen.query_one("#log").display
        await stage.press("escape")
        assert stage.app.screen.query_one("#log").display


async def test_answer_leaves_room_to_type_and_a_click_begins_a_line() -> None:
    async with staged() as stage:
        stage.station.note("x" * 200)
        await stage.redraw()
        await stage.pilot.click("#answer")
        await stage.type("goal 3 1")
        await stage.redraw()
        assert stage.app.screen.query_one("#command").size.width >= 37
        assert stage.words("answer").endswith("…")
        await stage.press("enter")
        assert stage.commands.given == ["goal 3 1"]


@each("width", [20, 40, 80])
def test_cut_answer_names_the_log(width: int) -> None:
    answer = LogLine(0.0, Severity.WARNING, "ground", "x" * 200)
    shown = answer_row(answer, width)
    assert width_of(shown) == width
    assert words_of(shown).endswith("… see Log" if width >= 40 else "…")
    assert "…" not in words_of(answer_row(answer._replace(text="short"), width))


async def test_hints_are_shown_on_the_first_start_until_there_is_an_answer(tmp_path: Path) -> None:
    assert is_first_start(tmp_path / "state")
    assert not is_first_start(tmp_path / "state")
    async with staged() as stage:
        assert stage.words("answer") == ""
        stage.app.is_first_start = True
        await stage.redraw()
        assert stage.words("answer") == "  g sets a goal  space stops  ? shows all keys"
        stage.station.note("goal 3 1: ok 14 ms")
        await stage.redraw()
        assert stage.words("answer") == " goal 3 1: ok 14 ms"


BEN = LeaseView(held=True, name="ben")


@each("vehicle", [Vehicle.EMERGENCY_STOP, Vehicle.FAILSAFE, Vehicle.STANDBY, Vehicle.ACTIVE])
async def test_what_needs_the_lease_of_another_is_not_offered(vehicle: Vehicle) -> None:
    station = station_in(vehicle, GoalState.ABORTED, Mode.HOLD)
    async with staged((160, 40), station=station) as stage:
        offered = stage.words("keybar")
        assert {"Arm", "Goal", "Mode"} <= set(offered.split())
        station.lease_now = BEN
        await stage.redraw()
        offered = stage.words("keybar")
        assert {"E-STOP", "Hold", "Abort"} <= set(offered.split())
        for word in ("Arm", "Goal", "Mode", "Resume", "Go on", "Clear", "Mission", "RTL", "Algo"):
            assert word not in offered


def test_keys_that_need_the_lease_are_those_that_move_the_robot() -> None:
    needing = {one.id for one in KEYS if one.needs_lease}
    assert {"arm", "resume", "rtl", "goal", "clear-estop", "missions"} <= needing
    assert not needing & {"hold", "abort", "disarm", "estop", "estop-here", "explain", "lease"}


OFFERED = ("Goal", "Arm", "Mode", "Teleop", "Mission", "Resume")


async def test_a_robot_that_is_gone_is_offered_only_stops() -> None:
    station = station_in(Vehicle.ACTIVE, GoalState.ABORTED, Mode.HOLD)
    station.loss_now = Loss(LossKind.PROCESS_DEAD, "r1", "gone", "restart it", station.now_ns)
    async with staged((160, 40), station=station) as stage:
        offered = stage.words("keybar")
        assert {"E-STOP", "Hold", "Abort"} <= set(offered.split())
        assert not [word for word in OFFERED if word in offered]
        assert stage.app.base_screen is not None
        hints = words_of(hint_row(stage.app.base_screen.bar_keys(), 80))
        assert hints == "  space stops  ? shows all keys"


async def test_a_robot_without_a_place_is_offered_no_goal() -> None:
    station = station_in(Vehicle.ACTIVE, GoalState.ABORTED, Mode.HOLD)
    station.place_remedy_now = "pose truth"
    async with staged((160, 40), station=station) as stage:
        offered = stage.words("keybar")
        assert {"E-STOP", "Hold", "Arm"} <= set(offered.split())
        for word in ("Goal", "Resume", "Go on", "RTL"):
            assert word not in offered


def test_a_mission_starts_only_from_a_known_place() -> None:
    station = station_in(Vehicle.ACTIVE, GoalState.REACHED, Mode.HOLD)
    station.bus.say(MISSION, ready_mission(station.now_ns))
    for remedy, offered in (("", ["missions"]), ("pose truth", [])):
        station.place_remedy_now = remedy
        assert [one.id for one in next_keys(station, ()) if one.id == "missions"] == offered


@each(("goal", "is_offered"), [(GoalState.REACHED, False), (GoalState.ABORTED, True)])
async def test_resume_is_offered_while_a_drive_is_kept(goal: GoalState, is_offered: bool) -> None:
    async with staged((160, 40), station=station_in(Vehicle.ACTIVE, goal, Mode.HOLD)) as stage:
        offered = stage.words("keybar")
        assert ("Resume" in offered or "Go on" in offered) == is_offered


async def test_no_prompt_opens_for_what_would_be_refused() -> None:
    station = station_in(Vehicle.ACTIVE, GoalState.REACHED, Mode.HOLD)
    station.lease_now = BEN
    async with staged((160, 40), station=station) as stage:
        await stage.press("g")
        assert stage.app.base_screen is not None
        assert not stage.app.base_screen.typing
        assert "ben commands" in list(station.log)[-1].text
