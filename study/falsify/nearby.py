"""Drives from starts near that of a finding, to count how many fail.

After a change one drive is not enough: a rare failure may occur or not, depending on a millimetre
in the way of the robot. Many drives from similar starts show whether the failure became rarer.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from typing import Final

from plant.corpus.generate import measured
from plant.model.draws import Draws
from plant.model.types import World
from runtime.errors import UserError
from study.falsify.finding import Finding

MAX_SHIFT_M: Final = 0.03
MAX_TURN_RAD: Final = 6.0 * pi / 180.0
"""Most that a start differs from the finding's: along each axis, and in heading."""
MAX_DRAWS: Final = 20
"""Draws of one start; those without room are discarded."""


def near(finding: Finding, count: int) -> Iterator[Finding]:
    """Yield the finding from `count` other starts, with seeds counted up from its own.

    Equal findings yield equal drives.

    Raises UserError if almost no start near it has room.
    """
    for number in range(count):
        random = Draws(f"{finding.world.name}/{number}")
        tries = (_moved(finding.world, random) for _ in range(MAX_DRAWS))
        world = next((one for one in tries if one is not None), None)
        if world is None:
            raise UserError(f"{finding.world.name}: no room near its start; leave out --starts")
        yield replace(finding, world=world, seed=finding.seed + number)


def violates(finding: Finding) -> bool:
    """Run the trial and return whether it violates the finding's property."""
    return finding.letter in finding.replay().violated


def _moved(world: World, random: Draws) -> World | None:
    """Return the world with another start, or None if the robot has no room there."""
    start = world.start
    moved = replace(
        start,
        x_m=start.x_m + random.uniform(-MAX_SHIFT_M, MAX_SHIFT_M),
        y_m=start.y_m + random.uniform(-MAX_SHIFT_M, MAX_SHIFT_M),
        heading_rad=start.heading_rad + random.uniform(-MAX_TURN_RAD, MAX_TURN_RAD),
    )
    tried = measured(replace(world, start=moved))
    return None if tried is None or tried.reachable != world.reachable else tried
