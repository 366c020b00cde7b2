"""The robot process: its services, the messages and stamps of a period, and its end."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from checks.harness.messages import make
from protocol.bus.bus import Presence
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    CYCLE,
    DRIVE,
    INPUTS,
    OPERATOR,
    PARAMETER,
    SONAR,
    STATUS,
    SUMMARIES,
    TELEOP,
    TEXT,
    WHEELS,
    Role,
)
from protocol.wire.enums import (
    INPUT_BUDGET,
    INPUT_NAME_TAKEN,
    INPUT_SCAN,
    INPUT_WHEELS,
    Command,
    GoalState,
    Mode,
    Severity,
    Vehicle,
)
from protocol.wire.messages import (
    CommandRequest,
    Heartbeat,
    NavigatorStatus,
    ParamSet,
    ParamValue,
    SonarScan,
    Teleop,
    TickInputs,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from robot.commands import acknowledge
from robot.core import reasons, states
from robot.core.brain import GUARD, NAVIGATE, ODOMETRY, READ, TICK_US
from robot.core.modes import start_goal
from robot.core.parameters import DEFAULTS
from robot.core.values import Goal, Inputs
from robot.process import SERVICES
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock, Tick
from runtime.errors import LocalError
from runtime.units import NS_PER_MS as MS
from runtime.units import PERIOD_NS
from tests.support.each import each
from tests.support.played_bus import PlayedBus
from tests.support.robots import ADA, BRAKE, HeldWriter, Rig, driving, hold, speeds


def scan(number: int) -> SonarScan:
    """Return a scan sent a period after the previous one."""
    stamp = number * PERIOD_NS
    nothing, age = (4000,) * 8, (0,) * 8
    return make(SonarScan, time_ns=stamp, seq=number, range_mm=nothing, ping_age_us=age)


def stamps_ms(scans: list[tuple[int, int]]) -> list[int]:
    """Return the stamps of ticks a period apart, each with its newest scan and arrival in ms."""
    bus = PlayedBus(ManualClock())
    senses, vehicle = Senses(bus, lockstep=False), RobotVehicle(DEFAULTS, Store(None))
    found = []
    for number, (sent, arrived_ms) in enumerate(scans):
        bus.say(SONAR, scan(sent), at_ns=arrived_ms * MS)
        senses.read(Tick(number, number * PERIOD_NS, 0, 0), number * PERIOD_NS, vehicle)
        found.append(senses.stamp_ns // MS)
    return found


def test_stamp_is_that_of_the_scan() -> None:
    assert stamps_ms([(40, 0), (41, 50), (42, 100)]) == [2000, 2050, 2100]


def test_without_a_scan_stamp_advances_with_time() -> None:
    assert stamps_ms([(40, 0), (40, 0), (41, 75), (43, 150)]) == [2000, 2050, 2075, 2150]


def test_late_scan_does_not_decrease_the_stamp() -> None:
    assert stamps_ms([(40, 0), (40, 0), (40, 0), (41, 145)]) == [2000, 2050, 2100, 2100]


def test_restarted_plant_decreases_the_stamp() -> None:
    *before, lost, restarted = stamps_ms([(40, 0), *[(41, 50)] * 6, (2, 350)])
    assert (before[0], lost, restarted) == (2000, 2300, 100)


def test_all_services_the_stop_and_the_clock_are_served() -> None:
    rig = Rig().serve()
    assert rig.bus.services.keys() == {service.path for service in SERVICES}
    assert rig.bus.has_clock
    rig.cycle()
    assert rig.bus.kept_serving == 1


def test_telemetry_that_no_process_reads_is_not_made() -> None:
    rig = Rig().serve()
    reports: Any = rig.process.reports
    publishers = [reports.odometry, reports.decision, reports.cycle, reports.inputs]
    for publisher in publishers:
        publisher.matched = False
    rig.cycle()
    assert [publisher.said for publisher in publishers] == [[]] * 4
    assert reports.status.said
    for publisher in publishers:
        publisher.matched = True
    rig.cycle()
    assert [len(publisher.said) for publisher in publishers] == [1] * 4


def test_summary_comes_twice_a_second_and_with_each_change() -> None:
    rig = Rig().ready()
    topics = [topic for path, topic in SUMMARIES.items() if path != INPUTS.path]
    summary = [rig.bus.publisher(topic, "r1").said for topic in topics]
    for said in summary:
        said.clear()
    for _ in range(40):
        rig.cycle()
    assert {len(said) for said in summary} <= {3, 4, 5}
    before = len(summary[0])
    rig.vehicle.state.machine.vehicle = states.EMERGENCY_STOP
    rig.cycle()
    assert len(summary[0]) == before + 1
    newest = summary[0][-1]
    assert isinstance(newest, NavigatorStatus)
    assert newest.vehicle == Vehicle.EMERGENCY_STOP


def test_summary_has_inputs_only_while_some_are_missing() -> None:
    rig = Rig().ready()
    said = rig.bus.publisher(SUMMARIES[INPUTS.path], "r1").said
    said.clear()
    for flags, expected in ((3, 0), (1, 1), (1, 2), (7, 3), (3, 3)):
        rig.process.reports._summary.take_inputs(make(TickInputs, flags=flags))
        assert len(said) == expected


@each("end", ["idle", "cycle", "end"])
def test_texts_are_published_in_ticks_between_and_at_the_end(end: str) -> None:
    rig = Rig().ready()
    rig.vehicle.announce(6, "something new")
    if end == "idle":
        rig.process.idle()
    elif end == "cycle":
        rig.cycle()
    else:
        rig.process.run(iter(()))
    assert "something new" in [text.text for text in rig.sent(TEXT)]


@pytest.mark.parametrize("end", ["cycle", "idle", "end"])
def test_saving_is_acknowledged_after_the_write(end: str, tmp_path: Path) -> None:
    writer = HeldWriter()
    rig = Rig(Store(tmp_path, writer)).ready()
    rig.vehicle.state.machine.vehicle = states.STANDBY
    wanted = ParamSet(param_id="d_obs_m", param_value=0.5, param_type=9)
    request = rig.ask(wanted, service=PARAMETER)
    rig.cycle()
    assert request.answers == []
    if end == "end":
        rig.process.run(iter(()))
        rig.process.finish()
    else:
        writer.finish()
        rig.process.idle() if end == "idle" else rig.cycle()
    (answer,) = request.answers
    assert isinstance(answer, ParamValue)


def test_restored_state_is_recorded_as_requests(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()
    answer = acknowledge(hold(5), Reason.NONE)
    monkeypatch.setattr(rig.vehicle, "restore", lambda: [(hold(5), answer)])
    rig.serve()
    assert (rig.sent(COMMANDED), rig.sent(ANSWERED)) == ([hold(5)], [answer])


# Messages of a period.


def test_wheel_command_is_published_first() -> None:
    rig = driving()
    rig.bus.sent.clear()
    rig.cycle()
    assert isinstance(rig.bus.sent[0][1], WheelCommand)
    assert (rig.command.ttl_ms, rig.command.epoch) == (150, 0)
    assert rig.command.sense_seq == rig.ticks


def test_teleop_drives_and_is_in_the_inputs() -> None:
    rig = Rig().ready()
    beat = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
    rig.bus.say(OPERATOR, beat, sender=ADA)
    rig.cycle()
    rig.ask(command_to(Mode.MANUAL))
    frame = Teleop(time_ns=0, seq=0, speed_mm_s=200, yaw_rate_mrad_s=0, ttl_ms=500)
    rig.bus.say(TELEOP, frame, sender=ADA)
    rig.cycle()
    assert speeds(rig.command)[0] > 0
    published = rig.sent(INPUTS)[-1]
    assert (published.speed_mm_s, published.tick) == (200, rig.ticks)
    assert published.requests == rig.process.reports.recorded == 1
    assert (published.wheels_seq, published.scan_seq) == (rig.ticks, rig.ticks)


def test_a_robot_that_is_not_armed_brakes() -> None:
    """Speeds of a killed process that this one replaces must not end in the motors' own ramp."""
    rig = Rig()
    for _ in range(4):
        rig.cycle()
        assert speeds(rig.command) == (0, 0, 0)
    assert rig.vehicle.state.machine.vehicle == Vehicle.STANDBY


