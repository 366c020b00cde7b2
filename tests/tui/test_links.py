"""The screen of the links and the roster: processes, streams, every robot."""

from checks.harness.messages import make
from ground.app.chrome.button_row import ButtonRow, buttons_width
from ground.app.chrome.roster import fits_beside, roster_buttons
from ground.app.widgets.rows import words_of
from ground.client.telemetry import Age, AgedMessage
from ground.station.fleet import Attention, RosterEntry, attention_of, by_attention
from ground.station.fleet import words_of as state_words
from ground.station.robot.lease_state import LeaseView
from protocol.topics import GATEWAY, MCU, STATUS, Role
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import GatewayStatus
from runtime.units import NS_PER_S
from tests.support.app import NOTHING, FakeStation, driving, mcu_status, staged, stopped_status
from tests.support.each import each
from tests.support.ground.station import Robot


async def test_links_show_processes_and_streams() -> None:
    async with staged() as stage:
        await stage.press("5")
        assert "robot ● present" in stage.words("about")
        assert "100.0 % delivered   round trip 12 ms" in stage.words("about")
        assert "tlm/status" in stage.words("rows")
        assert "1 robot, 5 streams" in stage.words("heading")


async def test_links_show_which_program_has_the_lease_and_which_one_drove() -> None:
    async with staged() as stage:
        await stage.press("5")
        stage.station.lease_now = LeaseView(
            held=True, ours=True, name="ada@laptop:pts/1", driver="ada@laptop:pts/0",
            lapses_s=27.8,
        )  # fmt: skip
        await stage.redraw()
        words = stage.words("about")
        assert "ours, by ada@laptop:pts/1, 28 s left, last driver ada@laptop:pts/0" in words
        assert max(map(len, words.splitlines())) <= 80


async def test_links_show_the_mavlink_gateway_and_its_loss() -> None:
    async with staged() as stage:
        await stage.press("5")
        assert "mavlink" not in stage.words("about")
        status = make(
            GatewayStatus, sent_bytes_s=4_200, refused=7, received_hz=12, lost_permille=15,
            system=1, clients=2, signing=1, owner=255,
        )  # fmt: skip
        stage.station.bus.say(GATEWAY, status)
        await stage.redraw()
        words = stage.words("about")
        assert "system 1: 2 clients (1 signed), 255 commands" in words
        assert "in 12 Hz, out 4.2 kB/s   1.5 % lost, 7 refused" in words
        assert max(map(len, words.splitlines())) <= 80
        about = stage.app.screen.query_one("#about")
        await stage.until(lambda: about.content_size.height == 9)
        stage.station.clock.advance(12 * NS_PER_S)
        await stage.redraw()
        words = stage.words("about")
        assert "mavlink no data for 12 s: the gateway has ended, is slow or hangs" in words
        assert "255 commands" not in words


async def test_links_show_the_board_that_runs_the_core() -> None:
    async with staged() as stage:
        await stage.press("5")
        assert "MCU" not in stage.words("about")
        stage.station.bus.say(MCU, mcu_status())
        await stage.redraw()
        words = stage.words("about")
        assert (
            "MCU (emulated)  command after 6.0 ms, done after 21.6 of 50.0 ms (modelled)" in words
        )
        assert "RAM 52.2 of 56.9 kB, 699 bytes skipped" in words
        assert max(map(len, words.splitlines())) <= 80
        stage.station.clock.advance(3 * NS_PER_S)
        await stage.redraw()
        words = stage.words("about")
        assert "MCU (emulated)  -- 3.0 s" in words
        assert "RAM" not in words


async def test_links_show_restarts_and_their_cause() -> None:
    async with staged() as stage:
        await stage.press("5")
        assert "restarted" not in stage.words("about")
        stage.station.restarts_of = {Role.ROBOT: 1, Role.PLANT: 2}
        stage.station.restart_cause_now = "the one before was killed (signal SIGKILL)"
        await stage.redraw()
        rows = stage.words("about").splitlines()
        assert rows[1].endswith("restarted 1 time; the one before was killed (signal SIGKILL)")
        assert rows[2].endswith("restarted 2 times")


async def test_columns_of_links_are_below_their_names() -> None:
    async with staged() as stage:
        await stage.press("5")
        heads, rows = stage.words("columns"), stage.words("rows").splitlines()
        for name, value in (("got Hz", "20"), ("age", "live"), ("loss %", "0.0")):
            ends = heads.index(name) + len(name)
            assert rows[2][:ends].endswith(value), name


def lossy() -> FakeStation:
    """Return a station with two robots, of which the streams of r1 lose frames."""
    station = driving(FakeStation())
    station.robots_now = ["r1", "r2"]
    station.entries = [
        RosterEntry("r2", False, Attention.NONE, "ready", NOTHING, round_trip_ms=31.0)
    ]
    station.rows = [
        row._replace(lost=number, lost_percent=float(number))
        for number, row in enumerate(station.rows)
    ]
    return station


async def test_links_show_every_robot() -> None:
    async with staged((110, 30), station=lossy()) as stage:
        await stage.press("5")
        assert "2 robots, 5 streams" in stage.words("heading")
        last = stage.words("rows").splitlines()[-1].split()
        assert (last[0], last[-1]) == ("r2", "31")


