"""Lists: filters, choices, copied and sorted rows, and the log."""

from time import localtime, strftime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.app.filtered_log import FilteredLog
from ground.app.panels.log import MOST_LATELY, latest_rows, log_rows
from ground.app.screens.choice import Choice, ChoiceScreen
from ground.app.screens.log import LogScreen
from ground.app.widgets.rows import words_of
from ground.station.history.event_log import EventLog, LogLine
from protocol.wire.enums import Severity, Vehicle
from runtime.units import NS_PER_S as S
from tests.support.app import FakeStack, FakeStation, Stage, driving, on, parameter, staged, stopped
from tests.support.each import each

MANY = [Choice(f"run-{number}", f"file {number}") for number in range(1, 60)]


def taken(stage: Stage, choices: list[Choice]) -> list[str]:
    """Open the dialog and return the list that will hold the choice."""
    found: list[str] = []
    stage.app.choose("recording", choices, found.append)
    return found


async def test_navigators_have_a_description_and_the_current_one_a_mark() -> None:
    async with staged((100, 30)) as stage:
        await stage.press("v")
        rows = stage.words("choices").splitlines()
        assert "● vgm " in rows[2]
        assert "turns its goal away" in rows[2]
        assert sum("●" in row for row in rows) == 1
        await stage.press("down", "enter")
        assert stage.commands.given == ["navigator bug1"]


async def test_choices_are_filtered_while_typing() -> None:
    async with staged() as stage:
        found = taken(stage, MANY)
        await stage.press("slash")
        await stage.type("jkq 4")
        assert "nothing matches" in stage.words("choices")
        await stage.press("ctrl+u")
        await stage.type("run-4")
        assert "11 of 59" in stage.words("choices")
        await stage.press("down", "enter")
        assert found == ["run-40"]


async def test_escape_clears_the_filter_then_closes() -> None:
    async with staged() as stage:
        found = taken(stage, MANY)
        await stage.press("slash", "4", "escape")
        assert isinstance(stage.app.screen, ChoiceScreen)
        assert "of 59" not in stage.words("choices")
        await stage.press("escape")
        assert not isinstance(stage.app.screen, ChoiceScreen)
        assert found == []


async def test_letters_of_the_filter_stop_no_robot_and_f12_does() -> None:
    async with staged() as stage:
        taken(stage, MANY)
        await stage.press("slash", "S", "space")
        assert stage.station.stops == 0
        await stage.press("f12")
        assert stage.station.stops == 1


async def test_chosen_row_of_a_long_list_stays_in_sight() -> None:
    async with staged((40, 12)) as stage:
        found = taken(stage, MANY)
        await stage.press("up")
        assert "run-59" in stage.words("choices")
        await stage.press("enter")
        assert found == ["run-59"]


async def test_click_takes_a_choice() -> None:
    async with staged() as stage:
        found = taken(stage, MANY[:5])
        await stage.redraw()
        await stage.pilot.click("#choices", offset=(5, 0))
        assert found == []
        await stage.pilot.click("#choices", offset=(5, 3))
        assert found == ["run-3"]


async def test_click_only_selects_in_an_emergency_stop() -> None:
    async with staged(station=stopped(Vehicle.EMERGENCY_STOP)) as stage:
        found = taken(stage, MANY[:5])
        await stage.redraw()
        await stage.pilot.click("#choices", offset=(5, 3))
        assert found == []
        await stage.press("enter")
        assert found == ["run-3"]


async def test_title_counts_the_choices_out_of_sight() -> None:
    async with staged((60, 20)) as stage:
        taken(stage, MANY)
        await stage.redraw()
        assert "▼ 45 below" in stage.words("choices").splitlines()[0]
        assert "▲" not in stage.words("choices").splitlines()[0]
        await stage.press("up")
        assert "▲ 45 above" in stage.words("choices").splitlines()[0]
        assert "▼" not in stage.words("choices").splitlines()[0]


def with_log() -> FakeStation:
    station = driving(FakeStation())
    for number, severity in enumerate((Severity.INFO, Severity.ERROR, Severity.WARNING)):
        station.clock.advance(S)
        station.note(f"line {number}", severity)
    return station


async def test_parameter_is_copied_as_the_command_that_sets_it() -> None:
    async with staged() as stage:
        await stage.press("3", "down", "y")
        assert stage.app.clipboard == "param set guard_stop_m 0.1"
        assert "copied: param set guard_stop_m 0.1" in stage.log()


