"""The link to a robot: order of messages, admitted wheel commands, and rejections."""

from typing import cast

from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, Fault
from plant.process import RejectLog
from plant.robot_link import HELD_TICKS, SILENT_TICKS, CommandGate, PlantLink, WheelOutput
from plant.sim.active_faults import NO_TROUBLE
from plant.sim.drive import DifferentialDrive
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus, Presence
from protocol.topics import CLOCK, SONAR, WHEELS, Role
from protocol.topics import DRIVE as TOPICS_DRIVE
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.message import Message
from protocol.wire.messages import GroundTruth, SonarScan, SystemTime, WheelCommand, WheelTicks
from runtime.clock import ManualClock
from runtime.units import PERIOD_MS, PERIOD_NS, UINT32
from tests.support.each import each
from tests.support.plant import FAST, command, gate_at, taken
from tests.support.played_bus import PlayedBus

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
        (20, FAST, 4, True),  # refused: of two robots, it is the older
        (19, FAST, 4, False),
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


PERIOD_S = 0.05


class Bench:
    """A plant at tick 20, and the network on which a test sends commands."""

    def __init__(self) -> None:
        self._bus = PlayedBus(ManualClock())
        self.plant = Plant(load("open"), 0, LEVELS["none"])
        bus = cast(Bus, self._bus)
        self.link = PlantLink(bus, "r1", 0, lambda _: None, lockstep=True)
        for _ in range(20):
            self.link.publish(self.plant)
            self.plant.advance()

    def tick(self, *commands: tuple[int, int, int]) -> float:
        """Run a period with these commands (number, answered tick, speed); return the new speed."""
        self.link.publish(self.plant)
        for seq, sense_seq, mrad_s in commands:
            self._bus.say(
                TOPICS_DRIVE,
                WheelCommand(
                    time_ns=0,
                    seq=seq,
                    sense_seq=sense_seq,
                    left_mrad_s=mrad_s,
                    right_mrad_s=mrad_s,
                    ttl_ms=150,
                ),
            )
        self.link.apply_command(self.plant)
        self.plant.advance()
        return self.plant.truth().speed_m_s

    def ticks_driven(self, *commands: tuple[int, int, int]) -> int:
        """Return for how many periods the wheels are driven by these commands alone."""
        speeds = [self.tick(*commands)] + [self.tick() for _ in range(9)]
        fastest = max(speeds)
        return speeds.index(fastest) + 1 if fastest > 0.0 else 0


@each(("age", "driven"), [(0, 3), (1, 2), (2, 1), (3, 0), (20, 0)])
def test_command_age_counts_from_the_senses_it_answers(age: int, driven: int) -> None:
    assert Bench().ticks_driven((1, 20 - age, FAST)) == driven


def test_late_duplicate_does_not_extend_a_command() -> None:
    bench = Bench()
    command = (1, 20, FAST)
    speeds = [bench.tick(command), bench.tick(command), bench.tick(command)]
    assert speeds == sorted(speeds)
    assert bench.tick(command) < speeds[-1], "its 150 ms are over"


def test_overtaken_command_is_not_obeyed() -> None:
    bench = Bench()
    bench.tick((1, 20, FAST))
    bench.tick((3, 21, 0))
    slower_m_s = bench.tick()
    assert bench.tick((2, 21, FAST)) < slower_m_s


def test_restarted_robot_is_obeyed() -> None:
    bench = Bench()
    bench.tick((4000, 20, 0))
    assert bench.tick((0, 21, FAST)) > 0.0


class Listener:
    """The second of two robots of a plant, with everything published for it, in order."""

    def __init__(self, *, lockstep: bool, at_ns: int = 0) -> None:
        self._bus = PlayedBus(ManualClock())
        self.plant = Plant(load("open"), 0, LEVELS["none"], robots=2, at_ns=at_ns)
        self.link = PlantLink(cast(Bus, self._bus), "r2", 1, lambda _: None, lockstep=lockstep)
        self.said: list[Message] = []
        for publisher in self._bus.publishers.values():
            publisher.heard = self.said.append

    def heard(self) -> list[Message]:
        """Return what is published for this tick."""
        self.said.clear()
        self.link.publish(self.plant)
        return list(self.said)

    def topics(self) -> list[str]:
        """Return the paths of the topics that the robot must subscribe to."""
        paths = {id(one): path for (_, path), one in self._bus.publishers.items()}
        return [paths[id(one)] for one in self.link.publishers]