def test_speeds_whose_time_is_up_end_in_a_brake() -> None:
    rig = Rig().ready()
    beat = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
    rig.bus.say(OPERATOR, beat, sender=ADA)
    rig.cycle()
    rig.ask(command_to(Mode.MANUAL))
    frame = Teleop(time_ns=0, seq=0, speed_mm_s=200, yaw_rate_mrad_s=0, ttl_ms=100)
    rig.bus.say(TELEOP, frame, sender=ADA)
    rig.cycle()
    assert rig.command.ttl_ms == 150
    for _ in range(3):
        rig.cycle()
    assert speeds(rig.command) == (0, 0, 0)
    assert rig.vehicle.state.machine.vehicle == Vehicle.ACTIVE


def command_to(mode: Mode) -> CommandRequest:
    return CommandRequest(request_id=9, command=Command.DO_SET_MODE, param1=1.0, param2=mode)


def test_each_period_publishes_a_cycle_report() -> None:
    rig = Rig().ready()
    rig.bus.rejected = {"one": 2, "two": 3}
    rig.cycle()
    published = rig.sent(CYCLE)[-1]
    assert (published.tick, published.rejected, published.sense_age_us) == (rig.ticks, 5, 0)


def test_inputs_flag_the_present_sensors() -> None:
    rig = Rig().serve()
    rig.process.cycle(Tick(0, rig.clock.now_ns(), 0, 0))
    assert rig.sent(INPUTS)[-1].flags == 0
    rig.cycle()
    assert rig.sent(INPUTS)[-1].flags == INPUT_WHEELS | INPUT_SCAN


