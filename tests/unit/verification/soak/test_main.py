"""What the soak says of growth and losses follows from what was sampled, and from nothing else."""

import argparse
import os
import signal
from itertools import pairwise
from math import inf
from pathlib import Path
from random import Random
from threading import Event
from types import TracebackType
from typing import Any, Self

import pytest

from ground.recording.mcap.writer import McapFormat
from protocol.wire.codec import Encoder
from protocol.wire.enums import Severity
from protocol.wire.messages import CycleReport, SonarScan, Statustext, WheelCommand
from verification.harness.figures import Figure
from verification.soak import main as soak
from verification.soak import supervised
from verification.soak.drift import SETTLE_S, student, trend
from verification.soak.faults import CUT, KILLED, STOPPED, faults, schedule
from verification.soak.fleet import Size, size_of
from verification.soak.fleet_telemetry import Heard
from verification.soak.report import Course, report_of
from verification.soak.supervised import KILL_NS

ROLES = sorted({*KILLED, *STOPPED, *CUT, "ground r1"})
HALF_AN_HOUR_S = 1800.0


def life(
    begin_s: float, end_s: float, per_s: float, level: float = 40.0, noise: float = 0.0
) -> list[tuple[float, float]]:
    random = Random(begin_s)
    times = range(int(begin_s), int(end_s))
    return [(t, level + per_s * (t - begin_s) + random.gauss(0.0, noise)) for t in times]


def test_a_slope_is_found_with_its_confidence() -> None:
    found = trend([life(0, HALF_AN_HOUR_S, 2.0 / 600.0, noise=0.5)])
    assert found is not None
    assert abs(found.slope - 2.0) < found.margin < 0.3
    assert found.last - found.first == pytest.approx(4.0, abs=0.4)


def test_noise_alone_is_no_growth() -> None:
    found = trend([life(0, HALF_AN_HOUR_S, 0.0, noise=1.0)])
    assert found is not None
    assert abs(found.slope) < found.margin < 0.5


def test_lives_of_other_levels_have_one_slope() -> None:
    lives = [
        life(0, 400, 3.0 / 600.0, 40.0),
        life(400, 900, 3.0 / 600.0, 60.0),
        life(900, 1300, 3.0 / 600.0, 20.0),
    ]
    found = trend(lives)
    assert found is not None
    assert found.slope == pytest.approx(3.0)
    assert found.longest_s == pytest.approx(500 - SETTLE_S, abs=2.0)


def test_the_growth_of_a_start_does_not_count() -> None:
    grows = life(0, 60, 0.5, 10.0) + life(60, 900, 0.0, 40.0)
    found = trend([grows])
    assert found is not None
    assert found.slope == pytest.approx(0.0)


def test_of_too_little_nothing_is_claimed() -> None:
    assert trend([]) is None
    assert trend([[]]) is None
    one = trend([[(5.0, 1.0)]])
    assert one is not None
    assert (one.slope, one.margin) == (0.0, inf)


@pytest.mark.parametrize(
    ("freedom", "table"), [(3, 3.182), (5, 2.571), (10, 2.228), (30, 2.042), (1000, 1.962)]
)
def test_students_t_is_that_of_the_tables(freedom: int, table: float) -> None:
    assert student(freedom) == pytest.approx(table, rel=0.01)


def test_everything_is_done_once_in_each_round_and_the_same_for_the_same_seed() -> None:
    plan = list(schedule(faults(ROLES), HALF_AN_HOUR_S, 4))
    assert plan == list(schedule(faults(ROLES), HALF_AN_HOUR_S, 4))
    assert plan != list(schedule(faults(ROLES), HALF_AN_HOUR_S, 5))
    kinds = faults(ROLES)
    for first in range(0, len(plan) - len(kinds), len(kinds)):
        assert {fault for _, fault in plan[first : first + len(kinds)]} == set(kinds)
    assert all(0 < later[0] - one[0] < 30 for one, later in pairwise(plan))
    assert plan[-1][0] + plan[-1][1].lasts_s < HALF_AN_HOUR_S - 20


def test_a_short_run_has_some_too_and_who_is_not_there_is_left_alone() -> None:
    assert len(list(schedule(faults(ROLES), 30.0, 0))) >= 3
    assert {fault.role for fault in faults(["router", "robot r1"])} == {"router", "robot r1"}


def grown(seconds: float, per_ten_minutes: float) -> Course:
    course = Course(robots=1, seconds=seconds)
    for at_s in range(int(seconds)):
        size = Size(40.0 + per_ten_minutes * at_s / 600.0, 12, 7)
        course.sample(float(at_s), {("router", 1): size})
    return course


def figure(course: Course, name: str) -> Figure:
    return next(one for one in report_of(course).figures if one.name == name)


