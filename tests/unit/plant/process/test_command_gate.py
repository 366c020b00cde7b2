"""Command gate of the motor driver: the wheel commands it admits, and their duration."""

from plant.process.robot_link import HELD_TICKS, SILENT_TICKS, CommandGate, WheelOutput
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from runtime.units import PERIOD_MS, UINT32
from tests.support.each import each
from tests.support.plant.commands import FAST, command, gate_at, taken

BRAKE = WheelOutput(0, 0, 0)
DRIVE = WheelOutput(FAST, FAST, MAX_WHEEL_TTL_MS)


@each(("age", "left_ms"), [(-1, None), (0, 150), (1, 100), (2, 50), (3, 0), (4, None), (20, None)])
def test_command_age_counts_from_the_tick_it_answers(age: int, left_ms: int | None) -> None:
    """Test the boundaries: a future tick, the age of 3 periods, and one period more."""
    expected = None if left_ms is None else WheelOutput(FAST, FAST, left_ms)
    assert taken(gate_at(20), command(20 - age)) == expected


@each(("ttl_ms", "left_ms"), [(1, 1), (149, 149), (150, 150), (151, 150), (65535, 150)])
def test_time_to_live_is_capped(ttl_ms: int, left_ms: int) -> None:
    assert taken(gate_at(20), command(20, ttl_ms=ttl_ms)) == WheelOutput(FAST, FAST, left_ms)


@each(("age", "left_ms"), [(1, 10), (2, 0), (3, 0)])
def test_short_time_to_live_counts_from_the_tick_too(age: int, left_ms: int) -> None:
    assert taken(gate_at(20), command(20 - age, ttl_ms=60)) == WheelOutput(FAST, FAST, left_ms)


def test_frame_of_finding_a3_is_rejected() -> None:
    gate = gate_at(20)
    assert gate.receive(command(UINT32, ttl_ms=65535)) == "answers a tick that was never sent"
    assert gate.take() is None
    assert taken(gate, command(20)) == DRIVE, "and nothing is deaf after it"


@each("age", [1, 2, 3])
def test_ticks_before_the_first_are_rejected(age: int) -> None:
    """Tick numbers wrap; the last uint32 numbers are not ticks before tick 0."""
    assert taken(gate_at(0), command(-age)) is None
    assert taken(gate_at(500, first=500), command(500 - age)) is None


@each("tick", [UINT32 - 1, UINT32, UINT32 + 1, UINT32 + 2])
def test_tick_number_may_wrap(tick: int) -> None:
    gate = gate_at(tick, first=UINT32 - 5)
    assert taken(gate, command(tick - 2)) == WheelOutput(FAST, FAST, 50)
    assert taken(gate, command(tick + 1)) is None


def test_commands_before_the_first_tick_are_rejected() -> None:
    gate = CommandGate()
    assert [gate.receive(command(0)), gate.receive(command(0, mrad_s=0))] == ["", ""]
    assert gate.take() is None
    assert not gate.answered


@each("one", [command(20), command(20, mrad_s=0), command(16), command(2), command(40, mrad_s=0)])
def test_late_command_is_not_counted_as_a_sender_fault(one: WheelCommand) -> None:
    gate = gate_at(20)
    assert gate.receive(one) == ""
    assert gate.receive(one) == ""


def test_commands_for_an_earlier_plant_are_rejected() -> None:
    """Accept answers to this plant despite the larger tick numbers of the earlier one."""
    gate = gate_at(0)
    assert taken(gate, command(4000, seq=4000)) is None
    assert taken(gate, command(0, seq=4001)) == DRIVE


@each(("tick", "seq", "obeyed"), [(20, 6, True), (20, 5, False), (20, 4, False), (19, 9, False)])
def test_newer_of_two_commands_is_used(tick: int, seq: int, obeyed: bool) -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=5))
    found = taken(gate, command(tick, seq=seq, mrad_s=1000))
    assert found == (WheelOutput(1000, 1000, MAX_WHEEL_TTL_MS) if obeyed else None)


def test_restarted_robot_counts_from_0_again() -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=4000))
    gate.begin_tick(21)
    assert taken(gate, command(21, seq=0)) == DRIVE


def test_command_between_two_ticks_ages() -> None:
    gate = gate_at(20)
    gate.receive(command(20))
    gate.begin_tick(21)
    assert gate.take() == WheelOutput(FAST, FAST, 100)


@each("sense_seq", [20, 19, 17, 16, 0, 21, 4000, UINT32])
@each("ttl_ms", [0, MAX_WHEEL_TTL_MS])
@each("seq", [0, UINT32])
@each("epoch", [0, 7, 9])
def test_brake_is_obeyed_whatever_its_numbers(
    sense_seq: int, ttl_ms: int, seq: int, epoch: int
) -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=5, epoch=7))
    speed = 0 if ttl_ms else FAST
    found = taken(gate, command(sense_seq, seq=seq, mrad_s=speed, ttl_ms=ttl_ms, epoch=epoch))
    assert found is not None
    assert found.ttl_ms == 0 or found[:2] == (0, 0)
    assert found.ttl_ms <= MAX_WHEEL_TTL_MS


def test_timely_brake_slows_motors_like_any_command() -> None:
    """Trajectories must be bit-identical with and without processes."""
    assert taken(gate_at(20), command(19, mrad_s=0)) == WheelOutput(0, 0, 100)