def test_time_before_the_core_counts_as_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig().ready()
    read = rig.senses.read

    def read_slowly(*given: Any) -> Inputs:
        rig.clock.advance(2 * MS)
        return read(*given)

    monkeypatch.setattr(rig.senses, "read", read_slowly)
    rig.cycle()
    stages_us = rig.sent(CYCLE)[-1].stage_us
    assert [stages_us[stage] for stage in (READ, ODOMETRY, NAVIGATE, GUARD)] == [2_000, 0, 0, 0]


def test_threads_of_the_bus_are_checked_after_the_command() -> None:
    rig = Rig().ready()
    rig.bus.serving_ns = 2 * MS
    rig.cycle()
    assert rig.sent(CYCLE)[-1].sense_age_us == 0


class Slow:
    """Advances the time during the core's step."""

    def __init__(self, rig: Rig, spent_ns: int) -> None:
        self._rig, self._spent_ns, self._step = rig, spent_ns, rig.vehicle.step

    def __call__(self, *given: object) -> object:
        self._rig.clock.advance(self._spent_ns)
        return self._step(*given)  # type: ignore[arg-type]


def test_sensor_age_counts_until_the_wheel_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig().ready()
    monkeypatch.setattr(rig.vehicle, "step", Slow(rig, 3 * MS))
    rig.cycle()
    assert rig.sent(CYCLE)[-1].sense_age_us == 3_000


def test_three_periods_over_the_budget_stop_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(enforced=True).ready()
    monkeypatch.setattr(rig.vehicle, "step", Slow(rig, (TICK_US + 1) * 1_000))
    for _ in range(3):
        rig.cycle()
        assert rig.vehicle.state.machine.vehicle == states.ACTIVE
        assert not rig.sent(INPUTS)[-1].flags & INPUT_BUDGET
    assert rig.meter.overruns == 3
    rig.cycle()
    assert rig.vehicle.state.machine.vehicle_reason == Reason.BUDGET
    assert rig.sent(INPUTS)[-1].flags & INPUT_BUDGET


def test_second_robot_of_the_same_name_stops_this_one() -> None:
    rig = driving()
    rig.bus.come(Role.ROBOT, "r1", "theirs")
    rig.cycle()
    assert rig.vehicle.state.machine.vehicle_reason == Reason.NAME_TAKEN
    assert rig.sent(INPUTS)[-1].flags & INPUT_NAME_TAKEN
    rig.bus.go(Role.ROBOT)
    rig.cycle()
    assert not rig.sent(INPUTS)[-1].flags & INPUT_NAME_TAKEN
    assert Presence("r1", Role.ROBOT.value, "theirs") not in rig.bus.there


# The end.


def ticks(rig: Rig, count: int, stop_in: int = 0) -> Iterator[Tick]:
    """Yield this many ticks; stop the process in one of them."""
    for number in range(1, count + 1):
        tick = rig.next_tick()
        if number == stop_in:
            rig.process.stop()
        yield tick


def ended(rig: Rig) -> tuple[int, int, int, int]:
    machine = rig.vehicle.state.machine
    return machine.vehicle, machine.vehicle_reason, machine.goal_state, machine.goal_reason


def test_it_ends_after_the_tick_of_the_stop() -> None:
    rig = driving()
    before = rig.ticks
    rig.process.run(ticks(rig, 10, stop_in=4))
    assert rig.ticks == before + 4
    assert rig.sent(INPUTS)[-1].tick == rig.ticks, "that tick was run"