def test_senses_leave_before_the_clock_and_the_truth() -> None:
    listener = Listener(lockstep=True)
    heard = listener.heard()
    assert [type(one) for one in heard] == [WheelTicks, SonarScan, SystemTime, GroundTruth]
    assert heard[:2] == list(listener.plant.senses(1)), "of this robot, not of the first"
    assert heard[3] == listener.plant.truth(1) != listener.plant.truth(0)


def test_no_clock_is_published_in_wall_time() -> None:
    heard = Listener(lockstep=False).heard()
    assert [type(one) for one in heard] == [WheelTicks, SonarScan, GroundTruth]


@each(("at_ms", "boot_ms"), [(0, 0), (20 * 50, 1000), (2**32 + 4, 4)])
def test_clock_carries_simulated_time(at_ms: int, boot_ms: int) -> None:
    """Wrap the milliseconds of a plant after 2^32 ms."""
    heard = Listener(lockstep=True, at_ns=at_ms * 1_000_000).heard()
    assert heard[2] == SystemTime(time_unix_usec=at_ms * 1000, time_boot_ms=boot_ms)


@each(
    ("kind", "left"),
    [("ticks_stopped", [SonarScan, GroundTruth]), ("scan_stopped", [WheelTicks, GroundTruth])],
)
def test_senses_withheld_by_a_fault_are_not_published(kind: str, left: list[type[Message]]) -> None:
    listener = Listener(lockstep=False)
    listener.plant.inject(Fault(kind=kind, robot=1))
    listener.plant.advance()
    assert [type(one) for one in listener.heard()] == left


@each(("lockstep", "clock"), [(True, [CLOCK.path]), (False, [])])
def test_robot_must_subscribe_to_senses_and_clock(lockstep: bool, clock: list[str]) -> None:
    assert Listener(lockstep=lockstep).topics() == [SONAR.path, WHEELS.path, *clock]


def test_link_reports_its_robot_and_whether_it_has_answered() -> None:
    bench = Bench()
    assert bench.link.robot == "r1"
    bench.tick((1, 19, FAST))
    assert not bench.link.answered, "it answered the tick before"
    bench.tick((2, 21, FAST))
    assert bench.link.answered


@each("mrad_s", [FAST, 0])
def test_robot_that_may_not_drive_has_answered(mrad_s: int) -> None:
    """In lockstep the time in which it may not drive passes only by its answers."""
    gate = gate_at(20)
    gate.receive(command(20, epoch=UINT32))
    for tick in range(21, 21 + SILENT_TICKS):
        gate.begin_tick(tick)
        gate.receive(command(tick - 1, mrad_s=mrad_s))
        assert not gate.answered, "it answered the tick before"
        gate.receive(command(tick, mrad_s=mrad_s))
        assert gate.answered
    gate.begin_tick(21 + SILENT_TICKS)
    assert taken(gate, command(21 + SILENT_TICKS)) == DRIVE


def presence_of(robot: str, role: Role = Role.ROBOT, zid: str = "1") -> Presence:
    return Presence(robot, role.value, zid)


def test_robot_is_expected_until_its_last_token_disappears() -> None:
    link = Bench().link
    assert link.expected, "it may run without a token"
    for token, appeared, expected in (
        (presence_of("r1"), True, True),
        (presence_of("r1", zid="2"), True, True),
        (presence_of("r2"), False, True),
        (presence_of("r1", Role.GROUND), False, True),
        (presence_of("r1"), False, True),
        (presence_of("r1", zid="2"), False, False),
        (presence_of("r1", zid="3"), True, True),
    ):
        link.note_presence(token, appeared)
        assert link.expected is expected, token


def test_silent_robot_is_expected_again_when_it_answers() -> None:
    bench = Bench()
    bench.tick((1, 20, FAST))
    bench.link.expect_no_more()
    for _ in (21, 22):
        bench.tick()
        assert not bench.link.expected
    bench.tick((2, 23, FAST))
    assert bench.link.expected


def test_first_reject_is_logged_at_once_and_a_flood_briefly() -> None:
    counts: dict[str, int] = {}
    lines: list[str] = []
    log = RejectLog(lambda: counts, lines.append)
    log.look()
    assert lines == []
    for count in range(1, 1001):
        counts["drive/wheels"] = count
        log.look()
    assert lines[0].startswith("plant: 1 rejected on drive/wheels")
    assert 5 < len(lines) < 12


def test_each_path_is_logged_separately() -> None:
    lines: list[str] = []
    RejectLog(lambda: {"drive/wheels": 3, "sim/run": 1, "sim/world": 0}, lines.append).look()
    assert [line.split(": ")[1] for line in lines] == [
        "3 rejected on drive/wheels",
        "1 rejected on sim/run",
    ]
