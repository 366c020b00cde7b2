"""The screen of the links: processes, streams, every robot."""

from ground.station.fleet import Attention, RosterEntry
from ground.station.robot.lease_state import LeaseView
from protocol.topics import GATEWAY, MCU, STATUS, Role
from protocol.wire.enums import Vehicle
from protocol.wire.messages import GatewayStatus
from runtime.units import NS_PER_S
from tests.support.each import each
from tests.support.tui.fakes import NOTHING, FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.stopped import stopped_status
from tests.support.tui.underway import driving, mcu_status


def test_links_show_processes_and_streams() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("5")
            assert "robot ● present" in stage.words("about")
            assert "100.0 % delivered   round trip 12 ms" in stage.words("about")
            assert "tlm/status" in stage.words("rows")
            assert "1 robot, 5 streams" in stage.words("heading")

    play(story)


def test_links_show_which_program_has_the_lease_and_which_one_drove() -> None:
    async def story() -> None:
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

    play(story)


def test_links_show_the_mavlink_gateway_and_its_loss() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("5")
            assert "mavlink" not in stage.words("about")
            status = GatewayStatus(
                time_ns=0, sent_bytes_s=4_200, refused=7, malformed=0, received_hz=12,
                lost_permille=15, system=1, clients=2, signing=1, owner=255,
            )  # fmt: skip
            stage.station.air.put(GATEWAY, status, stage.station.now_ns)
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

    play(story)


def test_links_show_the_board_that_runs_the_core() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("5")
            assert "MCU" not in stage.words("about")
            stage.station.air.put(MCU, mcu_status(), stage.station.now_ns)
            await stage.redraw()
            words = stage.words("about")
            assert (
                "MCU (emulated)  command after 6.0 ms, done after 21.6 of 50.0 ms (modelled)"
                in words
            )
            assert "RAM 52.2 of 56.9 kB, 699 bytes skipped" in words
            assert max(map(len, words.splitlines())) <= 80
            stage.station.clock.advance(3 * NS_PER_S)
            await stage.redraw()
            words = stage.words("about")
            assert "MCU (emulated)  -- 3.0 s" in words
            assert "RAM" not in words

    play(story)


def test_links_show_restarts_and_their_cause() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("5")
            assert "restarted" not in stage.words("about")
            stage.station.restarts_now = {Role.ROBOT: 1, Role.PLANT: 2}
            stage.station.cause_now = "the one before was killed (signal SIGKILL)"
            await stage.redraw()
            rows = stage.words("about").splitlines()
            assert rows[1].endswith("restarted 1 time; the one before was killed (signal SIGKILL)")
            assert rows[2].endswith("restarted 2 times")

    play(story)


def test_columns_of_links_are_below_their_names() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("5")
            heads, rows = stage.words("columns"), stage.words("rows").splitlines()
            for name, value in (("got Hz", "20"), ("age", "live"), ("loss %", "0.0")):
                ends = heads.index(name) + len(name)
                assert rows[2][:ends].endswith(value), name

    play(story)


def lossy() -> FakeStation:
    """Return a station with two robots, of which the streams of r1 lose frames."""
    station = driving(FakeStation())
    station.robots_now = ["r1", "r2"]
    station.roster_now = [
        RosterEntry("r2", False, Attention.NONE, "ready", NOTHING, round_trip_ms=31.0)
    ]
    station.streams_now = [
        row._replace(lost=number, lost_percent=float(number))
        for number, row in enumerate(station.streams_now)
    ]
    return station


def test_links_show_every_robot() -> None:
    async def story() -> None:
        async with staged((110, 30), station=lossy()) as stage:
            await stage.press("5")
            assert "2 robots, 5 streams" in stage.words("heading")
            last = stage.words("rows").splitlines()[-1].split()
            assert (last[0], last[-1]) == ("r2", "31")

    play(story)


def test_links_are_sorted_by_loss_with_a_click_on_its_head() -> None:
    async def story() -> None:
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

    play(story)


def test_links_show_how_many_rows_are_out_of_sight() -> None:
    async def story() -> None:
        async with staged((80, 12)) as stage:
            await stage.press("5")
            assert "▼" in stage.words("heading")
            assert "tlm/cycle" not in stage.words("rows")
            await stage.press("end")
            assert "▲" in stage.words("heading")
            assert "▼" not in stage.words("heading")
            assert "tlm/cycle" in stage.words("rows")

    play(story)


@each(("is_framed", "columns"), [(False, 80), (True, 78)])
def test_rejected_frames_fit_into_eighty_columns(is_framed: bool, columns: int) -> None:
    async def story() -> None:
        station = driving(FakeStation())
        if is_framed:
            failed = stopped_status(Vehicle.FAILSAFE, station.now_ns)
            station.air.put(STATUS, failed, station.now_ns)
        async with staged((80, 24), station=station) as stage:
            first = stage.station.streams_now[0]
            why = "has dialect 3, this station has 4"
            stage.station.streams_now = [
                first._replace(rejected=4321, last_rejection=why),
                *stage.station.streams_now[1:],
            ]
            await stage.press("5", "down")
            assert stage.app.screen.query_one("#columns").size.width == columns
            assert " reject " in stage.words("columns")[:columns]
            line = next(one for one in stage.words("rows").splitlines() if "tlm/heartbeat" in one)
            assert "4321" in line[:columns]
            assert f"tlm/heartbeat: {why}" in stage.words("about")

    play(story)
