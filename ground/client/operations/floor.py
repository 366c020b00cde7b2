"""The floor of the plant's world, outside of which no goal makes sense."""

from typing import NamedTuple

from ground.client.link import Link
from protocol.topics import WORLD
from runtime.cli.terminal import printable
from runtime.errors import RemoteError, UserError
from runtime.json_reader import value_in


class Floor(NamedTuple):
    """The name of a world and the size of its floor, from 0 0."""

    world: str
    width_m: float
    height_m: float

    def refuse_outside(self, what: str, x_m: float, y_m: float, fix: str = "") -> None:
        """Raise UserError for a place that is not on the floor; `what` names it."""
        if 0.0 <= x_m <= self.width_m and 0.0 <= y_m <= self.height_m:
            return
        size = f"{self.width_m:g} x {self.height_m:g} m"
        raise UserError(f"{what} lies outside the world {self.world} ({size}){fix}")


def floor_in(text: str | bytes) -> Floor | None:
    """Return the floor in the plant's description of its world; None if it is malformed."""
    try:
        facts = value_in(text if isinstance(text, str) else text.decode())
        width_m, height_m = map(float, facts["size_m"])
        return Floor(printable(str(facts["name"])), width_m, height_m)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def floor_of(link: Link) -> Floor | None:
    """Ask the plant for its world; None without a simulation, or without the right to ask."""
    try:
        answer = link.bus.ask(WORLD, robot=link.robot)
    except RemoteError:
        return None
    return floor_in(answer) if isinstance(answer, bytes) else None
