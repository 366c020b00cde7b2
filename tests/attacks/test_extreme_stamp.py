"""A frame with a stamp far in the future does not end the robot."""

from protocol.topics import DRIVE, SONAR
from protocol.wire.messages import SonarScan, WheelCommand
from robot.core.parameters import DEFAULTS
from robot.process import CycleMeter, RobotProcess
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import Vehicle
from runtime.clock import Tick, WallClock
from runtime.units import PERIOD_NS
from tests.support.attacks.attacker import Attacker
from tests.support.bus.nets import Net, net
from tests.support.each import each
from tests.support.until import until

EXTREME = (2**62, 2**63 - 1, 2**63, 2**64 - 1)


def scan(time_ns: int, seq: int) -> SonarScan:
    return SonarScan(
        time_ns=time_ns, seq=seq, range_mm=(900,) * 8, ping_age_us=(0,) * 8, valid=255, echo=255
    )


def robot(bus: Net) -> RobotProcess:
    """Return the robot's loop in wall time, which the test runs step by step."""
    vehicle, clock = Vehicle(DEFAULTS, Store(None)), WallClock()
    senses = Senses(bus.robot, lockstep=False, accept=vehicle.lease.allows)
    meter = CycleMeter(clock, period_ns=PERIOD_NS, enforced=False)
    process = RobotProcess(vehicle, bus.robot, clock, senses, meter)
    process.serve()
    return process


@each("stamp_ns", EXTREME)
def test_scan_from_the_far_future_does_not_end_the_robot(stamp_ns: int) -> None:
    """A4: the next stamp exceeded 64 bits, and the process ended without braking."""
    with net() as bus:
        process = robot(bus)
        commands = bus.plant.mailbox(DRIVE)
        until(lambda: process.reports.drive.matched)
        arrived: list[int] = []
        bus.robot.stream(SONAR, lambda *_: arrived.append(1))
        attacker = Attacker(bus.plant.network)
        with attacker:
            until(lambda: seen(attacker, arrived, scan(1_000_000, 1)))
            there = len(arrived)
            attacker.put(SONAR, scan(stamp_ns, 2))
            until(lambda: len(arrived) > there)
            for number in range(4):
                process.cycle(Tick(number, WallClock().now_ns(), 0, 0))
        until(lambda: counted(commands.latest()) >= 3)


def counted(newest: tuple[WheelCommand, int] | None) -> int:
    return -1 if newest is None else newest[0].seq


def seen(attacker: Attacker, arrived: list[int], message: SonarScan) -> bool:
    """Return whether the robot receives the attacker's frames by now."""
    attacker.put(SONAR, message)
    return bool(arrived)
