"""A mission that is being made waypoint by waypoint, until it is saved or sent."""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from ground.missions import files
from ground.missions.mission import Mission, Waypoint
from ground.missions.toml_file import text_of
from ground.text.output import Says
from runtime.config import parse
from runtime.errors import ConfigError, UserError

EMPTY: Final = Mission(waypoints=())
NOTHING: Final = "the draft is empty: wp add X Y [DEG]"


class Draft:
    """Replaced as a whole at each step, so that it may be looked at from any thread."""

    def __init__(self) -> None:
        self.mission = EMPTY
        self._actions: Mapping[str, Callable[[argparse.Namespace], str]] = {
            "add": lambda options: self.add(waypoint_in(options)),
            "remove": lambda options: self.remove(options.item),
            "list": lambda _: self.listed(),
            "clear": lambda _: self.clear(),
            "load": lambda options: self.load(options.file),
            "save": lambda options: self.save(options.file),
        }

    @property
    def text(self) -> str:
        """As a mission file; UserError when there is nothing to send."""
        if not self.mission.waypoints:
            raise UserError(NOTHING)
        return text_of(self.mission)

    def act(self, options: argparse.Namespace, says: Says) -> int:
        """What `wp` was told to do."""
        said = self._actions[options.action](options)
        rows = [str(waypoint) for waypoint in self.mission.waypoints]
        says.result({"verb": f"wp {options.action}", "ok": True, "waypoints": rows}, said)
        return 0

    def add(self, waypoint: Waypoint) -> str:
        self.mission = replace(self.mission, waypoints=(*self.mission.waypoints, waypoint))
        return f"waypoint {len(self.mission.waypoints)}: {waypoint}"

    def remove(self, item: int) -> str:
        """By its number, from 1."""
        left = list(self.mission.waypoints)
        if item > len(left):
            raise UserError(f"there is no waypoint {item}: {self.listed()}")
        taken = left.pop(item - 1)
        self.mission = replace(self.mission, waypoints=tuple(left))
        return f"taken out: {taken}"

    def listed(self) -> str:
        """A line for each."""
        rows = [f"{at}  {one}" for at, one in enumerate(self.mission.waypoints, start=1)]
        rows += [f"fence: {self.mission.fence}"] if self.mission.fence else []
        return "\n".join(rows) or NOTHING

    def clear(self) -> str:
        self.mission = EMPTY
        return "the draft is empty"

    def load(self, path: Path) -> str:
        self.mission = files.read(path).mission
        return f"{path}: {self.mission}"

    def save(self, path: Path) -> str:
        if not self.mission.waypoints:
            raise UserError(NOTHING)
        return files.written(path, self.mission, files.write(path, self.mission))


def waypoint_in(options: argparse.Namespace) -> Waypoint:
    """X Y [DEG] [--hold S]; UserError names what is out of range."""
    table = {"x_m": options.x, "y_m": options.y, "hold_s": options.hold}
    if options.heading is not None:
        table["heading_deg"] = options.heading
    try:
        return parse(table, Waypoint, file="")
    except ConfigError as error:
        raise UserError(f"{error.key} {table[error.key]:g}: {error.reason}") from error