@pytest.mark.usefixtures("worlds")
@pytest.mark.parametrize(
    ("screen", "text"),
    [("5", "r1  (all frames)"), ("6", "box"), ("7", "hang robot r1  now")],
)
async def test_row_of_a_list_is_copied(screen: str, text: str) -> None:
    async with on(screen, FakeStack()) as stage:
        await stage.press("y")
        assert stage.app.clipboard.startswith(text)


async def test_empty_list_copies_nothing() -> None:
    async with staged() as stage:
        await stage.press("3", "slash", "z", "z", "enter", "y")
        assert stage.app.clipboard == ""
        assert "no row to copy" in stage.log()


async def test_chosen_line_of_the_log_is_copied() -> None:
    async with staged(station=with_log()) as stage:
        await stage.press("4", "y")
        assert stage.app.clipboard == "3.0 W ground line 2"
        await stage.press("up", "up", "y")
        assert "line 1" in stage.app.clipboard
        assert "paused" in stage.words("heading")
        await stage.press("f")
        assert "following" in stage.words("heading")


async def test_line_of_the_log_is_chosen_by_a_click() -> None:
    async with staged(station=with_log()) as stage:
        await stage.press("4")
        await stage.pilot.click("#lines", offset=(20, 1))
        await stage.press("y")
        assert stage.app.clipboard == "2.0 E ground line 1"


async def test_log_is_sorted_by_level() -> None:
    async with staged(station=with_log()) as stage:
        await stage.press("4", "o", "o")
        assert isinstance(stage.app.screen, LogScreen)
        assert [one.text for one in stage.app.screen.filtered.lines] == [
            "line 1",
            "line 2",
            "line 0",
        ]
        stage.station.note("line 3", Severity.CRITICAL)
        await stage.redraw()
        assert stage.app.screen.filtered.lines[0].text == "line 3"
        await stage.press("o", "o", "o")
        assert stage.app.screen.filtered.lines[0].text == "line 0"


def test_sorted_log_stays_bounded() -> None:
    log, filtered = EventLog(5), FilteredLog()
    filtered.heads.sort_by(2)
    for number in range(40):
        log.add(LogLine(number, Severity.INFO, f"r{number % 3}", f"line {number}"))
        filtered.update(log, Severity.DEBUG, 80)
    assert len(filtered.lines) == len(filtered.parts) == 5
    assert {one.text for one in filtered.lines} == {f"line {number}" for number in range(35, 40)}
    assert [one.source for one in filtered.lines] == sorted(one.source for one in filtered.lines)


REFUSAL = "refused: goal 99 7: outside of the fence, a circle of 4 m around 0 0; `fence off` " * 3
WORDS = st.text(st.sampled_from("ab é-"), max_size=60)


def line(text: str, severity: int = Severity.INFO, time_s: float = 1.0) -> LogLine:
    return LogLine(time_s, severity, "r1", text)


def filled(*texts: str, size: int = 10_000) -> EventLog:
    log = EventLog(size)
    for number, text in enumerate(texts):
        log.add(line(text, time_s=float(number)))
    return log


def test_short_line_is_one_row() -> None:
    assert list(map(words_of, log_rows(line("on  its way"), 60))) == ["     1.0 I r1 on  its way"]


def test_line_has_the_clock_time_unless_it_is_played() -> None:
    log = EventLog(began_s=1_800_000_000.4)
    log.add(line("on its way", time_s=61.0))
    shown = words_of(log_rows(log.last(1)[0], 60)[0])
    assert shown == f"{strftime('%H:%M:%S', localtime(1_800_000_061))} I r1 on its way"


def test_long_line_is_wrapped_below_its_text() -> None:
    rows = list(map(words_of, log_rows(line(REFUSAL.strip()), 60)))
    assert len(rows) > 3
    assert all(len(one) <= 60 for one in rows)
    assert {one[:14] for one in rows[1:]} == {" " * 14}
    assert " ".join(one[14:] for one in rows) == REFUSAL.strip()


