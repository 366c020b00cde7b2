"""Inputs of a tick: fresh sensor frames, their ages, and operators' frames by sending time."""

from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from checks.harness.processes import OPERATOR_BEAT
from protocol.bus.mailbox import MAX_SENDERS
from protocol.topics import OPERATOR, SONAR, TELEOP, WHEELS
from protocol.wire.limits import MAX_TELEOP_TTL_MS
from protocol.wire.messages import SonarScan, Teleop, WheelTicks
from robot.commands import TeleopInput, operator_twist
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, Twist
from robot.lease import Asker
from robot.process import CycleMeter
from robot.senses import DelayFilter, Senses, is_restarted, newer, sending_order
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock, Tick
from runtime.lockstep import LockstepClock
from runtime.sequence import MAX_LATE_TICKS, Order
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from runtime.units import PERIOD_NS, UINT32
from tests.support.each import each
from tests.support.played_bus import PlayedBus
from tests.support.robots import ADA as PROCESSES_ADA
from tests.support.robots import BOB as PROCESSES_BOB
from tests.support.robots import Desk

STEER = Teleop(time_ns=0, seq=0, speed_mm_s=200, yaw_rate_mrad_s=0, ttl_ms=500)
AGES_US = (10_000, 20_000) * 4


def wheels(seq: int, time_ns: int = 0) -> WheelTicks:
    return make(WheelTicks, time_ns=time_ns, seq=seq, left=seq)


def scan(seq: int, time_ns: int = 0) -> SonarScan:
    return make(SonarScan, time_ns=time_ns, seq=seq, range_mm=(9,) * 8, ping_age_us=AGES_US)


class SensesRig:
    """Sensor readers on a simulated bus, and the vehicle that receives operators' frames."""

    def __init__(self, *, lockstep: bool = False, plant_clock: LockstepClock | None = None) -> None:
        self.clock = ManualClock(1_000 * S)
        self.bus = PlayedBus(self.clock)
        self.vehicle = RobotVehicle(DEFAULTS, Store(None))
        accept = self.vehicle.lease.allows
        self.senses = Senses(self.bus, lockstep=lockstep, accept=accept, clock=plant_clock)

    def read(self, after_ns: int = 0, due_ns: int | None = None) -> Inputs:
        """Read in a tick this long after now."""
        self.clock.advance(after_ns)
        now_ns = self.clock.now_ns()
        tick = Tick(0, now_ns if due_ns is None else due_ns, 0, 0)
        return self.senses.read(tick, now_ns, self.vehicle)

    def beat(self, late_ns: int | None = 0, operator: str = PROCESSES_ADA) -> None:
        self.bus.say(OPERATOR, OPERATOR_BEAT, sender=operator, late_ns=late_ns)

    def steer(self, late_ns: int | None = 0, operator: str = PROCESSES_ADA) -> None:
        self.bus.say(TELEOP, STEER, sender=operator, late_ns=late_ns)

    @property
    def steered(self) -> bool:
        return self.vehicle.teleop.newest(self.clock.now_ns()) is not None


# Operators.


def test_operator_age_counts_from_the_sending_time() -> None:
    rig = SensesRig()
    rig.beat(late_ns=150 * MS)
    assert rig.read(100 * MS).operator_age_ms == 250
    assert rig.read(1 * S).operator_age_ms == 1_250


def test_heartbeat_from_the_future_counts_from_its_arrival() -> None:
    rig = SensesRig()
    rig.beat(late_ns=-800 * MS)
    assert rig.read(100 * MS).operator_age_ms == 100
    assert rig.read(1 * S).operator_age_ms == 1_100


def test_heartbeats_count_again_when_the_clock_of_their_sender_is_right_again() -> None:
    rig = SensesRig()
    rig.beat(late_ns=-3_600 * S)
    rig.read()
    rig.clock.advance(1 * S)
    rig.beat(late_ns=50 * MS)
    assert rig.read().operator_age_ms == 50


@each(("late_ms", "age_ms"), [(200.0, 200), (200.000_001, 1_000)])
def test_heartbeat_200_ms_later_than_usual_is_ignored(late_ms: float, age_ms: int) -> None:
    rig = SensesRig()
    rig.beat()
    rig.read()
    rig.clock.advance(1 * S)
    rig.beat(late_ns=round(late_ms * MS))
    assert rig.read().operator_age_ms == age_ms


