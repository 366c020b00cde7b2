"""The log is a bounded, searchable ring."""

import tracemalloc

from ground.station.history.event_log import EventLog, LogLine
from protocol.wire.enums import Severity


def line(number: int, severity: int = Severity.INFO) -> LogLine:
    return LogLine(number / 10, severity, "r1", f"event {number}")


def test_since_returns_new_lines() -> None:
    log = EventLog()
    for number in range(3):
        log.add(line(number))
    seen = log.total
    log.add(line(3))
    assert [found.text for found in log.since(seen)] == ["event 3"]
    assert log.since(log.total) == []


def test_late_reader_gets_the_kept_lines() -> None:
    log = EventLog(size=2)
    for number in range(5):
        log.add(line(number))
    assert [found.text for found in log.since(0)] == ["event 3", "event 4"]
    assert log.total == 5
    assert [found.text for found in log.last(1)] == ["event 4"]


def test_find_ignores_case_and_filters_by_severity() -> None:
    log = EventLog()
    log.add(line(1))
    log.add(LogLine(0.0, Severity.ERROR, "r2", "Scan lost"))
    assert [found.source for found in log.find("SCAN")] == ["r2"]
    assert [found.source for found in log.find("r2")] == ["r2"]
    assert len(log.find("", Severity.ERROR)) == 1


def test_each_severity_has_its_letter() -> None:
    assert [line(0, severity).letter for severity in Severity] == list("EEEEWIID")
    assert line(0, 99).letter == "D"


def test_log_memory_is_bounded() -> None:
    log = EventLog()
    for number in range(10_000):
        log.add(line(number))
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for number in range(100_000):
        log.add(line(number))
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(log) == 10_000
    assert after - before < 4_000_000  # all kept lines are new
