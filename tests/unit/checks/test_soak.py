"""The soak: trends, the schedule of faults and restarts, the report and its interruption."""

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

from checks.endurance import fleet as supervised
from checks.endurance import soak
from checks.endurance.fleet import (
    CUT,
    KILL_NS,
    KILLED,
    STOPPED,
    RobotTelemetry,
    Size,
    faults,
    schedule,
    size_of,
)
from checks.endurance.soak import SETTLE_S, Course, report_of, student, trend
from checks.faults.restarts import Recovery, held_after_cut, of
from checks.harness.figures import Figure
from checks.harness.messages import make
from ground.recording.mcap_file import McapFormat
from protocol.wire.codec import Encoder
from protocol.wire.enums import Severity
from protocol.wire.messages import CycleReport, SonarScan, Statustext, WheelCommand
from robot.emergency_stop import KeptStop
from tests.support.each import each

ROLES = sorted({*KILLED, *STOPPED, *CUT, "ground r1"})
HALF_AN_HOUR_S = 1800.0


def life(
    begin_s: float, end_s: float, per_s: float, level: float = 40.0, noise: float = 0.0
) -> list[tuple[float, float]]:
    random = Random(begin_s)
    times = range(int(begin_s), int(end_s))
    return [(t, level + per_s * (t - begin_s) + random.gauss(0.0, noise)) for t in times]


def test_slope_is_estimated_within_its_margin() -> None:
    found = trend([life(0, HALF_AN_HOUR_S, 2.0 / 600.0, noise=0.5)])
    assert found is not None
    assert abs(found.slope - 2.0) < found.margin < 0.3
    assert found.last - found.first == pytest.approx(4.0, abs=0.4)


def test_noise_has_no_significant_slope() -> None:
    found = trend([life(0, HALF_AN_HOUR_S, 0.0, noise=1.0)])
    assert found is not None
    assert abs(found.slope) < found.margin < 0.5


def test_lives_at_different_levels_share_one_slope() -> None:
    lives = [
        life(0, 400, 3.0 / 600.0, 40.0),
        life(400, 900, 3.0 / 600.0, 60.0),
        life(900, 1300, 3.0 / 600.0, 20.0),
    ]
    found = trend(lives)
    assert found is not None
    assert found.slope == pytest.approx(3.0)
    assert found.longest_s == pytest.approx(500 - SETTLE_S, abs=2.0)


def test_growth_after_start_is_left_out() -> None:
    grows = life(0, 60, 0.5, 10.0) + life(60, 900, 0.0, 40.0)
    found = trend([grows])
    assert found is not None
    assert found.slope == pytest.approx(0.0)


def test_too_few_samples_give_infinite_margin() -> None:
    assert trend([]) is None
    assert trend([[]]) is None
    one = trend([[(5.0, 1.0)]])
    assert one is not None
    assert (one.slope, one.margin) == (0.0, inf)


@each(("freedom", "table"), [(3, 3.182), (5, 2.571), (10, 2.228), (30, 2.042), (1000, 1.962)])
def test_student_t_matches_tables(freedom: int, table: float) -> None:
    assert student(freedom) == pytest.approx(table, rel=0.01)


def test_schedule_has_each_fault_once_per_round_by_seed() -> None:
    plan = list(schedule(faults(ROLES), HALF_AN_HOUR_S, 4))
    assert plan == list(schedule(faults(ROLES), HALF_AN_HOUR_S, 4))
    assert plan != list(schedule(faults(ROLES), HALF_AN_HOUR_S, 5))
    kinds = faults(ROLES)
    for first in range(0, len(plan) - len(kinds), len(kinds)):
        assert {fault for _, fault in plan[first : first + len(kinds)]} == set(kinds)
    assert all(0 < later[0] - one[0] < 30 for one, later in pairwise(plan))
    assert plan[-1][0] + plan[-1][1].lasts_s < HALF_AN_HOUR_S - 20


def test_short_run_has_faults_of_present_roles_only() -> None:
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


def test_growth_is_judged_after_five_minutes() -> None:
    assert figure(grown(600.0, 0.9), "router, MB in 10 min").met
    assert figure(grown(600.0, 1.1), "router, MB in 10 min").met is False
    names = [one.name for one in report_of(grown(200.0, 9.0)).figures]
    assert not any(name.startswith("router") for name in names)
    assert any("router: 41" in note for note in report_of(grown(200.0, 9.0)).notes)


