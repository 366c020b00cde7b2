"""The roster lists every robot and selects one by a click."""

from ground.app.chrome.button_row import ButtonRow, buttons_width
from ground.app.chrome.roster import fits_beside, roster_buttons
from ground.app.widgets.rows import words_of
from ground.client.telemetry import Age, AgedMessage
from ground.station.fleet import Attention, RosterEntry, attention_of
from ground.station.fleet import words_of as state_words
from protocol.wire.enums import GoalState, Vehicle
from tests.support.each import each
from tests.support.ground.station.said import Robot
from tests.support.tui.pilot import play, staged


def entry(robot: Robot, *, selected: bool = False, to_go: float | None = None) -> RosterEntry:
    seen = AgedMessage(robot.status(), 0, Age.LIVE)
    return RosterEntry(
        robot.name,
        selected,
        attention_of(seen, None),
        state_words(seen, None),
        seen,
        goal_distance_m=to_go,
    )


FAILED = entry(Robot("r3", vehicle=Vehicle.FAILSAFE))
DRIVING = entry(Robot("r2", goal=GoalState.DRIVING), to_go=1.23)
SELECTED = entry(Robot("r1"), selected=True)
FLEET = [FAILED, SELECTED, DRIVING]


def text(entries: list[RosterEntry], width: int, *, ascii_only: bool = False) -> str:
    return "".join(
        words_of(one.row) for one in roster_buttons(entries, width, ascii_only=ascii_only)
    )


def test_roster_shows_state_and_distance() -> None:
    assert text(FLEET, 80) == "  r3 ▲ FAILSAFE ▌r1▐●  r2 ● 1.2 m   [ ] switch "
    assert text(FLEET, 80, ascii_only=True).startswith("  r3 ▲ FAILSAFE [r1]●")


def test_single_robot_has_no_roster() -> None:
    assert roster_buttons([SELECTED], 80) == []


@each("width", range(80))
def test_roster_fits_and_counts_what_it_leaves_out(width: int) -> None:
    many = [FAILED, *(entry(Robot(f"r{number}")) for number in range(4, 20))]
    buttons = roster_buttons(many, width)
    if width >= 4:
        assert buttons_width(buttons) <= width
        left_out = len(many) - (len(buttons) - 1)
        assert words_of(buttons[-1].row) == f" +{left_out}"


def test_stop_of_another_robot_is_an_alarm_until_it_is_selected() -> None:
    (other, *_) = roster_buttons(FLEET, 80)
    assert [span.role for span in other.row if "FAILSAFE" in span.text] == ["alarm"]
    (own, *_) = roster_buttons([FAILED._replace(is_selected=True), DRIVING], 80)
    assert [span.role for span in own.row if "FAILSAFE" in span.text] == ["caution"]


def test_emergency_stop_is_never_in_the_colour_of_health() -> None:
    stopped = entry(Robot("r1", vehicle=Vehicle.EMERGENCY_STOP), selected=True)
    (own, *_) = roster_buttons([stopped, DRIVING], 80)
    assert [span.role for span in own.row if "E-STOP" in span.text] == ["danger"]


def test_stop_that_is_not_acknowledged_is_never_in_the_colour_of_health() -> None:
    stopping = SELECTED._replace(attention=Attention.STOPPED, stopping="E-STOP")
    (own, *_) = roster_buttons([stopping, DRIVING], 80)
    assert [span.role for span in own.row if "▲" in span.text] == ["danger"]


def test_lost_robot_has_a_hollow_mark() -> None:
    lost = RosterEntry("r5", False, Attention.LOST, "dead", AgedMessage(None, None, Age.GONE))
    assert "r5 ○ dead" in text([lost, DRIVING], 80)


def test_robot_without_a_place_is_in_the_colour_of_caution() -> None:
    unplaced = DRIVING._replace(attention=Attention.UNPLACED, words="ready, place unknown")
    assert "r2 ▲ ready, place unknown" in text([unplaced, SELECTED], 80)
    (shown, *_) = roster_buttons([unplaced, SELECTED], 80)
    assert [span.role for span in shown.row if "place" in span.text] == ["caution"]


def test_place_of_the_roster_depends_on_the_number_of_robots() -> None:
    assert fits_beside(FLEET, 54)
    assert not fits_beside(FLEET, 53)


def test_click_on_the_roster_selects_the_robot() -> None:
    async def story() -> None:
        async with staged(size=(80, 24)) as stage:
            stage.station.robots_now = ["r1", "r2", "r3"]
            stage.station.roster_now = FLEET
            await stage.redraw()  # makes the row visible
            await stage.redraw()
            roster = stage.app.screen.query_one("#roster", ButtonRow)
            assert roster.display
            column = words_of(roster.rows[0]).index("r2")
            await stage.pilot.click("#roster", offset=(column, 0))
            assert stage.station.robot == "r2"

    play(story)


def test_few_robots_are_at_the_end_of_the_tab_bar() -> None:
    async def story() -> None:
        async with staged(size=(160, 40)) as stage:
            stage.station.robots_now = ["r1", "r2"]
            await stage.redraw()
            assert not stage.app.screen.query_one("#roster", ButtonRow).display
            assert "r2 ●" in words_of(stage.app.screen.query_one("#tabs", ButtonRow).rows[0])

    play(story)


def test_roster_of_one_robot_takes_no_row() -> None:
    async def story() -> None:
        async with staged(size=(80, 24)) as stage:
            await stage.redraw()
            assert not stage.app.screen.query_one("#roster", ButtonRow).display

    play(story)
