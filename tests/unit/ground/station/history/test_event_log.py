"""The log is a bounded ring that can be searched."""

import tracemalloc

from ground.station import Line, Log
from protocol.wire.enums import Severity


def line(number: int, severity: int = Severity.INFO) -> Line:
    return Line(number / 10, severity, "r1", f"event {number}")


def test_a_reader_is_told_only_what_is_new() -> None:
    log = Log()
    for number in range(3):
        log.add(line(number))
    seen = log.total
    log.add(line(3))
    assert [found.text for found in log.since(seen)] == ["event 3"]
    assert log.since(log.total) == []


def test_who_comes_late_gets_what_is_kept() -> None:
    log = Log(size=2)
    for number in range(5):
        log.add(line(number))
    assert [found.text for found in log.since(0)] == ["event 3", "event 4"]
    assert log.total == 5
    assert [found.text for found in log.last(1)] == ["event 4"]


def test_it_is_searched_in_any_case_and_by_severity() -> None:
    log = Log()
    log.add(line(1))
    log.add(Line(0.0, Severity.ERROR, "r2", "Scan lost"))
    assert [found.source for found in log.find("SCAN")] == ["r2"]
    assert [found.source for found in log.find("r2")] == ["r2"]
    assert len(log.find("", Severity.ERROR)) == 1


def test_each_severity_has_its_letter() -> None:
    assert [line(0, severity).letter for severity in Severity] == list("EEEEWIID")
    assert line(0, 99).letter == "D"


def test_a_hundred_thousand_lines_leave_the_memory_bounded() -> None:
    log = Log()
    for number in range(10_000):
        log.add(line(number))
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for number in range(100_000):
        log.add(line(number))
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(log) == 10_000
    assert after - before < 4_000_000  # all kept lines are new ones, and they are all there is
