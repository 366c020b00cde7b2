"""The world as the plant describes it: simulation truth, for the map only."""

from typing import NamedTuple


class WorldFacts(NamedTuple):
    """Metres and radians; outlines are closed when they are polygons or walls with a thickness."""

    name: str
    size_m: tuple[float, float]
    outlines: tuple[tuple[tuple[float, float], ...], ...]
    circles: tuple[tuple[float, float, float], ...]
    start: tuple[float, float, float] | None
    goal: tuple[float, float, float | None] | None
    robot_radius_m: float