def test_growth_is_judged_of_who_lived_for_five_minutes() -> None:
    assert figure(grown(600.0, 0.9), "router, MB in 10 min").met
    assert figure(grown(600.0, 1.1), "router, MB in 10 min").met is False
    names = [one.name for one in report_of(grown(200.0, 9.0)).figures]
    assert not any(name.startswith("router") for name in names)
    assert any("router: 41" in note for note in report_of(grown(200.0, 9.0)).notes)


def test_what_was_not_heard_again_fails_and_so_does_who_is_given_up() -> None:
    course = Course(robots=1, seconds=60.0)
    course.done = [("plant killed", 10.0, 10.1), ("router killed", 30.0, 30.1)]
    course.healed = [("plant killed", 3.0)]
    course.given_up = ["GIVEN UP: the router process"]
    assert not report_of(course).met
    missed = [one.name for one in report_of(course).figures if one.met is False]
    assert missed == ["faults after which somebody stayed silent", "processes given up"]
    assert "2 faults: 1 x plant killed, 1 x router killed" in report_of(course).notes[0]


def test_commands_are_timed_from_their_own_scan_and_restarts_miss_no_ticks() -> None:
    heard = Heard(0)
    encoder = Encoder(1, 1)
    for number in range(3):
        at_ns = number * 50_000_000
        scan = SonarScan(
            time_ns=0, seq=number, range_mm=(9,) * 8, ping_age_us=(0,) * 8, valid=0, echo=0
        )
        command = WheelCommand(
            time_ns=0, seq=9, sense_seq=number, left_mrad_s=0, right_mrad_s=0, ttl_ms=150
        )
        heard.take("", encoder.encode(scan), at_ns)
        heard.take("", encoder.encode(command), at_ns + 4_000_000)
    assert [delay for _, delay in heard.delays_ms] == [4.0, 4.0, 4.0]
    for tick, missed in ((7, 1), (8, 3), (1, 0), (2, 0)):
        heard.take("", encoder.encode(cycle(tick, missed)), tick)
    assert [missed for _, missed in heard.ticks] == [2, 0]
    heard.take("", b"noise", 0)


def cycle(tick: int, missed: int) -> CycleReport:
    return CycleReport(
        time_ns=0, tick=tick, missed=missed, overruns=0, rejected=0, late_us=0, sense_age_us=0,
        budget_us=0, stage_us=(0,) * 5,
    )  # fmt: skip


def test_events_missing_in_the_log_are_counted_by_their_numbers(tmp_path: Path) -> None:
    form, encoder = McapFormat("r1", {}), Encoder(1, 1)
    frames = [
        encoder.encode(Statustext(severity=Severity.INFO, text=f"{number}")) for number in range(9)
    ]
    for number in (0, 1, 2, 5, 6, 8):
        form.add("sidestep/r1/tlm/text", frames[number], 1000 + number)
    (tmp_path / "20260304T120005Z-r1.mcap").write_bytes(form.end())
    course = Course(robots=1)
    course.read_log(tmp_path)
    assert (course.events, course.events_missing) == (6, 3)


def test_our_own_process_has_a_size_and_a_process_that_is_gone_has_none() -> None:
    size = size_of(os.getpid())
    assert size is not None
    assert size.rss_mb > 10
    assert min(size.files, size.threads) >= 1
    assert size_of(1 << 22) is None


class NoFleet:
    """Nothing is started."""

    roles: tuple[str, ...] = ()
    given_up: tuple[str, ...] = ()

    def __init__(self, *_: object) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_gives_the_report_of_what_there_was(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: soak.Soak, _tell: object) -> None:
        self._course.seconds = 42.0
        signal.raise_signal(number)

    monkeypatch.setattr(soak, "Fleet", NoFleet)
    monkeypatch.setattr(soak.Soak, "run", interrupted)
    options = argparse.Namespace(minutes=30.0, robots=3, world="open", seed=0)
    report = soak.measure(options)
    assert "ended by a signal after 42 s" in report.text()


class Sent:
    """Children that are only told what is done to them; the loop ends after the second."""

    def __init__(self, over: Event) -> None:
        self.killed: list[str] = []
        self._over = over

    def send(self, role: str, _number: int) -> bool:
        self.killed.append(role)
        if len(self.killed) == 2:
            self._over.set()
        return True

    def round(self, _now_ns: int) -> None: ...

    def news(self) -> str:
        return ""


class Leaping:
    """A clock on which half a minute goes by between two looks."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        self._now_ns += KILL_NS // 2
        return self._now_ns


def test_the_supervisor_that_is_watched_has_a_robot_to_start_again_each_minute(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(supervised, "ROUND_S", 0.0)
    over = Event()
    sent: Any = Sent(over)
    clock: Any = Leaping()
    supervised.supervise(sent, sent, clock, over)
    assert sent.killed == ["robot r1", "robot r1"]
    assert clock.now_ns() == 3 * KILL_NS