def test_end_brakes_the_wheels_and_ends_the_goal() -> None:
    rig = driving()
    rig.process.run(ticks(rig, 2))
    assert speeds(rig.command) == BRAKE
    assert rig.command.sense_seq == rig.ticks
    aborted = (GoalState.ABORTED, Reason.SHUT_DOWN)
    assert ended(rig) == (states.FAILSAFE, Reason.SHUT_DOWN, *aborted)
    status = rig.sent(STATUS)[-1]
    assert (status.goal, status.goal_reason) == aborted


def test_exception_of_the_core_brakes_and_is_raised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = driving()

    def broken(*_: object) -> None:
        raise ZeroDivisionError("a defect\nin two lines")

    monkeypatch.setattr(rig.vehicle, "step", broken)
    with pytest.raises(ZeroDivisionError):
        rig.process.run(ticks(rig, 2))
    assert speeds(rig.command) == BRAKE
    said = [(text.severity, text.text) for text in rig.sent(TEXT)]
    assert (Severity.CRITICAL, "the control core failed: ZeroDivisionError: a defe") in said
    assert not [text for _, text in said if "in two lines" in text]
    aborted = (GoalState.ABORTED, Reason.CORE_EXCEPTION)
    assert ended(rig) == (states.FAILSAFE, Reason.CORE_EXCEPTION, *aborted)


def test_the_end_waits_three_seconds_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = driving()
    patience_s: list[float] = []
    monkeypatch.setattr(rig.vehicle, "finish_saving", patience_s.append)
    rig.process.finish()
    assert patience_s == [3.0]


def test_failed_publication_at_the_end_still_brakes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = driving()

    def unfit(*_: object) -> None:
        raise LocalError("no time")

    monkeypatch.setattr(rig.process.reports, "state", unfit)
    rig.process.run(iter(()))
    assert speeds(rig.command) == BRAKE


def test_the_brake_is_the_first_and_only_command_of_the_end() -> None:
    rig = driving()
    before = len(rig.sent(DRIVE))
    rig.bus.sent.clear()
    rig.process.run(iter(()))
    assert isinstance(rig.bus.sent[0][1], WheelCommand)
    assert len(rig.sent(DRIVE)) == before + 1


LOST = "position lost: sensor stream restarted"


def read(stamps: list[int], *, lockstep: bool) -> RobotVehicle:
    """Return an armed robot with a goal that has received these wheel ticks."""
    bus, vehicle = PlayedBus(ManualClock()), RobotVehicle(DEFAULTS, Store(None))
    senses = Senses(bus, lockstep=lockstep)
    machine = vehicle.state.machine
    machine.vehicle = states.ACTIVE
    start_goal(machine, Goal(3.0, 1.0, None, 0.05, 0.05), states.AUTO, 0)
    vehicle.texts()
    for number, stamp in enumerate(stamps):
        now_ns = number * PERIOD_NS
        ticks = make(WheelTicks, time_ns=stamp * PERIOD_NS, seq=stamp)
        bus.say(WHEELS, ticks, at_ns=now_ns)
        senses.read(Tick(number, now_ns, 0, 0), now_ns, vehicle)
    return vehicle


def announced(vehicle: RobotVehicle) -> list[str]:
    return [text.text for text in vehicle.texts() if text.severity == Severity.ERROR]


def test_restarted_sensors_stop_the_robot_with_a_text() -> None:
    vehicle = read([*range(100, 120), *range(10)], lockstep=False)
    machine = vehicle.state.machine
    assert (machine.vehicle, machine.vehicle_reason) == (states.FAILSAFE, reasons.TICKS_LOST)
    assert machine.goal_state == states.ABORTED
    assert "".join(announced(vehicle)).startswith(LOST)
    assert not machine.placed


def test_increasing_counts_keep_the_robot_driving() -> None:
    vehicle = read([*range(100, 120)], lockstep=False)
    assert vehicle.state.machine.vehicle == states.ACTIVE
    assert vehicle.state.machine.placed
    assert announced(vehicle) == []


def test_in_lockstep_restarted_sensors_are_ignored() -> None:
    vehicle = read([*range(100, 120), *range(10)], lockstep=True)
    assert vehicle.state.machine.vehicle == states.ACTIVE


def test_wrapped_tick_count_is_no_restart() -> None:
    stamps = [number & 0xFFFFFFFF for number in range((1 << 32) - 10, (1 << 32) + 10)]
    vehicle = read(stamps, lockstep=False)
    assert vehicle.state.machine.vehicle == states.ACTIVE
    assert announced(vehicle) == []
