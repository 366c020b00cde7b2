"""No sequence of frames moves a wheel beyond the limits of the motor driver."""

from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body
from plant.process.robot_link import CommandGate, WheelOutput
from plant.sim.active_faults import NO_TROUBLE
from plant.sim.drive import DifferentialDrive
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from runtime.units import PERIOD_MS, PERIOD_NS, UINT32
from tests.support.plant.commands import FAST, command, gate_at, taken

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
def test_no_frame_moves_a_wheel_150_ms_after_its_tick(
    told: list[list[tuple[int, int, int, int, int, int]]], first: int
) -> None:
    """Slow each wheel down to zero after that time, for any frames in any order."""
    gate, drive = CommandGate(), DifferentialDrive(Body(), LEVELS["none"], 0, 0)
    ends_ms, before_m = first * PERIOD_MS, [0.0, 0.0]
    for tick, coming in enumerate([*told, *[[]] * 8], first):
        gate.begin_tick(tick)
        for frame in coming:
            one = forged(frame, tick)
            gate.receive(one)
            answers = [t for t in range(first, tick + 1) if t & UINT32 == one.sense_seq]
            ends_ms = max([ends_ms, *[t * PERIOD_MS + MAX_WHEEL_TTL_MS for t in answers]])
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
def test_no_frame_moves_a_robot_that_brakes_at_every_tick(
    told: list[list[tuple[int, int, int, int, int, int]]], places: list[int], epoch: int
) -> None:
    """Keep a disarmed or stopped robot at rest, for any other frames."""
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
def test_single_robot_is_always_obeyed(told: list[tuple[int, int, bool]], epoch: int) -> None:
    gate = CommandGate()
    for tick, (left_mrad_s, right_mrad_s, lost) in enumerate(told):
        gate.begin_tick(tick)
        one = forged((0, tick, left_mrad_s, right_mrad_s, MAX_WHEEL_TTL_MS, epoch), tick)
        expected = None if lost else WheelOutput(left_mrad_s, right_mrad_s, MAX_WHEEL_TTL_MS)
        assert taken(gate, *[] if lost else [one]) == expected
