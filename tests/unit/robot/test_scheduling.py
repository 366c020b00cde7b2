"""The control cycle: its cost, its priority, and the rehearsal before the first tick."""

import gc
import os
import sys
import threading

import pytest

from protocol.wire.codec import Encoder, decode
from protocol.wire.messages import CycleReport
from robot.core.brain import GUARD, NAVIGATE, ODOMETRY, READ, TICK_US
from robot.core.parameters import DEFAULTS
from robot.process import CycleMeter
from robot.run import (
    FIFO_PRIORITY,
    LEAD_NS,
    SWITCH_S,
    Options,
    Rehearsal,
    RehearsingPulse,
    apply_options,
    share_interpreter,
    use_fifo,
)
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock, Tick, freeze_heap
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_US as US
from runtime.units import PERIOD_NS, UINT32
from tests.support.each import each


def tick(index: int = 0, late_ns: int = 0, missed: int = 0) -> Tick:
    return Tick(index, 0, late_ns, missed)


def metered(enforced: bool = True) -> tuple[CycleMeter, ManualClock]:
    clock = ManualClock()
    return CycleMeter(clock, period_ns=PERIOD_NS, enforced=enforced), clock


def cycle(meter: CycleMeter, clock: ManualClock, spent_us: int) -> None:
    meter.begin(tick())
    clock.advance(spent_us * US)
    meter.end()


def test_each_stage_is_charged_what_it_took() -> None:
    meter, clock = metered()
    meter.begin(tick(7, late_ns=30 * US, missed=2))
    for stage, spent_us in ((READ, 10), (ODOMETRY, 20), (NAVIGATE, 30), (GUARD, 40)):
        clock.advance(spent_us * US)
        meter.mark(stage)
    report = meter.report(5, sense_age_us=99, rejected=3)
    assert report.stage_us == (10, 20, 30, 40, 0)
    assert (report.tick, report.missed, report.late_us) == (7, 2, 30)
    assert (report.sense_age_us, report.rejected, report.budget_us) == (99, 3, TICK_US)


def test_writing_cost_is_reported_with_the_next_tick() -> None:
    meter, clock = metered()
    cycle(meter, clock, 70)
    meter.begin(tick(1))
    assert meter.report(0, sense_age_us=0, rejected=0).stage_us[-1] == 70


def test_three_overruns_in_a_row_violate_the_budget() -> None:
    meter, clock = metered()
    for violated in (False, False, True):
        cycle(meter, clock, TICK_US + 1)
        assert meter.violated is violated
    assert meter.overruns == 3
    cycle(meter, clock, 10)
    assert not meter.violated


def test_before_the_first_tick_nothing_is_measured() -> None:
    meter, _ = metered()
    assert not meter.violated
    report = meter.report(0, sense_age_us=0, rejected=0)
    assert (report.tick, report.missed, report.late_us, report.overruns) == (0, 0, 0, 0)
    assert report.stage_us == (0,) * 5


def test_tick_within_the_budget_resets_the_overruns() -> None:
    meter, clock = metered()
    for spent_us in (TICK_US + 1, TICK_US + 1, TICK_US, TICK_US + 1, TICK_US + 1):
        cycle(meter, clock, spent_us)
        assert not meter.violated
    cycle(meter, clock, TICK_US + 1)
    assert meter.violated


def test_a_tick_more_than_one_period_late_violates_it_at_once() -> None:
    meter, _ = metered()
    meter.begin(tick(late_ns=PERIOD_NS))
    assert not meter.violated
    meter.begin(tick(late_ns=PERIOD_NS + 1))
    assert meter.violated


def test_lockstep_is_independent_of_machine_load() -> None:
    meter, clock = metered(enforced=False)
    for _ in range(5):
        cycle(meter, clock, 10 * TICK_US)
    meter.begin(tick(late_ns=10 * PERIOD_NS))
    assert not meter.violated


def test_stage_cost_is_limited_to_16_bits() -> None:
    meter, clock = metered()
    meter.begin(tick())
    clock.advance(10**9)
    meter.mark(READ)
    assert meter.report(0, sense_age_us=0, rejected=0).stage_us[READ] == 65_535


@each("spent_us", [0, TICK_US])
def test_within_the_budget_nothing_is_counted(spent_us: int) -> None:
    meter, clock = metered()
    cycle(meter, clock, spent_us)
    assert meter.overruns == 0


def test_suspended_process_violates_it_despite_a_fresh_frame() -> None:
    meter, clock = metered()
    cycle(meter, clock, 100)
    clock.advance(2 * PERIOD_NS - 100 * US)
    meter.begin(tick(1))
    assert not meter.violated, "one period late at the most"
    clock.advance(2 * PERIOD_NS + 1)
    meter.begin(tick(2))
    assert meter.violated
    clock.advance(PERIOD_NS)
    meter.begin(tick(3))
    assert not meter.violated