@each("first", [0, FAST])
def test_tick_answered_by_brake_and_move_holds_the_wheels(first: int) -> None:
    gate = gate_at(20)
    second = FAST - first
    assert taken(gate, command(20, seq=1, mrad_s=first), command(20, seq=2, mrad_s=second)) == BRAKE
    for tick in range(21, 20 + HELD_TICKS):
        gate.begin_tick(tick)
        why = gate.receive(command(tick, seq=tick))
        assert why == "moves the wheels while the robot brakes"
        assert gate.take() is None
    gate.begin_tick(20 + HELD_TICKS)
    assert taken(gate, command(20 + HELD_TICKS, seq=99)) == WheelOutput(
        FAST, FAST, MAX_WHEEL_TTL_MS
    )


def test_late_brake_contradicts_a_move_for_this_tick() -> None:
    assert taken(gate_at(20), command(3, mrad_s=0), command(20, seq=2)) == BRAKE


@each("sense_seq", [1, UINT32])
def test_late_brake_stops_the_wheels_at_once(sense_seq: int) -> None:
    """Include tick 0, where all times are small."""
    assert taken(gate_at(0), command(sense_seq, mrad_s=0)) == BRAKE
    assert taken(gate_at(0), command(0), command(sense_seq, mrad_s=0)) == BRAKE
    assert taken(gate_at(0), command(0), command(0, seq=2, mrad_s=0)) == BRAKE


@each("age", [0, 1, 2, 3])
@each("first", [0, FAST])
def test_each_valid_tick_accepts_only_one_answer(age: int, first: int) -> None:
    gate = gate_at(20)
    for tick in range(20, 24):
        gate.begin_tick(tick)
        taken(gate, command(tick, seq=1, mrad_s=first))
    assert taken(gate, command(23 - age, seq=2, mrad_s=FAST - first)) == BRAKE
    assert gate.receive(command(23, seq=3)) == "moves the wheels while the robot brakes"


@each("braked", [17, 18, 19])
def test_late_brake_for_another_tick_does_not_hold_wheels(braked: int) -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=5))
    late = taken(gate, command(braked, seq=9, mrad_s=0))
    assert late == WheelOutput(0, 0, (braked - 17) * PERIOD_MS), "it is obeyed"
    assert gate.answered
    assert taken(gate, command(20, seq=5)) is None, "a copy of what it stopped is not"
    assert taken(gate, command(20, seq=6)) == DRIVE


def test_move_for_the_tick_after_a_brake_is_obeyed_at_once() -> None:
    gate = gate_at(20)
    taken(gate, command(20, mrad_s=0))
    gate.begin_tick(21)
    assert taken(gate, command(21, seq=2)) == DRIVE


# Two robots of one name.


def test_robot_started_last_drives() -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=900, epoch=5))
    assert taken(gate, command(20, seq=0, mrad_s=1000, epoch=6)) == WheelOutput(
        1000, 1000, MAX_WHEEL_TTL_MS
    )
    why = gate.receive(command(20, seq=901, epoch=5))
    assert why == "comes from a robot that was started before the active one"
    assert gate.take() is None


def test_braking_newer_robot_locks_out_the_older() -> None:
    gate = gate_at(20)
    taken(gate, command(20, mrad_s=0, epoch=6))
    assert taken(gate, command(20, seq=9, epoch=5)) is None


def test_older_robot_may_brake_but_gains_no_control() -> None:
    gate = gate_at(20)
    taken(gate, command(19, epoch=6))
    assert taken(gate, command(18, mrad_s=0, epoch=5)) == WheelOutput(0, 0, 50)
    assert taken(gate, command(20, epoch=5)) is None


def test_late_commands_keep_a_newer_robot_alive() -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=2, epoch=6))
    gate.begin_tick(22)
    taken(gate, command(20, seq=1, epoch=6))
    gate.begin_tick(21 + SILENT_TICKS)
    assert taken(gate, command(21 + SILENT_TICKS, epoch=5)) is None
    gate.begin_tick(22 + SILENT_TICKS)
    assert taken(gate, command(22 + SILENT_TICKS, epoch=5)) == WheelOutput(
        FAST, FAST, MAX_WHEEL_TTL_MS
    )


@each(("silent", "drives"), [(SILENT_TICKS - 1, False), (SILENT_TICKS, True)])
def test_older_robot_drives_when_the_newer_is_silent(silent: int, drives: bool) -> None:
    gate = gate_at(20)
    taken(gate, command(20, epoch=6))
    for tick in range(21, 21 + silent):
        gate.begin_tick(tick)
    found = taken(gate, command(20 + silent, epoch=5))
    assert found == (WheelOutput(FAST, FAST, MAX_WHEEL_TTL_MS) if drives else None)


def test_stale_frame_of_a_newer_robot_locks_out_nothing() -> None:
    gate = gate_at(20)
    taken(
        gate, command(16, epoch=UINT32), command(16, mrad_s=0, epoch=UINT32), command(21, epoch=9)
    )
    gate.begin_tick(21)
    assert taken(gate, command(21, epoch=5)) == DRIVE


@each(
    ("sense_seq", "mrad_s", "epoch", "answered"),
    [
        (20, FAST, 5, True),
        (20, 0, 5, True),
        (19, FAST, 5, False),
        (21, FAST, 5, False),
        (20, FAST, 4, False),
    ],
)
def test_newest_tick_is_answered_only_by_timely_commands(
    sense_seq: int, mrad_s: int, epoch: int, answered: bool
) -> None:
    gate = gate_at(19)
    taken(gate, command(19, seq=0, epoch=5))
    gate.begin_tick(20)
    taken(gate, command(sense_seq, mrad_s=mrad_s, epoch=epoch))
    assert gate.answered == answered