@given(st.lists(WORDS, max_size=12), st.integers(0, 90))
def test_incremental_update_equals_a_full_one(texts: list[str], width: int) -> None:
    log, slowly, at_once = EventLog(5), FilteredLog(), FilteredLog()
    for text in texts:
        log.add(line(text))
        slowly.update(log, Severity.DEBUG, width)
    at_once.update(log, Severity.DEBUG, width)
    assert slowly.parts == at_once.parts
    assert slowly.lines == list(log)


def test_log_is_filtered_by_severity() -> None:
    log = filled("well")
    log.add(line("bad", Severity.WARNING))
    log.add(line("worse", Severity.CRITICAL))
    filtered = FilteredLog()
    filtered.update(log, Severity.WARNING, 80)
    assert [one.text for one in filtered.lines] == ["bad", "worse"]
    filtered.update(log, Severity.ERROR, 80)
    assert [one.text for one in filtered.lines] == ["worse"]


def test_search_wraps_around_and_marks_all_rows() -> None:
    log, filtered = filled("one echo", "nothing", f"two Echo {REFUSAL}", "three"), FilteredLog()
    filtered.update(log, Severity.DEBUG, 40)
    first, _, second, _ = log
    assert filtered.find("echo", None, -1) is second
    assert filtered.find("echo", None, 1) is first
    assert filtered.find("echo", second, 1) is first
    assert filtered.find("echo", first, -1) is second
    assert filtered.find("none of it", first, 1) is None
    assert filtered.row_of(second) == 2
    marked = [
        part.line for part in filtered.parts if filtered.paint(part, second)[-1].role == "reverse"
    ]
    assert set(marked) == {second}
    assert len(marked) > 3


def test_search_distinguishes_equal_lines() -> None:
    log, filtered = EventLog(), FilteredLog()
    for _ in range(3):
        log.add(line("the same"))
    filtered.update(log, Severity.DEBUG, 80)
    first, second, third = log
    assert filtered.find("same", second, 1) is third
    assert filtered.find("same", third, 1) is first


@each("height", [0, 1, 2, 4, 9])
def test_latest_rows_fit_and_show_the_last_line(height: int) -> None:
    log = filled("first", REFUSAL * 9, "last")
    rows = list(map(words_of, latest_rows(log, height, 60)))
    assert len(rows) == min(height, 2 + MOST_LATELY)
    assert all(len(one) <= 60 for one in rows)
    if rows:
        assert rows[-1].endswith("last")
    if height > 2:
        assert rows[-2].endswith("…")


async def test_log_screen_shows_a_long_line_in_full() -> None:
    station = driving(FakeStation())
    station.note(REFUSAL, Severity.WARNING)
    async with staged((80, 24), station=station) as stage:
        await stage.press("4")
        shown = " ".join(part.strip() for part in stage.words("lines").splitlines())
        assert REFUSAL.strip() in shown


LISTS = ("3", "4", "5", "6", "7")
ROBOT_KEYS = "hrxaAmvbRLdtWiz"


def with_parameters() -> FakeStation:
    station = driving(FakeStation())
    names = ("d_obs_m", "d_min_m", "radius_m", "side", "track_m")
    station.parameters_now = tuple(parameter(name, 0.3, 0.3, f"about {name}") for name in names)
    return station


async def test_filter_narrows_at_each_letter() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "slash", "d")
        assert "4 of 5" in stage.words("heading")
        await stage.press("_")
        assert "2 of 5" in stage.words("heading")
        assert [line.split()[0] for line in stage.words("rows").splitlines()] == [
            "d_obs_m",
            "d_min_m",
        ]
        await stage.press("escape")
        assert len(stage.words("rows").splitlines()) == 5
        assert " of " not in stage.words("heading")


@pytest.mark.usefixtures("worlds")
@pytest.mark.sweep(3)
@pytest.mark.parametrize("screen", LISTS)
async def test_typing_a_filter_sends_no_command(screen: str) -> None:
    async with on(screen, FakeStack()) as stage:
        await stage.press("slash")
        await stage.type(ROBOT_KEYS)
        assert stage.app.screen.is_modal is False
        assert stage.words("prompt") == "filter:"
        await stage.press("enter")
        assert stage.commands.given == []
        assert stage.station.asked == []
        assert stage.app.screen.is_modal is False


