"""A fleet in one plant: robots cross a warehouse at the same time, and all arrive."""

from dataclasses import replace

from plant.corpus import generate
from plant.model.configuration import body_of, noise_of
from plant.placement import goals, starts
from plant.sim.simulation import Plant
from protocol.outcome import rounded_heading_rad, wire_goal
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.world import World, WorldPolygon
from robot.core import states
from robot.core.modes import goal_is_active
from robot.core.parameters import DEFAULTS
from robot.core.values import Pose
from robot.hosting import InProcessCore
from runtime.units import NS_PER_S
from study.trial.core_loop import CoreLoop

FILES = 3
ROBOTS = 15
LIMIT_NS = 200 * NS_PER_S
FOREVER_NS = 10**18


def strip(world: World, wide_m: float) -> World:
    """Return the middle of a world with the shelves that are whole in it."""
    low_m = (world.size_m[1] - wide_m) / 2.0
    shelves = [
        tuple((x_m, y_m - low_m) for x_m, y_m in shelf.points_m)
        for shelf in world.obstacles
        if isinstance(shelf, WorldPolygon)
    ]
    return replace(
        world,
        size_m=(world.size_m[0], wide_m),
        start=replace(world.start, y_m=wide_m / 2.0),
        goal=replace(world.goal, y_m=wide_m / 2.0),
        obstacles=tuple(
            WorldPolygon(points_m)
            for points_m in shelves
            if all(0.3 < y_m < wide_m - 0.3 for _, y_m in points_m)
        ),
    )


def test_robots_in_ranks_reach_their_goals_behind_each_other() -> None:
    whole = generate("warehouse", 0, 1)
    pitch_m = 2.0 * whole.radius_m + whole.start.gap_m
    world = strip(whole, FILES * pitch_m + 0.6)
    places = starts(world, body_of(world), ROBOTS)
    assert len({x_m for x_m, _, _ in places}) == ROBOTS // FILES
    plant = Plant(world, 0, noise_of(world), robots=ROBOTS)
    loops = [
        CoreLoop(InProcessCore(DEFAULTS, Pose(x_m, y_m, rounded_heading_rad(turn_rad))))
        for x_m, y_m, turn_rad in places
    ]
    outputs = [one.step(plant.now_ns, *plant.senses(number)) for number, one in enumerate(loops)]
    ends = goals(world, body_of(world), places, (world.goal.x_m, world.goal.y_m))
    for one, end in zip(loops, ends, strict=True):
        assert one.go(wire_goal(end.x_m, end.y_m, None, 0.05, 0.05)) == 0
    while any(goal_is_active(one.state.machine) for one in loops) and plant.now_ns < LIMIT_NS:
        for number, (left, right, *_) in enumerate(outputs):
            plant.command(number, left, right, MAX_WHEEL_TTL_MS)
        plant.advance()
        outputs = [
            one.step(plant.now_ns, *plant.senses(number)) for number, one in enumerate(loops)
        ]
    assert [one.state.machine.goal_state for one in loops] == [states.REACHED] * ROBOTS
    assert sum(plant.score(FOREVER_NS, number).contacts for number in range(ROBOTS)) == 0
