"""The motor driver's last word: which wheel commands are obeyed, and for how long."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.body import Body
from plant.command_gate import HELD_TICKS, SILENT_TICKS, CommandGate, Demand
from plant.drive import Drive
from plant.noise import LEVELS
from plant.trouble import NO_TROUBLE
from protocol.messages import WheelCommand
from protocol.timing import PERIOD_MS, PERIOD_NS, TTL_MS

UINT32 = 0xFFFFFFFF
FAST = 9000
BRAKE = Demand(0, 0, 0)


def command(
    sense_seq: int, *, seq: int = 1, mrad_s: int = FAST, ttl_ms: int = TTL_MS, epoch: int = 0
) -> WheelCommand:
    return WheelCommand(
        time_ns=0,
        seq=seq,
        sense_seq=sense_seq & UINT32,
        epoch=epoch,
        left_mrad_s=mrad_s,
        right_mrad_s=mrad_s,
        ttl_ms=ttl_ms,
    )


def gate_at(tick: int, first: int = 0) -> CommandGate:
    """A plant that has sent all ticks from the first one on."""
    gate = CommandGate()
    for sent in range(first, tick + 1):
        gate.begin_tick(sent)
    return gate


def taken(gate: CommandGate, *commands: WheelCommand) -> Demand | None:
    for one in commands:
        gate.receive(one)
    return gate.take()


@pytest.mark.parametrize(
    ("age", "left_ms"), [(-1, None), (0, 150), (1, 100), (2, 50), (3, 0), (4, None), (20, None)]
)
def test_a_command_counts_from_the_tick_it_answers(age: int, left_ms: int | None) -> None:
    """A future tick, the age of 3 periods and the one beyond are the boundaries."""
    expected = None if left_ms is None else Demand(FAST, FAST, left_ms)
    assert taken(gate_at(20), command(20 - age)) == expected


@pytest.mark.parametrize(
    ("ttl_ms", "left_ms"), [(1, 1), (149, 149), (150, 150), (151, 150), (65535, 150)]
)
def test_the_time_to_live_is_capped(ttl_ms: int, left_ms: int) -> None:
    assert taken(gate_at(20), command(20, ttl_ms=ttl_ms)) == Demand(FAST, FAST, left_ms)


@pytest.mark.parametrize(("age", "left_ms"), [(1, 10), (2, 0), (3, 0)])
def test_a_short_time_to_live_counts_from_the_tick_too(age: int, left_ms: int) -> None:
    assert taken(gate_at(20), command(20 - age, ttl_ms=60)) == Demand(FAST, FAST, left_ms)


def test_the_frame_of_finding_a3_is_refused() -> None:
    gate = gate_at(20)
    assert gate.receive(command(UINT32, ttl_ms=65535)) == "answers a tick that was never sent"
    assert gate.take() is None
    assert taken(gate, command(20)) == Demand(FAST, FAST, TTL_MS), "and nothing is deaf after it"


@pytest.mark.parametrize("age", [1, 2, 3])
def test_no_tick_before_the_first_one_counts(age: int) -> None:
    """The numbers wrap, so the last ones of uint32 are not those before tick 0."""
    assert taken(gate_at(0), command(-age)) is None
    assert taken(gate_at(500, first=500), command(500 - age)) is None


@pytest.mark.parametrize("tick", [UINT32 - 1, UINT32, UINT32 + 1, UINT32 + 2])
def test_the_number_of_a_tick_may_wrap(tick: int) -> None:
    gate = gate_at(tick, first=UINT32 - 5)
    assert taken(gate, command(tick - 2)) == Demand(FAST, FAST, 50)
    assert taken(gate, command(tick + 1)) is None


def test_nothing_counts_before_the_first_tick() -> None:
    assert taken(CommandGate(), command(0), command(0, mrad_s=0)) is None


def test_a_robot_that_remembers_the_plant_before_is_not_obeyed() -> None:
    """Its larger numbers must not keep out the answers to the ticks of the plant that is there."""
    gate = gate_at(0)
    assert taken(gate, command(4000, seq=4000)) is None
    assert taken(gate, command(0, seq=4001)) == Demand(FAST, FAST, TTL_MS)


@pytest.mark.parametrize(
    ("tick", "seq", "obeyed"), [(20, 6, True), (20, 5, False), (20, 4, False), (19, 9, False)]
)
def test_of_two_commands_the_newer_counts(tick: int, seq: int, obeyed: bool) -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=5))
    found = taken(gate, command(tick, seq=seq, mrad_s=1000))
    assert found == (Demand(1000, 1000, TTL_MS) if obeyed else None)


def test_a_robot_that_began_anew_counts_from_0_again() -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=4000))
    gate.begin_tick(21)
    assert taken(gate, command(21, seq=0)) == Demand(FAST, FAST, TTL_MS)


def test_a_command_that_comes_between_two_ticks_ages() -> None:
    gate = gate_at(20)
    gate.receive(command(20))
    gate.begin_tick(21)
    assert gate.take() == Demand(FAST, FAST, 100)


@pytest.mark.parametrize("sense_seq", [20, 19, 17, 16, 0, 21, 4000, UINT32])
@pytest.mark.parametrize("ttl_ms", [0, TTL_MS])
@pytest.mark.parametrize("seq", [0, UINT32])
@pytest.mark.parametrize("epoch", [0, 7, 9])
def test_a_brake_is_obeyed_whatever_its_numbers(
    sense_seq: int, ttl_ms: int, seq: int, epoch: int
) -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=5, epoch=7))
    speed = 0 if ttl_ms else FAST
    found = taken(gate, command(sense_seq, seq=seq, mrad_s=speed, ttl_ms=ttl_ms, epoch=epoch))
    assert found is not None
    assert found.ttl_ms == 0 or found[:2] == (0, 0)
    assert found.ttl_ms <= TTL_MS


def test_a_brake_in_time_runs_the_motors_down_like_any_command() -> None:
    """So that a trajectory is the same to the bit with and without processes."""
    assert taken(gate_at(20), command(19, mrad_s=0)) == Demand(0, 0, 100)


@pytest.mark.parametrize("first", [0, FAST])
def test_a_tick_answered_by_brake_and_move_holds_the_wheels(first: int) -> None:
    gate = gate_at(20)
    second = FAST - first
    assert taken(gate, command(20, seq=1, mrad_s=first), command(20, seq=2, mrad_s=second)) == BRAKE
    for tick in range(21, 20 + HELD_TICKS):
        gate.begin_tick(tick)
        why = gate.receive(command(tick, seq=tick))
        assert why == "moves the wheels while the robot brakes"
        assert gate.take() is None
    gate.begin_tick(20 + HELD_TICKS)
    assert taken(gate, command(20 + HELD_TICKS, seq=99)) == Demand(FAST, FAST, TTL_MS)


def test_a_brake_out_of_time_contradicts_a_move_for_this_tick() -> None:
    assert taken(gate_at(20), command(3, mrad_s=0), command(20, seq=2)) == BRAKE


def test_a_move_for_the_tick_after_a_brake_is_obeyed_at_once() -> None:
    gate = gate_at(20)
    taken(gate, command(20, mrad_s=0))
    gate.begin_tick(21)
    assert taken(gate, command(21, seq=2)) == Demand(FAST, FAST, TTL_MS)


# Two robots of one name.


def test_the_robot_started_last_drives() -> None:
    gate = gate_at(20)
    taken(gate, command(20, seq=900, epoch=5))
    assert taken(gate, command(20, seq=0, mrad_s=1000, epoch=6)) == Demand(1000, 1000, TTL_MS)
    why = gate.receive(command(20, seq=901, epoch=5))
    assert why == "is of a robot that was started before the one that drives"
    assert gate.take() is None


def test_a_braking_newer_robot_keeps_the_older_out() -> None:
    gate = gate_at(20)
    taken(gate, command(20, mrad_s=0, epoch=6))
    assert taken(gate, command(20, seq=9, epoch=5)) is None


@pytest.mark.parametrize(("silent", "drives"), [(SILENT_TICKS - 1, False), (SILENT_TICKS, True)])
def test_an_older_robot_drives_when_the_newer_is_silent(silent: int, drives: bool) -> None:
    gate = gate_at(20)
    taken(gate, command(20, epoch=6))
    for tick in range(21, 21 + silent):
        gate.begin_tick(tick)
    found = taken(gate, command(20 + silent, epoch=5))
    assert found == (Demand(FAST, FAST, TTL_MS) if drives else None)


def test_a_stale_frame_of_a_newer_robot_fences_nothing_off() -> None:
    gate = gate_at(20)
    taken(
        gate, command(16, epoch=UINT32), command(16, mrad_s=0, epoch=UINT32), command(21, epoch=9)
    )
    gate.begin_tick(21)
    assert taken(gate, command(21, epoch=5)) == Demand(FAST, FAST, TTL_MS)


@pytest.mark.parametrize(
    ("sense_seq", "mrad_s", "epoch", "answered"),
    [
        (20, FAST, 5, True),
        (20, 0, 5, True),
        (19, FAST, 5, False),
        (21, FAST, 5, False),
        (20, FAST, 4, False),
    ],
)
def test_what_answers_the_newest_tick(
    sense_seq: int, mrad_s: int, epoch: int, answered: bool
) -> None:
    gate = gate_at(19)
    taken(gate, command(19, seq=0, epoch=5))
    gate.begin_tick(20)
    taken(gate, command(sense_seq, mrad_s=mrad_s, epoch=epoch))
    assert gate.answered == answered


# Any frames at all.

numbers = st.integers(0, UINT32)
speeds = st.one_of(st.integers(-(1 << 31), (1 << 31) - 1), st.sampled_from([0, FAST, -FAST]))
frames = st.tuples(
    st.one_of(st.integers(-6, 6), numbers),  # relative to the newest tick
    st.one_of(st.integers(0, 3), numbers),  # seq
    speeds,
    speeds,
    st.one_of(st.sampled_from([0, 1, 149, 150, 151]), st.integers(0, 65535)),
    st.one_of(st.integers(0, 2), numbers),  # epoch
)
periods = st.lists(st.lists(frames, max_size=3), min_size=1, max_size=6)
firsts = st.sampled_from([0, 7, UINT32 - 4])


def forged(frame: tuple[int, int, int, int, int, int], tick: int) -> WheelCommand:
    ahead, seq, left_mrad_s, right_mrad_s, ttl_ms, epoch = frame
    return WheelCommand(
        time_ns=0,
        seq=seq,
        sense_seq=(tick + ahead) & UINT32,
        epoch=epoch,
        left_mrad_s=left_mrad_s,
        right_mrad_s=right_mrad_s,
        ttl_ms=ttl_ms,
    )


@given(periods, firsts)
def test_no_frames_move_a_wheel_150_ms_after_the_tick_they_answer(
    told: list[list[tuple[int, int, int, int, int, int]]], first: int
) -> None:
    """From then on each wheel slows down until it stands, whatever came and in which order."""
    gate, drive = CommandGate(), Drive(Body(), LEVELS["none"], 0, 0)
    ends_ms, before_m = first * PERIOD_MS, [0.0, 0.0]
    for tick, coming in enumerate([*told, *[[]] * 8], first):
        gate.begin_tick(tick)
        for frame in coming:
            one = forged(frame, tick)
            gate.receive(one)
            answers = [t for t in range(first, tick + 1) if t & UINT32 == one.sense_seq]
            ends_ms = max([ends_ms, *[t * PERIOD_MS + TTL_MS for t in answers]])
        demand = gate.take()
        if demand is not None:
            drive.command(*demand, tick * PERIOD_NS)
        for now_ms in (tick * PERIOD_MS, tick * PERIOD_MS + PERIOD_MS // 2):
            ways_m = drive.roll(now_ms * 1_000_000, PERIOD_MS / 2000, NO_TROUBLE)
            for before, way_m in zip(before_m, ways_m, strict=True):
                assert now_ms < ends_ms or abs(way_m) < abs(before) or way_m == 0.0
            before_m = list(ways_m)
    assert before_m == [0.0, 0.0]


@given(periods, st.lists(st.integers(0, 4), min_size=6, max_size=6), st.integers(0, 2))
def test_no_frames_move_a_robot_that_brakes_at_every_tick(
    told: list[list[tuple[int, int, int, int, int, int]]], places: list[int], epoch: int
) -> None:
    """A robot that is disarmed or stopped stands, whatever else answers its ticks."""
    gate = gate_at(6)
    for tick in range(4, 7):
        taken(gate, command(tick, seq=tick, mrad_s=0, epoch=epoch))
    for (tick, coming), place in zip(enumerate(told, 7), places, strict=False):
        gate.begin_tick(tick)
        brake = command(tick, seq=tick, mrad_s=0, epoch=epoch)
        said = [forged(frame, tick) for frame in coming]
        found = taken(gate, *said[:place], brake, *said[place:])
        assert found is not None
        assert found.ttl_ms == 0 or found[:2] == (0, 0)


@given(st.lists(st.tuples(speeds, speeds, st.booleans()), max_size=30), numbers)
def test_a_robot_that_is_alone_is_always_obeyed(
    told: list[tuple[int, int, bool]], epoch: int
) -> None:
    gate = CommandGate()
    for tick, (left_mrad_s, right_mrad_s, lost) in enumerate(told):
        gate.begin_tick(tick)
        one = forged((0, tick, left_mrad_s, right_mrad_s, TTL_MS, epoch), tick)
        expected = None if lost else Demand(left_mrad_s, right_mrad_s, TTL_MS)
        assert taken(gate, *[] if lost else [one]) == expected