@pytest.mark.usefixtures("worlds")
@pytest.mark.sweep(3)
@pytest.mark.parametrize("screen", LISTS)
async def test_single_keys_do_not_command_the_robot_on_lists(screen: str) -> None:
    async with on(screen, FakeStack()) as stage:
        for key in ROBOT_KEYS:
            await stage.press(key)
            assert stage.app.screen.is_modal is False, key
            await stage.press("escape")
        assert stage.commands.given == []
        assert not stage.station.lease.ours


async def test_stop_keys_work_while_a_filter_is_typed() -> None:
    async with staged() as stage:
        await stage.press("3", "slash", "x", "f12")
        assert stage.station.stops == 1
        assert stage.words("prompt") == "filter:"


async def test_each_screen_remembers_its_filter() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "slash")
        await stage.type("obs")
        await stage.press("enter", "4")
        assert "/obs" not in stage.words("heading")
        await stage.press("3")
        assert "1 of 5  /obs" in stage.words("heading")
        await stage.press("slash", "r", "a", "d")
        assert "1 of 5  /rad" in stage.words("heading")
        await stage.press("enter", "escape")
        assert len(stage.words("rows").splitlines()) == 5


async def test_filter_without_a_match_is_shown_in_the_list() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "slash")
        await stage.type("zzz")
        await stage.press("enter")
        assert "0 of 5" in stage.words("heading")
        assert "nothing matches zzz: Esc clears the filter" in stage.words("rows")
        await stage.press("e")
        assert stage.words("prompt") != "set d_obs_m:"


async def test_arrows_choose_a_row_while_a_filter_is_typed() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "slash", "d", "_", "down", "enter", "e")
        assert stage.words("prompt") == "set d_min_m:"


async def test_choice_stays_on_its_row_when_the_filter_is_cleared() -> None:
    async with staged(station=with_parameters()) as stage:
        await stage.press("3", "slash")
        await stage.type("track")
        await stage.press("enter", "escape", "e")
        assert stage.words("prompt") == "set track_m:"


@pytest.mark.usefixtures("worlds")
async def test_filtered_world_is_the_one_that_starts() -> None:
    stack = FakeStack()
    async with on("6", stack) as stage:
        await stage.press("slash")
        await stage.type("walker")
        await stage.press("enter")
        assert "1 of 2" in stage.words("heading")
        await stage.press("s", "s")
        assert stack.begun == ["wall"]


@pytest.mark.usefixtures("worlds")
async def test_faults_are_filtered() -> None:
    async with on("7", FakeStack()) as stage:
        await stage.press("slash")
        await stage.type("when:restart sonar")
        assert "sonar_frozen" in stage.words("rows")
        assert "1 of" in stage.words("heading")


async def test_log_is_filtered_by_robot_level_and_words() -> None:
    station = driving(FakeStation())
    station.note("goal 1 2: ok")
    station.note("goal 9 9: refused", Severity.WARNING)
    station.note("link is back", Severity.WARNING)
    async with staged(station=station) as stage:
        await stage.press("4", "slash")
        await stage.type("goal")
        assert "2 of 3" in stage.words("heading")
        await stage.type(" level:warn")
        assert "1 of 3" in stage.words("heading")
        assert "refused" in stage.words("lines")
        await stage.press("ctrl+u")
        await stage.type("robot:ground link")
        assert "1 of 3" in stage.words("heading")
        await stage.press("ctrl+u")
        await stage.type("robot:r7")
        assert "nothing matches robot:r7" in stage.words("lines")


async def test_fifty_thousand_lines_arrive_while_the_log_is_filtered() -> None:
    """Each line is examined once; only a shorter filter examines all lines again."""
    station = driving(FakeStation())
    for number in range(10_000):
        station.note(f"line {number}")
    async with staged(station=station) as stage:
        await stage.press("4", "slash")
        filtered = log_of(stage).filtered
        before = filtered.examined
        await stage.type("line 99")
        assert filtered.examined - before < 7 * 10_000
        await stage.redraw()
        before = filtered.examined
        for batch in range(50):
            for number in range(1000):
                station.note(f"line {batch * 1000 + number}")
            stage.app.redraw()
        assert filtered.examined - before == 50_000
        assert len(filtered.lines) <= len(station.log) == 10_000
        assert len(filtered.parts) <= 10_000
        assert "line 49999" in stage.words("lines")


def log_of(stage: Stage) -> LogScreen:
    assert isinstance(stage.app.screen, LogScreen)
    return stage.app.screen
