"""Unreachable goals: boxed in, walled off in a maze, or in a room without a door."""

from math import pi

from plant.corpus.buildings import Plan, apart, maze_draft, maze_plan, office_draft, office_plan
from plant.corpus.draft import Draft, DraftFloor, Frame, any_angle, stage, thickness
from plant.model.draws import Draws
from plant.model.types import Obstacle, Point


def unreachable(random: Draws) -> Draft:
    """Draw a world whose goal is unreachable."""
    kinds = (_goal_boxed_in, _start_boxed_in, _goal_cell_walled_off, _room_without_door)
    return random.choice(kinds)(random)._replace(reachable=False)


def _goal_boxed_in(random: Draws) -> Draft:
    place = _stage(random)
    return place.draft(_ring(random, place.goal))


def _start_boxed_in(random: Draws) -> Draft:
    place = _stage(random)
    return place.draft(_ring(random, place.start))


def _stage(random: Draws) -> DraftFloor:
    return stage(random, apart_m=2.5)


def _ring(random: Draws, centre: Point) -> Obstacle:
    """Return a closed wall of four to six sides around a place, 0.8 to 1.8 m across."""
    frame, sides = Frame(centre, any_angle(random)), random.randint(4, 6)
    if sides == 4:
        x_m, y_m = random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)
        corners = [(x_m, y_m), (-x_m, y_m), (-x_m, -y_m), (x_m, -y_m)]
        return frame.wall(thickness(random), *corners, corners[0])
    far_m = random.uniform(0.5, 0.9)
    turns = [Frame(centre, frame.angle_rad + 2.0 * pi * turn / sides) for turn in range(sides)]
    corners = [turn.point(far_m, 0.0) for turn in turns]
    return Frame((0.0, 0.0), 0.0).wall(thickness(random), *corners, corners[0])


def _goal_cell_walled_off(random: Draws) -> Draft:
    plan = maze_plan(random, random.randint(4, 6), random.randint(4, 6))
    start, goal = apart(random, plan)
    return maze_draft(random, _without_doors(plan, goal), start, goal)


def _room_without_door(random: Draws) -> Draft:
    plan = office_plan(random)
    start, goal = apart(random, plan)
    return office_draft(random, _without_doors(plan, goal), start, goal)


def _without_doors(plan: Plan, cell: tuple[int, int]) -> Plan:
    return plan._replace(doors={door for door in plan.doors if cell not in door})
