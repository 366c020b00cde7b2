"""Families with simple obstacles: none, discs, boxes, a wall, a corner."""

from math import pi
from typing import Final

from plant.corpus.draft import (
    Draft,
    Frame,
    any_angle,
    spot,
    stage,
    thickness,
    tilt,
)
from plant.model.draws import Draws
from plant.model.types import Circle, Obstacle, Polygon

MAX_STRAY: Final = 3


def open_floor(random: Draws) -> Draft:
    """Draw an empty floor."""
    return stage(random).draft()


def disc(random: Draws) -> Draft:
    """Draw a disc in the way, and up to three more anywhere."""
    place = stage(random)
    middle = place.frame(random.uniform(0.3, 0.7), random.uniform(-0.3, 0.3))
    first = middle.disc(0.0, 0.0, random.uniform(0.1, 0.7))
    return place.draft(first, *(_stray_disc(random, place.size_m) for _ in _few(random)))


def box(random: Draws) -> Draft:
    """Draw a rotated box in the way, and up to three more anywhere."""
    place = stage(random)
    middle = place.frame(random.uniform(0.3, 0.7), random.uniform(-0.4, 0.4), any_angle(random))
    return place.draft(
        box_at(random, middle), *(stray_box(random, place.size_m) for _ in _few(random))
    )


def wall(random: Draws) -> Draft:
    """Draw a wall of 1 to 4 m across the way."""
    place = stage(random)
    middle = place.frame(random.uniform(0.3, 0.7), random.uniform(-0.6, 0.6), tilt(random, 40.0))
    half_m = random.uniform(0.5, 2.0)
    return place.draft(middle.wall(thickness(random), (0.0, -half_m), (0.0, half_m)))


def corner(random: Draws) -> Draft:
    """Draw two arms that meet at 60 to 120 degrees, open towards the start."""
    place = stage(random)
    tip = place.frame(random.uniform(0.4, 0.75), random.uniform(-0.3, 0.3), tilt(random, 30.0))
    half_rad = random.uniform(pi / 6.0, pi / 3.0)
    arms = (
        Frame(tip.origin, tip.angle_rad + pi - half_rad),
        Frame(tip.origin, tip.angle_rad + pi + half_rad),
    )
    ends = [arm.point(random.uniform(0.6, 2.0), 0.0) for arm in arms]
    floor_frame = Frame((0.0, 0.0), 0.0)
    return place.draft(floor_frame.wall(thickness(random), ends[0], tip.origin, ends[1]))


def box_at(random: Draws, frame: Frame, most_m: float = 1.6) -> Polygon:
    """Draw a box in a frame."""
    half_x_m, half_y_m = (random.uniform(0.1, most_m / 2.0) for _ in range(2))
    return frame.box(-half_x_m, -half_y_m, half_x_m, half_y_m)


def stray_box(random: Draws, size_m: tuple[float, float]) -> Obstacle:
    """Draw a box anywhere."""
    return box_at(random, Frame(spot(random, size_m), any_angle(random)), 1.0)


def _stray_disc(random: Draws, size_m: tuple[float, float]) -> Circle:
    x_m, y_m = spot(random, size_m)
    return Circle(x_m=x_m, y_m=y_m, radius_m=round(random.uniform(0.08, 0.4), 3))


def _few(random: Draws) -> range:
    return range(random.randrange(MAX_STRAY + 1))
