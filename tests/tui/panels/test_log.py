"""Test the log: wrapped, filtered and searched."""

from time import localtime, strftime

from hypothesis import given
from hypothesis import strategies as st

from ground.app.filtered_log import FilteredLog
from ground.app.panels.log import MOST_LATELY, latest_rows, log_rows
from ground.app.widgets.rows import words_of
from ground.station.history.event_log import EventLog, LogLine
from protocol.wire.enums import Severity
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.underway import driving

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


def test_log_screen_shows_a_long_line_in_full() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.note(REFUSAL, Severity.WARNING)
        async with staged((80, 24), station=station) as stage:
            await stage.press("4")
            shown = " ".join(part.strip() for part in stage.words("lines").splitlines())
            assert REFUSAL.strip() in shown

    play(story)