@each(("late_ms", "taken"), [(200.0, True), (200.000_001, False)])
def test_teleop_frame_200_ms_later_than_usual_is_ignored(late_ms: float, taken: bool) -> None:
    rig = SensesRig()
    rig.beat()
    rig.read()
    rig.steer(late_ns=round(late_ms * MS))
    rig.read()
    assert rig.steered == taken


def test_a_teleop_frame_counts_from_when_it_was_sent() -> None:
    rig = SensesRig()
    rig.steer(late_ns=400 * MS)
    rig.read(100 * MS - 1)
    assert rig.steered
    rig.read(1)
    assert not rig.steered


@each(("late_ns", "age_ms"), [(1_500 * MS, 1_500), (1_500 * MS + 1, None)])
def test_first_heartbeat_too_old_is_ignored(late_ns: int, age_ms: int | None) -> None:
    """Send the first frame, before the usual delay of the operator is known."""
    rig = SensesRig()
    rig.beat(late_ns)
    assert rig.read().operator_age_ms == age_ms


@each(("late_ns", "operator"), [(None, PROCESSES_ADA), (0, ""), (None, "")])
def test_frame_without_sender_or_sending_time_is_ignored(
    late_ns: int | None, operator: str
) -> None:
    rig = SensesRig()
    rig.beat(late_ns, operator)
    rig.steer(late_ns, operator)
    assert rig.read().operator_age_ms is None
    assert not rig.steered


def test_frames_from_before_a_seizure_are_ignored() -> None:
    rig = SensesRig()
    rig.beat()
    rig.steer()
    rig.vehicle.lease._holder = Asker(PROCESSES_BOB, "Bob")
    assert rig.read().operator_age_ms is None
    assert not rig.steered


def test_teleop_frame_is_used_once() -> None:
    rig = SensesRig()
    rig.steer()
    rig.read()
    assert rig.steered
    rig.vehicle.teleop.clear()
    rig.read()
    assert not rig.steered


def test_in_lockstep_a_frame_in_time_counts_once_and_from_now_on() -> None:
    rig = SensesRig(lockstep=True)
    rig.beat(late_ns=150 * MS)
    assert rig.read(100 * MS).operator_age_ms == 0
    assert rig.read(1 * S).operator_age_ms == 1_000


# Senses.


def test_without_sensor_frames_inputs_are_none() -> None:
    senses = SensesRig().senses
    assert (senses.stamp_ns, senses.sequence, senses.ping_age_us) == (0, 0, 0)
    assert (senses.wheels_seq, senses.scan_seq, senses.scan_age_ms) == (0, 0, 0)


@each(("after_ns", "there"), [(150 * MS, True), (150 * MS + 1, False)])
def test_wheels_count_for_150_ms(after_ns: int, there: bool) -> None:
    rig = SensesRig()
    rig.bus.say(WHEELS, wheels(3))
    assert (rig.read(after_ns).wheels is not None) == there
    assert rig.senses.wheels_seq == (3 if there else 0)


@each(("after_ns", "there"), [(250 * MS, True), (250 * MS + 1, False)])
def test_a_scan_counts_for_250_ms(after_ns: int, there: bool) -> None:
    rig = SensesRig()
    rig.bus.say(SONAR, scan(3))
    assert (rig.read(after_ns).scan is not None) == there
    reported = (rig.senses.scan_seq, rig.senses.scan_age_ms, rig.senses.ping_age_us)
    assert reported == ((3, 250, 20_000) if there else (0, 0, 0))


def test_in_lockstep_senses_count_by_their_stamps() -> None:
    rig = SensesRig(lockstep=True)
    now_ns = rig.clock.now_ns()
    rig.bus.say(WHEELS, wheels(3, now_ns - 150 * MS))
    rig.bus.say(SONAR, scan(3, now_ns - 250 * MS))
    read = rig.read()
    assert read.wheels is not None
    assert read.scan is not None
    assert rig.senses.scan_age_ms == 250
    rig.bus.say(WHEELS, wheels(4, now_ns - 150 * MS))
    rig.bus.say(SONAR, scan(4, now_ns - 250 * MS))
    read = rig.read(1)
    assert (read.wheels, read.scan) == (None, None)