def test_silent_robot_and_given_up_process_fail() -> None:
    course = Course(robots=1, seconds=60.0)
    course.done = [("plant killed", 10.0, 10.1), ("router killed", 30.0, 30.1)]
    course.healed = [("plant killed", 3.0)]
    course.given_up = ["GIVEN UP: the router process"]
    assert not report_of(course).met
    missed = [one.name for one in report_of(course).figures if one.met is False]
    assert missed == ["faults after which a robot stayed silent", "processes given up"]
    assert "2 faults: 1 x plant killed, 1 x router killed" in report_of(course).notes[0]


def test_delay_is_from_own_scan_and_restart_misses_no_tick() -> None:
    telemetry = RobotTelemetry(0)
    encoder = Encoder(1, 1)
    for number in range(3):
        at_ns = number * 50_000_000
        scan = make(SonarScan, seq=number, range_mm=(9,) * 8, valid=0)
        command = make(WheelCommand, seq=9, sense_seq=number, ttl_ms=150)
        telemetry.record("", encoder.encode(scan), at_ns)
        telemetry.record("", encoder.encode(command), at_ns + 4_000_000)
    assert [delay for _, delay in telemetry.delays_ms] == [4.0, 4.0, 4.0]
    for tick, missed in ((7, 1), (8, 3), (1, 0), (2, 0)):
        telemetry.record("", encoder.encode(cycle(tick, missed)), tick)
    assert [missed for _, missed in telemetry.ticks] == [2, 0]
    telemetry.record("", b"noise", 0)


def cycle(tick: int, missed: int) -> CycleReport:
    return make(CycleReport, tick=tick, missed=missed)


def test_missing_events_are_counted_by_sequence_number(tmp_path: Path) -> None:
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


def test_only_existing_process_has_a_size() -> None:
    size = size_of(os.getpid())
    assert size is not None
    assert size.rss_mb > 10
    assert min(size.files, size.threads) >= 1
    assert size_of(1 << 22) is None


class NoFleet:
    """A fleet without processes."""

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
def test_signal_ends_soak_with_a_report(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: soak.Soak, _show: object) -> None:
        self._course.seconds = 42.0
        signal.raise_signal(number)

    monkeypatch.setattr(soak, "SoakFleet", NoFleet)
    monkeypatch.setattr(soak.Soak, "run", interrupted)
    options = argparse.Namespace(minutes=30.0, robots=3, world="open", seed=0)
    report = soak.measure(options)
    assert "ended by a signal after 42 s" in report.text()


class RecordedSignals:
    """Children that record signals; the loop ends after the second one."""

    def __init__(self, over: Event) -> None:
        self.killed: list[str] = []
        self._over = over

    def send(self, role: str, _number: int) -> bool:
        self.killed.append(role)
        if len(self.killed) == 2:
            self._over.set()
        return True

    def round(self, _now_ns: int) -> None: ...

    def next_event(self) -> str:
        return ""


class HalfMinuteClock:
    """A clock that advances by half a minute at each call."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        self._now_ns += KILL_NS // 2
        return self._now_ns


def test_supervised_robot_is_killed_every_minute(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(supervised, "ROUND_S", 0.0)
    over = Event()
    sent: Any = RecordedSignals(over)
    clock: Any = HalfMinuteClock()
    supervised.supervise(sent, sent, clock, over)
    assert sent.killed == ["robot r1", "robot r1"]
    assert clock.now_ns() == 3 * KILL_NS


TOOK = [Recovery(0.5, 0.7), Recovery(0.6, 2.0)]


def test_without_limit_only_the_total_is_reported() -> None:
    (figure,) = of("plant", TOOK, None)
    assert (figure.values, figure.met) == ((0.7, 2.0), None)


def test_limited_time_begins_when_the_hub_listens() -> None:
    whole, healing = of("router", TOOK, 1.0)
    assert whole.met is None
    assert healing.values == pytest.approx((0.2, 1.4))
    assert healing.met is True


@each("number", range(3))
def test_stop_outlives_a_power_cut(number: int) -> None:
    assert held_after_cut(number)


def test_stop_that_is_not_saved_is_lost_in_a_power_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KeptStop, "keep", lambda *_, **__: None)
    assert not held_after_cut(0)
