"""The log: filtered, found in, and told in full however narrow the screen is."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.app.filtered_log import FilteredLog
from ground.app.panels.log import MOST_LATELY, latest_rows, log_rows
from ground.app.widgets.rows import words_of
from ground.station.history.event_log import Line, Log
from protocol.wire.enums import Severity
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import play, staged
from tests.support.tui.underway import driving

REFUSAL = "refused: goal 99 7: outside of the fence, a circle of 4 m around 0 0; `fence off` " * 3
WORDS = st.text(st.sampled_from("ab é-"), max_size=60)


def line(text: str, severity: int = Severity.INFO, time_s: float = 1.0) -> Line:
    return Line(time_s, severity, "r1", text)


def filled(*texts: str, size: int = 10_000) -> Log:
    log = Log(size)
    for number, text in enumerate(texts):
        log.add(line(text, time_s=float(number)))
    return log


def test_a_short_line_is_one_row() -> None:
    assert list(map(words_of, log_rows(line("on  its way"), 60))) == ["     1.0 I r1 on  its way"]


def test_a_long_line_goes_on_below_where_its_text_begins() -> None:
    rows = list(map(words_of, log_rows(line(REFUSAL.strip()), 60)))
    assert len(rows) > 3
    assert all(len(one) <= 60 for one in rows)
    assert {one[:14] for one in rows[1:]} == {" " * 14}
    assert " ".join(one[14:] for one in rows) == REFUSAL.strip()


@given(st.lists(WORDS, max_size=12), st.integers(0, 90))
def test_rows_are_the_same_whether_lines_come_at_once_or_one_by_one(
    texts: list[str], width: int
) -> None:
    log, slowly, at_once = Log(5), FilteredLog(), FilteredLog()
    for text in texts:
        log.add(line(text))
        slowly.update(log, Severity.DEBUG, width)
    at_once.update(log, Severity.DEBUG, width)
    assert slowly.parts == at_once.parts
    assert slowly.lines == list(log)


def test_only_what_is_bad_enough_is_there() -> None:
    log = filled("well")
    log.add(line("bad", Severity.WARNING))
    log.add(line("worse", Severity.CRITICAL))
    filtered = FilteredLog()
    filtered.update(log, Severity.WARNING, 80)
    assert [one.text for one in filtered.lines] == ["bad", "worse"]
    filtered.update(log, Severity.ERROR, 80)
    assert [one.text for one in filtered.lines] == ["worse"]


def test_a_find_goes_round_and_all_rows_of_the_line_are_marked() -> None:
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


def test_of_two_lines_alike_the_one_that_was_found_is_meant() -> None:
    log, filtered = Log(), FilteredLog()
    for _ in range(3):
        log.add(line("the same"))
    filtered.update(log, Severity.DEBUG, 80)
    first, second, third = log
    assert filtered.find("same", second, 1) is third
    assert filtered.find("same", third, 1) is first


@pytest.mark.parametrize("height", [0, 1, 2, 4, 9])
def test_the_newest_lines_fit_below_the_map_and_the_last_is_not_crowded_out(height: int) -> None:
    log = filled("first", REFUSAL * 9, "last")
    rows = list(map(words_of, latest_rows(log, height, 60)))
    assert len(rows) == min(height, 2 + MOST_LATELY)
    assert all(len(one) <= 60 for one in rows)
    if rows:
        assert rows[-1].endswith("last")
    if height > 2:
        assert rows[-2].endswith("…")


def test_a_long_refusal_is_read_in_full_on_the_screen_of_the_log() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.note(REFUSAL, Severity.WARNING)
        async with staged((80, 24), station=station) as stage:
            await stage.press("4")
            shown = " ".join(part.strip() for part in stage.words("lines").splitlines())
            assert REFUSAL.strip() in shown

    play(story)
