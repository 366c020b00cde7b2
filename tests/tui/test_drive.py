"""The Drive screen by keys, and an unknown position."""

from math import nan

import pytest
from msgspec.structs import replace
from textual import events

from ground.app.input.keymap import keymap_of
from ground.app.widgets.command_line import CommandLine
from ground.app.widgets.lines import Lines
from ground.map.scene import MapTarget
from ground.station.link.loss import Loss, LossKind
from protocol.topics import ODOMETRY, STATUS, TRUTH
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.app import NAMES, FakeStation, Stage, drive_messages, driving, staged, status
from tests.support.each import each


async def test_drive_screen_shows_pose_and_state() -> None:
    async with staged() as stage:
        side = stage.words("side")
        assert "4.12   2.84    30° ±45 mm" in side
        assert "AVOIDING" in side
        assert "0.08" in side
        assert "!!" in side
        assert "dead" in side
        assert "us" not in side.split()
        assert stage.words("status").startswith("● r1 ▸ GUIDED ▸ ARMED  vgm/left")
        assert "SIM" in stage.words("status")


async def test_typing_a_goal_triggers_no_other_key() -> None:
    async with staged() as stage:
        await stage.press("g")
        assert stage.app.screen.query_one(CommandLine).value == "goal "
        await stage.type("9 7")
        await stage.press("enter")
        assert stage.commands.given == ["goal 9 7"]
        assert stage.station.stops == 0


async def test_keys_of_a_burst_follow_the_focus() -> None:
    async with staged() as stage:
        for letter in "g9 7":
            stage.app.post_message(events.Key(NAMES.get(letter, letter), letter))
        stage.app.post_message(events.Key("enter", None))
        await stage.redraw()
        assert stage.commands.given == ["goal 9 7"]
        assert stage.station.stops == 0


async def test_cursor_becomes_a_goal() -> None:
    async with staged() as stage:
        await stage.press("G")
        start = stage.drive.map_cursor.cursor
        assert start is not None
        await stage.press("right", "right", "up", ">", ">")
        assert "goal" in stage.words("prompt")
        await stage.press("enter")
        step_m = stage.drive.map_cursor.step_m
        x_m, y_m = start.x_m + 2 * step_m, start.y_m + step_m
        assert stage.commands.given == [f"goal {x_m:g} {y_m:g} -15"]
        assert stage.drive.map_cursor.cursor is None


async def test_h_holds_with_and_without_a_cursor() -> None:
    async with staged() as stage:
        await stage.press("G", "h")
        assert stage.commands.given == ["hold"]
        assert stage.drive.map_cursor.cursor is not None
        await stage.press("escape", "h")
        assert stage.commands.given == ["hold", "hold"]


async def test_draft_is_shown_until_the_robot_has_it() -> None:
    ways = (MapTarget(1.0, 2.0), MapTarget(3.0, 4.0, 0.0))
    async with staged((110, 30)) as stage:
        assert not stage.drive.map.scene.draft
        stage.commands.draft_items = ways
        await stage.redraw()
        assert stage.drive.map.scene.draft == ways
        assert "2 waypoints, W sends" in stage.words("side")
        stage.station.mission_items_now = ways
        await stage.redraw()
        assert not stage.drive.map.scene.draft
        assert "waypoints" not in stage.words("side")


async def test_zoomed_map_follows_the_cursor() -> None:
    async with staged() as stage:
        await stage.press("+", "+", "+", "+", "+", "+", "+", "G", "L", "L")
        shown, cursor = stage.drive.map, stage.drive.map_cursor.cursor
        assert cursor is not None
        assert shown.view.centre_x_m == pytest.approx(cursor.x_m)
        await stage.press("0", "L", "L", "L", "L")
        assert shown.fitted
        assert shown.view.centre_x_m == pytest.approx(5.0)


async def test_space_stops_the_robot_with_the_cursor() -> None:
    async with staged() as stage:
        await stage.press("space")
        await stage.press("G", "space")
        assert (stage.station.stops, stage.station.stops_of_all) == (1, 1), "the second: all"


