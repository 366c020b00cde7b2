"""Edit a mission waypoint by waypoint before it is saved or sent."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeAlias

from ground.missions import files
from ground.missions.files import toml_text
from ground.missions.mission import Mission, Waypoint
from runtime.config import parse
from runtime.errors import ConfigError, UserError

EMPTY: Final = Mission(waypoints=())
NOTHING: Final = "the draft is empty: wp add X Y [DEG]"


@dataclass(frozen=True, slots=True)
class AddWaypoint:
    """Append a waypoint to the draft."""

    waypoint: Waypoint


@dataclass(frozen=True, slots=True)
class RemoveWaypoint:
    """Remove a waypoint from the draft; `item` counts from 1."""

    item: int


@dataclass(frozen=True, slots=True)
class ListDraft:
    """List the draft."""


@dataclass(frozen=True, slots=True)
class ClearDraft:
    """Empty the draft."""


@dataclass(frozen=True, slots=True)
class LoadDraft:
    """Make the mission of a file the draft."""

    file: Path


@dataclass(frozen=True, slots=True)
class SaveDraft:
    """Write the draft to a file."""

    file: Path


Edit: TypeAlias = AddWaypoint | RemoveWaypoint | ListDraft | ClearDraft | LoadDraft | SaveDraft


class Draft:
    """A mission under construction; each edit replaces it, so any thread may read it."""

    def __init__(self) -> None:
        self.mission = EMPTY

    @property
    def text(self) -> str:
        """The mission file's text; UserError when the draft is empty."""
        if not self.mission.waypoints:
            raise UserError(NOTHING)
        return toml_text(self.mission)

    def apply(self, edit: Edit) -> str:
        """Apply an edit and return what was done, in words; UserError on failure."""
        match edit:
            case AddWaypoint(waypoint):
                return self.add(waypoint)
            case RemoveWaypoint(item):
                return self.remove(item)
            case LoadDraft(file):
                return self.load(file)
            case SaveDraft(file):
                return self.save(file)
            case ListDraft():
                return self.listed()
            case ClearDraft():
                return self.clear()

    def add(self, waypoint: Waypoint) -> str:
        """Append a waypoint."""
        self.mission = replace(self.mission, waypoints=(*self.mission.waypoints, waypoint))
        return f"waypoint {len(self.mission.waypoints)}: {waypoint}"

    def remove(self, item: int) -> str:
        """Remove a waypoint by its number from 1."""
        left = list(self.mission.waypoints)
        if item > len(left):
            raise UserError(f"there is no waypoint {item}: {self.listed()}")
        taken = left.pop(item - 1)
        self.mission = replace(self.mission, waypoints=tuple(left))
        return f"taken out: {taken}"

    def listed(self) -> str:
        """Return one line for each waypoint, and one for the fence."""
        rows = [f"{at}  {one}" for at, one in enumerate(self.mission.waypoints, start=1)]
        rows += [f"fence: {self.mission.fence}"] if self.mission.fence else []
        return "\n".join(rows) or NOTHING

    def clear(self) -> str:
        """Empty the draft."""
        self.mission = EMPTY
        return "the draft is empty"

    def load(self, path: Path) -> str:
        """Replace the draft by the mission of a file."""
        self.mission = files.read(path).mission
        return f"{path}: {self.mission}"

    def save(self, path: Path) -> str:
        """Write the draft to a file."""
        if not self.mission.waypoints:
            raise UserError(NOTHING)
        return files.written(path, self.mission, files.write(path, self.mission))


def waypoint_at(x_m: float, y_m: float, heading_deg: float | None, hold_s: float) -> Waypoint:
    """Return a waypoint; UserError names the value that is out of range."""
    table = {"x_m": x_m, "y_m": y_m, "hold_s": hold_s}
    if heading_deg is not None:
        table["heading_deg"] = heading_deg
    try:
        return parse(table, Waypoint, file="")
    except ConfigError as error:
        raise UserError(f"{error.key} {table[error.key]:g}: {error.reason}") from error
