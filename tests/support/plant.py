"""Rooms, wheel commands, and files of worlds and foreign formats, valid and made invalid."""

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from plant.model.configuration import LEVELS
from plant.model.errors import WorldError, WorldProblem
from plant.robot_link import CommandGate, WheelOutput
from plant.sim.simulation import Plant
from plant.world.file import loads
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from protocol.world import GoalPose, Obstacle, Settings, Start, World
from runtime.units import UINT32

NONE = LEVELS["none"]
FOREVER_NS = 10**18
POSE = ("x_m", "y_m", "heading_rad")


def plain_world(
    name: str,
    size_m: tuple[float, float],
    start: tuple[float, ...],
    goal: tuple[float, ...],
    *obstacles: Obstacle,
    **more: Any,
) -> World:
    """Return a world; start and goal are x, y and, if given, the heading."""
    begin = Start(**dict(zip(POSE, start, strict=False)))
    end = GoalPose(**dict(zip(POSE, goal, strict=False)))
    return World(name=name, size_m=size_m, start=begin, goal=end, obstacles=obstacles, **more)


def room(
    *obstacles: Obstacle,
    start: tuple[float, float, float] = (1.0, 2.0, 0.0),
    size_m: tuple[float, float] = (4.0, 4.0),
    walls: bool = True,
    robot: Settings | None = None,
) -> World:
    return plain_world(
        "room", size_m, start, (3.0, 3.0), *obstacles, walls=walls, robot=robot or {}
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


GOOD = """\
name = "test"
size_m = [6.0, 4.0]
start = { x_m = 0.6, y_m = 2.0, heading_deg = 90.0 }
goal = { x_m = 5.4, y_m = 2.0, heading_deg = -90.0 }

[[obstacle]]
polygon_m = [[2.0, 1.0], [3.0, 1.0], [3.0, 1.5], [2.0, 1.5]]

[[obstacle]]
circle_m = { x = 4.0, y = 3.0, radius = 0.25 }

[[obstacle]]
wall_m = [[1.0, 3.0], [2.0, 3.0], [2.5, 2.5]]
thickness_m = 0.05

[[obstacle]]
circle_m = { x = 3.5, y = 0.5, radius = 0.15 }
path_m = [[3.5, 0.5], [3.5, 3.5]]
speed_m_s = 0.1
"""
POLYGON_LINE = 7
ROBOT_AT = "{ x_m = %s, y_m = %s, heading_deg = 0.0 }"


def with_line(number: int, line: str, text: str = GOOD) -> str:
    """Return the text with one line replaced, counted from 1; an empty line keeps the numbering."""
    lines = text.split("\n")
    lines[number - 1] = line
    return "\n".join(lines)


def polygon(points: str) -> str:
    return with_line(POLYGON_LINE, f"polygon_m = {points}")


def start(table: str) -> str:
    return with_line(3, f"start = {table}")


def goal(table: str) -> str:
    return with_line(4, f"goal = {table}")


def more(text: str) -> str:
    """Return the valid world with lines added from line 20 on."""
    return GOOD + text


TOLD = re.compile(r"(\d+) (\S+): (.*) -> (.*)", re.DOTALL)


class Bad(NamedTuple):
    """An invalid file, and what its message tells: "LINE KEY: part of reason -> part of fix"."""

    story: str
    text: str
    told: str


def refusal(text: str) -> WorldError:
    with pytest.raises(WorldError) as caught:
        loads(text, "bad.toml")
    return caught.value


def assert_told(bad: Bad, alone: bool) -> None:
    """Require file, line, key, reason and fix in the error; no other problem if `alone`."""
    error = refusal(bad.text)
    lines = str(error).split("\n")
    at, told_key, told_reason, told_fix = TOLD.fullmatch(bad.told).groups()  # type: ignore[union-attr]
    about_key = [line for line in lines if f": {told_key}: " in line] or lines
    place, _, rest = about_key[0].partition(f": {told_key}: ")
    reason, _, fix = rest.partition("; fix: ")
    assert place == f"bad.toml:{at}"
    assert told_reason in reason
    assert told_fix in fix
    assert not alone or len(error.problems) == 1, str(error)


MAP = """\
type octile
height 5
width 8
map
........
.@@@@T..
.O....W.
.@.GS...
........
"""
SCEN = (
    "version 1\n0\tmaps/hand.map\t8\t5\t0\t0\t7\t4\t9.0\n1\tmaps/hand.map\t8\t5\t3\t3\t0\t4\t4.2\n"
)
YAML = """\
image: hand.pgm
resolution: 0.5   # metres per pixel
origin: [-1.0, -2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
# Ten by six: a black frame, a black block, and unknown grey in a corner.
ROWS = (
    (0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
    (0, 254, 254, 254, 254, 254, 254, 254, 205, 0),
    (0, 254, 254, 254, 254, 254, 254, 254, 254, 0),
    (0, 254, 254, 254, 0, 0, 254, 254, 254, 0),
    (0, 254, 254, 254, 254, 254, 254, 254, 254, 0),
    (0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
)
P5 = b"P5\n# made by hand\n10 6\n255\n" + bytes(value for row in ROWS for value in row)
P2 = ("P2\n10 6\n255\n" + "\n".join(" ".join(map(str, row)) for row in ROWS) + "\n").encode()


def refused(make: Callable[[], object]) -> WorldProblem:
    """Return the only problem that is reported, with file, reason and fix."""
    with pytest.raises(WorldError) as caught:
        make()
    (problem,) = caught.value.problems
    assert problem.file
    assert problem.key
    assert problem.reason
    assert problem.fix
    return problem
