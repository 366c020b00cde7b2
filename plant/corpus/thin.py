"""Walls of 2 to 10 mm: the family's worlds are those of four others, with thinner walls.

A sonar whose echoes are lost at oblique incidence does not see such a wall along its length, and
rarely its end.
"""

from dataclasses import replace
from typing import Final

from plant.corpus import buildings, traps
from plant.corpus.draft import Draft, Family
from plant.model.draws import Draws
from plant.model.types import Polyline

THICKNESSES_M: Final = (0.002, 0.005, 0.010)
KINDS: Final[tuple[Family, ...]] = (
    buildings.maze,
    buildings.office,
    traps.u_trap,
    traps.spiral,
)


def thin(random: Draws) -> Draft | None:
    """Draw a maze, an office, a U-trap or a spiral with walls of 2, 5 or 10 mm."""
    thickness_m, kind = random.choice(THICKNESSES_M), random.choice(KINDS)
    draft = kind(random)
    return None if draft is None else with_walls(draft, thickness_m)


def with_walls(draft: Draft, thickness_m: float) -> Draft:
    """Return a draft whose walls all have this thickness; doors become wider by the difference."""
    obstacles = tuple(
        replace(one, thickness_m=thickness_m) if isinstance(one, Polyline) else one
        for one in draft.obstacles
    )
    return draft._replace(obstacles=obstacles)
