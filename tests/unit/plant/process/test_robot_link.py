"""The plant's link to a robot: the order of its messages, and the commands it executes."""

from typing import cast

from plant.model.configuration import LEVELS, Fault
from plant.process.robot_link import RobotLink
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.bus import Bus, Presence
from protocol.topics import CLOCK, DRIVE, SONAR, WHEELS, Role
from protocol.wire.message import Message
from protocol.wire.messages import GroundTruth, SonarScan, SystemTime, WheelCommand, WheelTicks
from runtime.clock import ManualClock
from tests.support.each import each
from tests.support.played_bus import PlayedBus

PERIOD_S = 0.05
FAST = 9000


class Bench:
    """A plant at tick 20, and the network on which a test sends commands."""

    def __init__(self) -> None:
        self._bus = PlayedBus(ManualClock())
        self.plant = Plant(load("open"), 0, LEVELS["none"])
        bus = cast(Bus, self._bus)
        self.link = RobotLink(bus, "r1", 0, lambda _: None, lockstep=True)
        for _ in range(20):
            self.link.publish(self.plant)
            self.plant.advance()

    def tick(self, *commands: tuple[int, int, int]) -> float:
        """Run a period with these commands (number, answered tick, speed); return the new speed."""
        self.link.publish(self.plant)
        for seq, sense_seq, mrad_s in commands:
            self._bus.say(
                DRIVE,
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
        self.link = RobotLink(cast(Bus, self._bus), "r2", 1, lambda _: None, lockstep=lockstep)
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
