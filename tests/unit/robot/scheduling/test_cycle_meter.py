from protocol.wire.codec import Encoder, decode
from protocol.wire.messages import CycleReport
from robot.core.brain import GUARD, NAVIGATE, ODOMETRY, READ, TICK_US
from robot.process import CycleMeter
from runtime.clock import ManualClock, Tick
from runtime.units import UINT32
from tests.support.each import each

PERIOD_NS = 50_000_000
US = 1_000


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
