"""Scenes of one to three walls, wedges, symmetric traps, and doors hardly wider than the robot."""

from typing import Final

from plant.corpus.adversarial.axes import (
    EXCESS,
    HEADING,
    ROOM,
    THICKNESS,
    TURN,
    Adversary,
    Axis,
    Values,
    fitted,
    frame_of,
    whole,
)
from plant.corpus.draft import Draft, Frame
from plant.model.types import Obstacle, Point

MAX_WALLS: Final = 3
LONG_M: Final = 6.0

COMMON: Final = (THICKNESS, TURN, HEADING, ROOM)
APART: Final = Axis("apart_m", 1.0, 5.0)


def three_walls(values: Values, radius_m: float) -> Draft | None:
    """Make one to three straight walls anywhere between start and goal."""
    frame, apart_m = frame_of(values), values["apart_m"]
    walls: list[Obstacle] = []
    for wall in range(whole(values, "count")):
        along_m = values[f"along_{wall}"] * apart_m
        left_m, half_m = values[f"left_{wall}_m"], values[f"long_{wall}_m"] / 2.0
        tilted = Frame(frame.point(along_m, left_m), frame.angle_rad + values[f"tilt_{wall}_rad"])
        walls.append(tilted.wall(values["thickness_m"], (-half_m, 0.0), (half_m, 0.0)))
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def wedge(values: Values, radius_m: float) -> Draft | None:
    """Make two walls that meet, or nearly so, at an angle open towards the robot or the goal."""
    frame, apart_m = frame_of(values), values["apart_m"]
    tip = values["tip"] * apart_m, values["tip_left_m"]
    back = -1.0 if whole(values, "towards") else 1.0
    half_m, long_m = values["half_m"], values["long_m"]
    gap_m = (2.0 * radius_m + values["excess_m"]) / 2.0 if whole(values, "open") == 0 else 0.0
    left = [
        (tip[0], tip[1] + gap_m),
        (tip[0] + back * long_m, tip[1] + gap_m + half_m),
    ]
    right = [
        (tip[0], tip[1] - gap_m),
        (tip[0] + back * long_m * values["lopsided"], tip[1] - gap_m - half_m),
    ]
    walls = [frame.wall(values["thickness_m"], *line) for line in (left, right)]
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def symmetric_trap(values: Values, radius_m: float) -> Draft | None:
    """Make a U of equal or unequal arms around the robot or in its way, with lips at its mouth."""
    frame, apart_m = frame_of(values), values["apart_m"]
    bottom_m, half_m = values["bottom"] * apart_m, 2.0 * radius_m + values["half_m"]
    left_m, right_m = values["left_m"], values["right_m"]
    lip_m = values["lip"] * max(0.0, half_m - radius_m - values["excess_m"] / 2.0)
    line: list[Point] = [
        (bottom_m - left_m, half_m - lip_m),
        (bottom_m - left_m, half_m),
        (bottom_m, half_m),
        (bottom_m, -half_m),
        (bottom_m - right_m, -half_m),
        (bottom_m - right_m, lip_m - half_m),
    ]
    if lip_m < 0.01:
        line = line[1:-1]
    walls: list[Obstacle] = [frame.wall(values["thickness_m"], *line)]
    if whole(values, "post"):
        walls.append(frame.disc(bottom_m + values["post_m"], values["post_left_m"], 0.1))
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def tight_door(values: Values, radius_m: float) -> Draft | None:
    """Make one or two walls across the way with a door 2 to 5 cm wider than the robot."""
    frame, apart_m, thick_m = frame_of(values), values["apart_m"], values["thickness_m"]
    half_m = radius_m + values["tight_m"] / 2.0 + thick_m / 2.0
    walls: list[Obstacle] = []
    for door in range(whole(values, "doors")):
        along_m = (0.3, 0.7)[door] * apart_m if whole(values, "doors") == 2 else 0.5 * apart_m
        at = Frame(
            frame.point(along_m, values[f"left_{door}_m"]), frame.angle_rad + values["tilt_rad"]
        )
        for hand in (-1, 1):
            line = [(0.0, hand * half_m), (0.0, hand * (half_m + values["long_m"]))]
            if whole(values, "porch"):
                line.insert(0, (-hand * 0.0 - values["porch_m"], hand * half_m))
            walls.append(at.wall(thick_m, *line))
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def _wall_axes() -> tuple[Axis, ...]:
    made: list[Axis] = []
    for wall in range(MAX_WALLS):
        made += [
            Axis(f"along_{wall}", -0.2, 1.2),
            Axis(f"left_{wall}_m", -1.0, 1.0),
            Axis(f"long_{wall}_m", 0.2, 4.0),
            Axis(f"tilt_{wall}_rad", -1.6, 1.6),
        ]
    return tuple(made)


THREE_WALLS: Final = Adversary(
    (Axis("count", 1, MAX_WALLS, whole=True), APART, *_wall_axes(), *COMMON), three_walls
)
WEDGE: Final = Adversary(
    (
        *(APART, Axis("tip", 0.1, 1.1), Axis("tip_left_m", -0.6, 0.6), Axis("half_m", 0.1, 1.5)),
        *(Axis("long_m", 0.3, 3.0), Axis("lopsided", 0.1, 1.5), Axis("open", 0, 1, whole=True)),
        *(Axis("towards", 0, 2, whole=True), EXCESS, *COMMON),
    ),
    wedge,
)
SYMMETRIC_TRAP: Final = Adversary(
    (
        *(APART, Axis("bottom", 0.1, 1.1), Axis("half_m", 0.0, 1.2), Axis("lip", 0.0, 1.0)),
        *(Axis("left_m", 0.2, 3.0), Axis("right_m", 0.2, 3.0), Axis("post", 0, 2, whole=True)),
        *(Axis("post_m", -1.0, 1.0), Axis("post_left_m", -1.0, 1.0), EXCESS, *COMMON),
    ),
    symmetric_trap,
)
TIGHT_DOOR: Final = Adversary(
    (
        *(APART, Axis("doors", 1, 2, whole=True), Axis("tight_m", 0.02, 0.05)),
        *(Axis("left_0_m", -1.5, 1.5), Axis("left_1_m", -1.5, 1.5), Axis("tilt_rad", -0.8, 0.8)),
        *(Axis("long_m", 0.5, LONG_M), Axis("porch", 0, 2, whole=True)),
        *(Axis("porch_m", 0.05, 0.8), *COMMON),
    ),
    tight_door,
)
