"""Read and write mission files: `.toml`, and `.plan` and `.waypoints` of QGroundControl."""

from collections.abc import Sequence
from dataclasses import replace
from math import dist
from pathlib import Path
from typing import Final

from ground.missions import plan_file, toml_file, waypoints_file
from ground.missions.items import lost
from ground.missions.mission import Circle, Fence, Home, Mission, Waypoint
from ground.missions.outline import inside
from ground.missions.problems import MissionError, Problem
from ground.missions.sift import Foreign
from ground.recording import export_file
from runtime.errors import UserError
from runtime.files import text_in

ENDINGS: Final = (".toml", ".plan", ".waypoints")
LARGEST_BYTES: Final = 1_000_000
DASH: Final = Path("-")
"""Path of TOML text without a file: standard input, or the draft of a console."""


def read(path: Path, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Read a mission file; MissionError lists all problems."""
    return read_text(_text(path), path, home=home, drop=drop)


def read_text(text: str, path: Path, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Read a mission from text; DASH means TOML."""
    ending = ".toml" if path == DASH else ending_of(path)
    if ending == ".plan":
        found = plan_file.read_text(text, str(path), home=home, drop=drop)
    elif ending == ".waypoints":
        found = waypoints_file.read_text(text, str(path), home=home, drop=drop)
    else:
        mission = toml_file.read_text(text, str(path))
        found = Foreign(replace(mission, home=home or mission.home))
    _judge_places(found.mission, str(path))
    return found


def read_fence(path: Path) -> Fence:
    """Read the fence of a mission file; a .toml may contain only a fence."""
    if ending_of(path) == ".toml":
        fence = toml_file.read_text(_text(path), str(path), bare=True).fence
    else:
        fence = read(path).mission.fence
    if fence is None:
        raise UserError(f"{path}: has no fence; add [fence] with {toml_file.FENCE_FIX}")
    return fence


def _judge_places(mission: Mission, file: str) -> None:
    """Raise MissionError for waypoints outside the mission's own fence."""
    problems = [
        Problem(f"waypoint {at}", f"{waypoint} is outside of the fence", "move it or the fence")
        for at, waypoint in enumerate(mission.waypoints, start=1)
        if mission.fence is not None and not _within(mission.fence, waypoint)
    ]
    if problems:
        raise MissionError(file, problems)


def _within(fence: Fence, waypoint: Waypoint) -> bool:
    place = (waypoint.x_m, waypoint.y_m)
    if isinstance(fence, Circle):
        return dist(place, (fence.x_m, fence.y_m)) <= fence.radius_m
    return inside(fence.corners, place)


def write(path: Path, mission: Mission) -> tuple[str, ...]:
    """Write a file completely or not at all; return what the format cannot hold, in words."""
    ending = ending_of(path)
    if ending == ".toml":
        text, without = toml_file.text_of(mission), []
    else:
        if mission.home is None:
            fix = "add [home] to the TOML, or use --home LATITUDE LONGITUDE"
            raise MissionError(str(path), [Problem("", f"a {ending} needs a home", fix)])
        without = lost(mission.waypoints)
        if ending == ".plan":
            text = plan_file.text_of(mission, mission.home)
        else:
            text = waypoints_file.text_of(mission, mission.home)
            without += ["the fence"] if mission.fence else []
    export_file.replace(path, text)
    return tuple(without)


def written(path: Path, mission: Mission, without: Sequence[str]) -> str:
    """Report a written file, in words."""
    return f"{path}: {mission}{''.join(f'; {what} is lost' for what in without)}"


def ending_of(path: Path) -> str:
    """Return the suffix; UserError for one that is not supported."""
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise UserError(f"{path}: a mission file ends in {_listed(ENDINGS)}")
    return ending


def _listed(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"


def _text(path: Path) -> str:
    ending_of(path)
    try:
        return text_in(path, LARGEST_BYTES)
    except OSError as error:
        why = (error.strerror or "cannot be read").lower()
        fix = "name a mission file, such as one that `sidestep mission download FILE` has written"
        raise UserError(f"{path}: {why}: {fix}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: is not UTF-8 text; save it as UTF-8") from error
