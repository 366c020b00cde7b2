"""Who commands the robot, as its lease says."""

from typing import NamedTuple


class Lease(NamedTuple):
    """`ours`: this station holds it; `lapses_s` from now unless its holder beats."""

    held: bool = False
    ours: bool = False
    holder: str = ""
    name: str = ""
    lapses_s: float = 0.0

    @property
    def others(self) -> bool:
        return self.held and not self.ours

    @property
    def words(self) -> str:
        """Whom it belongs to."""
        if not self.held:
            return "free"
        return "ours" if self.ours else (self.name or self.holder[:8])
