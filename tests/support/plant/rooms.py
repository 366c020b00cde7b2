"""Rooms to drive in, wheel commands, and a gate that has been sent ticks."""

from plant.model.configuration import LEVELS
from plant.process.robot_link import CommandGate, WheelOutput
from plant.sim.simulation import Plant
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from protocol.world import GoalPose, Obstacle, Settings, Start, World
from runtime.units import UINT32

NONE = LEVELS["none"]
FOREVER_NS = 10**18


def room(
    *obstacles: Obstacle,
    start: tuple[float, float, float] = (1.0, 2.0, 0.0),
    size_m: tuple[float, float] = (4.0, 4.0),
    walls: bool = True,
    robot: Settings | None = None,
) -> World:
    return World(
        name="room",
        size_m=size_m,
        start=Start(x_m=start[0], y_m=start[1], heading_rad=start[2]),
        goal=GoalPose(x_m=3.0, y_m=3.0),
        walls=walls,
        obstacles=obstacles,
        robot=robot or {},
    )


def mrad_s(rim_m_s: float) -> int:
    """Return the command for a speed of the wheel's rim."""
    return round(rim_m_s / 0.033 * 1000.0)


def drive(plant: Plant, left_m_s: float, right_m_s: float, ticks: int, robot: int = 0) -> None:
    for _ in range(ticks):
        plant.command(robot, mrad_s(left_m_s), mrad_s(right_m_s), 150)
        plant.advance()


def ranges_m(plant: Plant, robot: int = 0) -> list[float | None]:
    """Return the ranges of the sonars from right to left; None without an echo."""
    scan = plant.senses(robot)[1]
    assert scan is not None
    return [scan.range_mm[sonar] / 1000.0 if scan.echo >> sonar & 1 else None for sonar in range(8)]


def counters(plant: Plant, robot: int = 0) -> tuple[int, int]:
    ticks = plant.senses(robot)[0]
    assert ticks is not None
    return ticks.left, ticks.right


def bumper(plant: Plant, robot: int = 0) -> int:
    ticks = plant.senses(robot)[0]
    assert ticks is not None
    return ticks.bumper


FAST = 9000


def command(
    sense_seq: int,
    *,
    seq: int = 1,
    mrad_s: int = FAST,
    ttl_ms: int = MAX_WHEEL_TTL_MS,
    epoch: int = 0,
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
    """Return a plant that has sent all ticks from the first one."""
    gate = CommandGate()
    for sent in range(first, tick + 1):
        gate.begin_tick(sent)
    return gate


def taken(gate: CommandGate, *commands: WheelCommand) -> WheelOutput | None:
    for one in commands:
        gate.receive(one)
    return gate.take()