def test_in_lockstep_the_tick_is_that_of_the_clock() -> None:
    rig = SensesRig(lockstep=True)
    rig.bus.say(SONAR, scan(77, 5))
    rig.read(PERIOD_NS)
    assert rig.senses.stamp_ns == rig.clock.now_ns()
    assert rig.senses.sequence == rig.clock.now_ns() // PERIOD_NS


def test_in_lockstep_a_restarted_plant_loses_the_position() -> None:
    """The stamps begin again, even within the first second of the former plant."""
    clock = LockstepClock()
    rig = SensesRig(lockstep=True, plant_clock=clock)
    seen = []
    for number in (3, 4, 0):
        rig.bus.say(WHEELS, wheels(number, number * PERIOD_NS))
        rig.bus.say(SONAR, scan(number, number * PERIOD_NS))
        clock.advance_to(number * PERIOD_NS)
        inputs = rig.senses.read(Tick(0, 0, 0, 0), clock.now_ns(), rig.vehicle)
        assert inputs.wheels is not None
        assert inputs.scan is not None
        said = any("position lost" in text.text for text in rig.vehicle.texts())
        seen.append((rig.senses.sequence, rig.senses.scan_seq, rig.senses.scan_age_ms, said))
    assert seen == [(3, 3, 0, False), (4, 4, 0, False), (0, 0, 0, True)]
    assert clock.now_ns() == 5 * PERIOD_NS


@each("lockstep", [False, True])
def test_older_sensor_frames_are_refused_in_wall_time(lockstep: bool) -> None:
    """Restarts of the plant in lockstep are detected by the clock."""
    rig = SensesRig(lockstep=lockstep)
    for seq, time_ns in ((8, 8 * PERIOD_NS), (7, 7 * PERIOD_NS)):
        rig.bus.say(WHEELS, wheels(seq, time_ns))
        rig.bus.say(SONAR, scan(seq, time_ns))
    refused = {box.topic.path: box.rejected for _, box in rig.bus._boxes}
    assert refused[WHEELS.path] == refused[SONAR.path] == (0 if lockstep else 1)


def stamp_after(first_ns: int, second_ns: int) -> int:
    """Return the stamp of a tick whose scan has the second stamp, after one with the first."""
    rig = SensesRig()
    for seq, time_ns in ((1, first_ns), (2, second_ns)):
        rig.clock.advance(1 * S)
        rig.bus.say(SONAR, scan(seq, time_ns))
        rig.read()
    return rig.senses.stamp_ns


@each(("back_ns", "kept"), [(0, True), (1, True), (1 * S, True), (1 * S + 1, False)])
def test_time_goes_back_by_more_than_a_second_or_not_at_all(back_ns: int, kept: bool) -> None:
    assert stamp_after(9 * S, 9 * S - back_ns) == (9 * S if kept else 8 * S - 1)


def test_stamp_advances_with_the_time_since_the_scan() -> None:
    rig = SensesRig()
    rig.bus.say(SONAR, scan(1, 9 * S))
    came_ns = rig.clock.now_ns()
    for after_ns, stamp_ns in ((-5, 9 * S), (0, 9 * S), (7, 9 * S + 7)):
        rig.read(due_ns=came_ns + after_ns)
        assert rig.senses.stamp_ns == stamp_ns


# Order.