@each("count", [UINT32 - 1, UINT32, UINT32 + 1, 1 << 40])
def test_report_values_are_limited_to_32_bits(count: int) -> None:
    """Five days of 10,000 unreadable frames a second, or a process suspended for 72 minutes."""
    meter, _ = metered()
    meter.begin(tick(count, late_ns=count * US, missed=count))
    meter.overruns = count
    report = decode(Encoder(1, 1).encode(meter.report(0, sense_age_us=count, rejected=count)))
    assert isinstance(report.message, CycleReport)
    assert report.message.tick == count & UINT32
    message = report.message
    counted = (
        message.missed,
        message.overruns,
        message.rejected,
        message.late_us,
        message.sense_age_us,
    )
    assert counted == (min(count, UINT32),) * 5


@pytest.fixture
def thawed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr(sys, "setswitchinterval", lambda _: None)


@pytest.mark.usefixtures("thawed")
def test_switch_interval_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    monkeypatch.setattr(sys, "setswitchinterval", seen.append)
    share_interpreter()
    assert seen == [SWITCH_S]
    assert SWITCH_S <= 0.001


@pytest.mark.usefixtures("thawed")
def test_a_frozen_heap_needs_no_warning() -> None:
    assert freeze_heap() is None


@pytest.mark.usefixtures("thawed")
def test_python_without_freeze_returns_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(gc, "freeze")
    assert "may stall the loop" in (freeze_heap() or "")


@pytest.mark.usefixtures("thawed")
def test_refused_real_time_scheduling_returns_a_warning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    assert "CAP_SYS_NICE" in (use_fifo() or "")


@pytest.mark.usefixtures("thawed")
def test_other_threads_are_scheduled_below_the_loop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: dict[int, int] = {}

    def give(thread: int, _policy: int, param: os.sched_param) -> None:
        if thread == gone:
            raise ProcessLookupError(3, "No such process")
        given[thread] = param.sched_priority

    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    gone = other.native_id
    monkeypatch.setattr(os, "sched_setscheduler", give)
    assert use_fifo() is None
    gone = None
    assert use_fifo() is None
    done.set()
    other.join()
    assert given[0] == FIFO_PRIORITY
    assert other.native_id is not None
    assert given[other.native_id] < FIFO_PRIORITY
    assert threading.get_native_id() not in given


@pytest.mark.usefixtures("thawed")
def test_any_other_failure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def failed(*_: object) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(os, "sched_setscheduler", failed)
    assert "Invalid argument" in (use_fifo() or "")


@pytest.mark.usefixtures("thawed")
def test_system_without_it_returns_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    assert "not available" in (use_fifo() or "")


@pytest.mark.usefixtures("thawed")
def test_failed_option_is_announced_on_the_bus(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")
    vehicle = RobotVehicle(DEFAULTS, Store(None))
    apply_options([vehicle], Options(fifo=True))
    assert "warning: real-time scheduling" in capsys.readouterr().err
    assert any("real-time scheduling" in text.text for text in vehicle.texts())


@pytest.mark.usefixtures("thawed")
def test_unselected_options_are_not_applied(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(gc, "freeze")
    monkeypatch.delattr(os, "sched_setscheduler")
    apply_options([RobotVehicle(DEFAULTS, Store(None))], Options(freeze=False))
    assert capsys.readouterr().err == ""


PATIENCE_NS = 12 * MS


class ScriptedPulse:
    """A pulse with scripted results of each wait."""

    def __init__(self, *answers: int | None) -> None:
        self.answers = list(answers)
        self.deadlines_ns: list[int] = []

    def wait_until(self, deadline_ns: int) -> int | None:
        self.deadlines_ns.append(deadline_ns)
        return self.answers.pop(0)


class Counted(Rehearsal):
    def __init__(self) -> None:
        super().__init__(DEFAULTS)
        self.runs = 0

    def run(self) -> object:  # type: ignore[override]
        self.runs += 1
        return super().run()


def rehearsed(*answers: int | None) -> tuple[RehearsingPulse, ScriptedPulse, Counted]:
    script, rehearsal = ScriptedPulse(*answers), Counted()
    return RehearsingPulse(script, rehearsal, PATIENCE_NS), script, rehearsal


def test_it_rehearses_shortly_before_the_frame_is_due() -> None:
    pulse, script, rehearsal = rehearsed(None, 50 * MS)
    assert pulse.wait_until(62 * MS) == 50 * MS
    assert script.deadlines_ns == [50 * MS - LEAD_NS, 62 * MS]
    assert rehearsal.runs == 1


def test_early_frame_is_not_delayed_by_a_rehearsal() -> None:
    pulse, _, rehearsal = rehearsed(40 * MS)
    assert pulse.wait_until(62 * MS) == 40 * MS
    assert rehearsal.runs == 0


def test_without_a_frame_the_deadline_ends_the_wait() -> None:
    pulse, script, rehearsal = rehearsed(None, None)
    assert pulse.wait_until(62 * MS) is None
    assert script.deadlines_ns[-1] == 62 * MS
    assert rehearsal.runs == 1


def test_rehearsals_drive_for_ever() -> None:
    rehearsal = Rehearsal(DEFAULTS)
    commands = [rehearsal.run() for _ in range(500)]
    assert commands[-1] == commands[-2]
    assert all(command.left_mrad_s and command.right_mrad_s for command in commands)