async def test_links_are_sorted_by_loss_with_a_click_on_its_head() -> None:
    async with staged((110, 30), station=lossy()) as stage:
        await stage.press("5")
        at = stage.words("columns").index("loss %")
        await stage.pilot.click("#columns", offset=(at, 0))
        await stage.redraw()
        assert "▼loss %" in stage.words("columns")
        assert stage.words("rows").splitlines()[0].split()[1] == "tlm/cycle"
        await stage.press("O")
        assert "▲loss %" in stage.words("columns")
        assert stage.words("rows").splitlines()[0].split()[1] == "tlm/heartbeat"


async def test_links_show_how_many_rows_are_out_of_sight() -> None:
    async with staged((80, 12)) as stage:
        await stage.press("5")
        assert "▼" in stage.words("heading")
        assert "tlm/cycle" not in stage.words("rows")
        await stage.press("end")
        assert "▲" in stage.words("heading")
        assert "▼" not in stage.words("heading")
        assert "tlm/cycle" in stage.words("rows")


@each(("is_framed", "columns"), [(False, 80), (True, 78)])
async def test_rejected_frames_fit_into_eighty_columns(is_framed: bool, columns: int) -> None:
    station = driving(FakeStation())
    if is_framed:
        failed = stopped_status(Vehicle.FAILSAFE, station.now_ns)
        station.bus.say(STATUS, failed)
    async with staged((80, 24), station=station) as stage:
        first = stage.station.rows[0]
        why = "has dialect 3, this station has 4"
        stage.station.rows = [
            first._replace(rejected=4321, last_rejection=why),
            *stage.station.rows[1:],
        ]
        await stage.press("5", "down")
        assert stage.app.screen.query_one("#columns").size.width == columns
        assert " reject " in stage.words("columns")[:columns]
        line = next(one for one in stage.words("rows").splitlines() if "tlm/heartbeat" in one)
        assert "4321" in line[:columns]
        assert f"tlm/heartbeat: {why}" in stage.words("about")


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


@each("width", range(100))
def test_roster_fits_and_counts_all_by_state(width: int) -> None:
    many = [FAILED, *(entry(Robot(f"r{number}")) for number in range(4, 20))]
    buttons = roster_buttons(many, width)
    assert buttons_width(buttons) <= width
    counts = words_of(buttons[-1].row)
    wanted = "16 without a goal, 1 stopped" if width >= 29 else "1 stopped" if width >= 10 else ""
    assert counts.strip() == wanted


def test_counts_have_the_most_urgent_state_at_the_end() -> None:
    lost = RosterEntry("r5", False, Attention.LOST, "dead", AgedMessage(None, None, Age.GONE))
    states = (GoalState.DRIVING, GoalState.AVOIDING, GoalState.STUCK, GoalState.REACHED)
    goals = [entry(Robot(f"r{10 + goal}", goal=goal)) for goal in states]
    unplaced = DRIVING._replace(attention=Attention.UNPLACED, words="ready, place unknown")
    fleet = by_attention([*goals, FAILED, lost, unplaced])
    words = "2 driving, 1 reached, 1 without a place, 1 lost, 1 stuck, 1 stopped"
    assert text(fleet, len(words) + 1) == f" {words}"
    assert text(fleet, len(words)) == " 1 reached, 1 without a place, 1 lost, 1 stuck, 1 stopped"
    named = text(fleet, len(words) + 20)
    assert named == f"  r3 ▲ FAILSAFE  {words}"


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


async def test_click_on_the_roster_selects_the_robot() -> None:
    async with staged(size=(80, 24)) as stage:
        stage.station.robots_now = ["r1", "r2", "r3"]
        stage.station.entries = FLEET
        await stage.redraw()  # makes the row visible
        await stage.redraw()
        roster = stage.app.screen.query_one("#roster", ButtonRow)
        assert roster.display
        column = words_of(roster.rows[0]).index("r2")
        await stage.pilot.click("#roster", offset=(column, 0))
        assert stage.station.robot == "r2"


async def test_a_key_selects_the_robots_that_need_attention() -> None:
    async with staged(size=(80, 24)) as stage:
        station = stage.station
        station.robots_now = ["r1", "r2", "r3", "r4"]
        stuck = entry(Robot("r4", goal=GoalState.STUCK))
        station.entries = [stuck, FAILED, DRIVING]
        shown = []
        for _ in range(3):
            await stage.press("!")
            shown.append(station.robot)
        assert shown == ["r3", "r4", "r3"]
        station.entries = [FAILED]
        await stage.press("!")
        assert station.robot == "r3"
        assert "no other robot needs attention" in stage.log()


async def test_few_robots_are_at_the_end_of_the_tab_bar() -> None:
    async with staged(size=(160, 40)) as stage:
        stage.station.robots_now = ["r1", "r2"]
        await stage.redraw()
        assert not stage.app.screen.query_one("#roster", ButtonRow).display
        assert "r2 ●" in words_of(stage.app.screen.query_one("#tabs", ButtonRow).rows[0])


async def test_roster_of_one_robot_takes_no_row() -> None:
    async with staged(size=(80, 24)) as stage:
        await stage.redraw()
        assert not stage.app.screen.query_one("#roster", ButtonRow).display