@each(
    ("behind", "overtaken", "anew"),
    [
        (-1, False, False),
        (0, False, False),
        (1, True, False),
        (20, True, False),
        (21, False, True),
        (UINT32 // 2 - 1, False, True),
        (UINT32 // 2, False, False),
    ],
)
@each("last_seq", [30, 0, UINT32])
def test_small_step_back_is_reordering_large_one_a_restart(
    last_seq: int, behind: int, overtaken: bool, anew: bool
) -> None:
    assert MAX_LATE_TICKS == 20
    last, newest = (wheels(last_seq), 1), (wheels((last_seq - behind) & UINT32), 2)
    assert newer(newest, last) is (last if overtaken else newest)
    assert is_restarted(newest, last) == anew


def test_first_sample_counts_as_newer() -> None:
    one = (wheels(5), 1)
    assert newer(one, None) is one
    assert newer(None, one) is None
    assert not is_restarted(one, None)
    assert not is_restarted(None, one)
    assert sending_order(one, None) is sending_order(None, one) is Order.NEWER


SCAN = make(SonarScan, seq=7, range_mm=(9,) * 8, echo=255)
TICKS = make(WheelTicks, seq=7)


def test_scan_age_is_never_negative() -> None:
    bus, vehicle = PlayedBus(ManualClock()), RobotVehicle(DEFAULTS, Store(None))
    senses = Senses(bus, lockstep=False)
    bus.say(SONAR, SCAN, at_ns=171 * MS)
    bus.say(WHEELS, TICKS, at_ns=171 * MS)
    inputs = senses.read(Tick(0, 100 * MS, 0, 0), 100 * MS, vehicle)
    assert senses.scan_age_ms == 0
    assert inputs.scan is not None
    assert min(inputs.scan.age_ms) == 0


def test_heartbeat_age_is_never_negative() -> None:
    vehicle = RobotVehicle(DEFAULTS, Store(None))
    vehicle.lease.beat("", 171 * MS)
    assert vehicle.operator_age_ms(100 * MS) == 0


def test_tick_lateness_is_never_negative() -> None:
    meter = CycleMeter(ManualClock(), period_ns=50 * MS, enforced=True)
    meter.begin(Tick(1, 0, -5_000 * MS, 0))
    assert meter.report(0, sense_age_us=0, rejected=0).late_us == 0


def test_operator_age_is_that_of_its_heartbeat() -> None:
    bus, vehicle = PlayedBus(ManualClock()), RobotVehicle(DEFAULTS, Store(None))
    senses = Senses(bus, lockstep=False, accept=vehicle.lease.allows)
    bus.say(OPERATOR, OPERATOR_BEAT, sender="open/0a", at_ns=60 * MS)
    senses.read(Tick(0, 100 * MS, 0, 0), 100 * MS, vehicle)
    assert vehicle.operator_age_ms(100 * MS) == 40


ADA = "ada/1"
BOB = "bob/2"


def late(delays: DelayFilter, delay_ms: float, at_ns: int, sender: str = ADA) -> bool:
    """Return whether a frame with this delay is late when it arrives at this time."""
    return delays.is_late(sender, at_ns - round(delay_ms * MS), at_ns)


def used_to(delay_ms: float, sender: str = ADA) -> DelayFilter:
    """Return a filter for a sender with this delay at second 0."""
    delays = DelayFilter()
    assert not late(delays, delay_ms, 0, sender)
    return delays


@each("delay_ms", [-5_000.0, 0.0, 3_000.0])
def test_first_frame_sets_the_usual_delay(delay_ms: float) -> None:
    """Clocks may differ, so the usual delay may have any value, even a negative one."""
    delays = used_to(delay_ms)
    assert not late(delays, delay_ms + 200.0, 1 * S)
    assert late(delays, delay_ms + 200.000_001, 1 * S)


def test_faster_frame_sets_a_new_usual_delay() -> None:
    delays = used_to(300.0)
    assert not late(delays, 50.0, 1 * S)
    assert late(delays, 300.0, 2 * S)


def test_a_late_frame_changes_nothing_for_the_next() -> None:
    delays = used_to(50.0)
    for second in (1, 2, 3):
        assert late(delays, 900.0, second * S)
    assert not late(delays, 250.0, 4 * S)


def test_longer_delay_is_usual_after_two_time_spans() -> None:
    delays = used_to(50.0)
    for at_ms in range(100, 10_000, 100):
        assert late(delays, 300.0, at_ms * MS), at_ms
    assert not late(delays, 300.0, 10_000 * MS)
    assert not late(delays, 500.0, 10_100 * MS)
    assert late(delays, 500.001, 10_200 * MS)


def test_a_span_lasts_five_seconds_to_the_nanosecond() -> None:
    delays = used_to(50.0)
    assert late(delays, 300.0, 5 * S - 1)
    assert late(delays, 300.0, 5 * S)
    assert late(delays, 300.0, 10 * S - 1)
    assert not late(delays, 300.0, 10 * S)


def test_minimum_of_the_previous_span_counts() -> None:
    delays = used_to(300.0)
    assert not late(delays, 50.0, 4 * S)
    assert late(delays, 300.0, 5 * S)
    assert late(delays, 300.0, 9 * S)


def test_senders_have_delays_of_their_own() -> None:
    delays = used_to(50.0)
    assert not late(delays, 2_000.0, 1 * S, BOB)
    assert not late(delays, 2_200.0, 1 * S, BOB)
    assert late(delays, 300.0, 1 * S, ADA)


def test_the_sixteen_newest_senders_are_kept() -> None:
    assert MAX_SENDERS == 16
    delays = used_to(0.0)
    for number in range(15):
        late(delays, 0.0, 0, f"op/{number}")
    assert late(delays, 300.0, 1, ADA), "its frame makes it the newest sender"
    for number in range(15, 30):
        late(delays, 0.0, 1, f"op/{number}")
    assert late(delays, 300.0, 2, ADA)
    for number in range(30, 46):
        late(delays, 0.0, 3, f"op/{number}")
    assert not late(delays, 300.0, 4, ADA), "forgotten, so this is its first"


@given(st.lists(st.integers(0, 190), min_size=1, max_size=50), st.integers(-(10**6), 10**6))
def test_jitter_of_less_than_200_ms_makes_no_frame_late(
    jitters_ms: list[int], offset_ms: int
) -> None:
    delays = DelayFilter()
    assert not any(
        late(delays, offset_ms + jitter_ms, at * 300 * MS)
        for at, jitter_ms in enumerate(jitters_ms)
    )


def frame(ttl_ms: int, speed_mm_s: int = 200, yaw_rate_mrad_s: int = -500) -> Teleop:
    return Teleop(
        time_ns=0, seq=1, speed_mm_s=speed_mm_s, yaw_rate_mrad_s=yaw_rate_mrad_s, ttl_ms=ttl_ms
    )


def test_no_twist_before_the_first_frame() -> None:
    assert TeleopInput().newest(0) is None
    assert operator_twist(None) is None


@given(
    st.integers(0, MAX_TELEOP_TTL_MS),
    st.integers(0, 10**15),
    st.integers(0, 2 * MAX_TELEOP_TTL_MS * MS),
)
def test_a_frame_counts_until_its_time_is_over(ttl_ms: int, arrived_ns: int, age_ns: int) -> None:
    handle = TeleopInput()
    assert handle.receive(frame(ttl_ms), arrived_ns) == ""
    steered = handle.newest(arrived_ns + age_ns) is not None
    assert steered == (age_ns < ttl_ms * MS)


def test_newer_frame_replaces_one_with_a_later_expiry() -> None:
    handle = TeleopInput()
    assert handle.receive(frame(MAX_TELEOP_TTL_MS, speed_mm_s=200), 0) == ""
    handle.receive(frame(100, speed_mm_s=50), 10 * MS)
    assert operator_twist(handle.newest(100 * MS)) == Twist(0.05, -0.5)
    assert handle.newest(110 * MS) is None


@each("ttl_ms", [MAX_TELEOP_TTL_MS + 1, 65_535])
def test_frame_with_too_long_ttl_is_ignored_and_reported_once(ttl_ms: int) -> None:
    handle = TeleopInput()
    assert f"at most {MAX_TELEOP_TTL_MS}" in handle.receive(frame(ttl_ms), 0)
    assert handle.receive(frame(ttl_ms), 1) == ""
    assert handle.newest(2) is None
    assert handle.receive(frame(100), 3) == ""
    assert f"at most {MAX_TELEOP_TTL_MS}" in handle.receive(frame(ttl_ms), 4)


def test_vehicle_announces_an_ignored_frame() -> None:
    desk = Desk()
    desk.vehicle.texts()
    for _ in range(3):
        desk.vehicle.receive_teleop(frame(900), 0)
    announced = "".join(text.text for text in desk.vehicle.texts())
    assert announced == f"teleop ignored: valid for 900 ms, at most {MAX_TELEOP_TTL_MS} are allowed"