async def test_loss_is_an_alarm_and_old_values_show_ages() -> None:
    station = driving(FakeStation())
    async with staged(station=station) as stage:
        station.clock.advance(3 * S)
        station.loss_now = Loss(
            LossKind.HUNG, "r1", "no beat", "stops by itself", station.now_ns - 2_900 * MS
        )
        await stage.redraw()
        assert "ROBOT HUNG r1 2.9 s: no beat; stops by itself" in stage.words("alarm")
        side = stage.words("side")
        assert "4.12" not in side
        assert "-- 3.0 s" in side
        assert stage.words("status").startswith("○ r1 ▸ -- 3.0 s")


async def test_unchanged_rows_are_not_drawn_again() -> None:
    async with staged((160, 50)) as stage:
        await stage.redraw()
        before = [line.drawn for line in stage.app.screen.query(Lines)]
        for _ in range(5):
            await stage.redraw()
        after = [line.drawn for line in stage.app.screen.query(Lines)]
        assert after == before


async def test_restart_is_an_alarm_unless_there_is_a_loss() -> None:
    station = driving(FakeStation())
    async with staged(station=station) as stage:
        station.restarted_now = "r1 has been restarted (1): the one before was killed"
        await stage.redraw()
        assert station.restarted_now in stage.words("alarm")
        station.loss_now = Loss(LossKind.HUNG, "r1", "no beat", "stops", station.now_ns)
        await stage.redraw()
        assert "ROBOT HUNG" in stage.words("alarm")
        assert "restarted" not in stage.words("alarm")


async def test_restart_of_a_robot_does_not_change_the_factor_of_the_simulation() -> None:
    async with staged() as stage:
        shown = set()
        for number in range(100):
            now_ns = stage.station.clock.now_ns()
            stamp_ns = now_ns if number > 30 else number  # a new robot begins at zero
            by_robot = replace(status(now_ns), time_ns=stamp_ns)
            stage.station.bus.say(STATUS, by_robot)
            stage.station.bus.say(TRUTH, drive_messages(now_ns)[TRUTH])
            stage.app.sample()
            shown.add(stage.app.session_info.kind)
            stage.station.clock.advance(50 * MS)
        assert shown == {"SIM", "SIM 1.0x"}


REFUSES = "PLACE UNKNOWN of r1: it refuses goals. "
TRUE = "Enter sets its true pose"
BY_HAND = "X Y DEG and Enter set its pose"


def lost(*, simulated: bool) -> FakeStation:
    """Return a station whose robot does not know its place."""
    station = FakeStation()
    messages = drive_messages(station.now_ns)
    messages[ODOMETRY] = replace(messages[ODOMETRY], cov_xx_m2=nan)
    for topic, message in messages.items():
        if simulated or topic is not TRUTH:
            station.bus.say(topic, message)
    return station


def alarm(stage: Stage) -> str:
    return " ".join(stage.words("alarm").split())


@each(
    ("simulated", "entered", "typed", "sent"),
    [(True, TRUE, "", "pose truth"), (False, BY_HAND, "1 2 90", "pose set 1 2 90")],
)
async def test_keys_that_the_alarm_names_set_the_pose(
    simulated: bool, entered: str, typed: str, sent: str
) -> None:
    async with staged((120, 40), station=lost(simulated=simulated)) as stage:
        assert alarm(stage) == f"{REFUSES}i, then {entered}"
        await stage.press("i")
        assert alarm(stage) == f"{REFUSES}{entered}"
        await stage.type(typed)
        await stage.press("enter")
        assert stage.commands.given == [sent]


async def test_alarm_names_the_way_to_where_the_key_works() -> None:
    async with staged((120, 40), station=lost(simulated=True)) as stage:
        await stage.press("4")
        assert alarm(stage) == f"{REFUSES}1 Drive, then i, then {TRUE}"
        await stage.press("1", "colon")
        assert alarm(stage) == f"{REFUSES}esc, then i, then {TRUE}"


@each(
    ("simulated", "steps"),
    [(True, f":pose truth, then {TRUE}"), (False, f":pose set, then {BY_HAND}")],
)
async def test_alarm_names_the_command_without_a_key(simulated: bool, steps: str) -> None:
    keymap = keymap_of({"keys": {"place": []}}, file="keys.toml")
    async with staged((120, 40), station=lost(simulated=simulated), keymap=keymap) as stage:
        assert alarm(stage) == f"{REFUSES}{steps}"
