"""Read and write `.waypoints`: lines of twelve numbers under `QGC WPL 110`; item 0 is home.

Source: mavlink.io, "File Formats"; item 0 is home as in Mission Planner and ArduPilot.
"""

from collections.abc import Iterator
from math import isfinite, nan
from typing import Final

from ground.missions.items import GLOBAL_FRAMES, Item, home_at, item_of
from ground.missions.mission import Home, Mission
from ground.missions.problems import MissionError, Problem
from ground.missions.sift import Foreign, PlanFilter
from protocol.wire.enums import FRAME_GLOBAL, Command
from runtime.errors import UserError

HEADER: Final = "QGC WPL 110"
FIELDS: Final = 12


def read_text(text: str, file: str, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Return the mission of a file; `home` replaces its item 0."""
    lines = text.lstrip("\ufeff").splitlines()
    if not lines or lines[0].split() != HEADER.split():
        problem = Problem("", f"the first line is not {HEADER!r}", "save it as QGC WPL 110", 1)
        raise MissionError(file, [problem])
    first, *rest = _items(lines, file) or [Item(0, Command.NAV_WAYPOINT, FRAME_GLOBAL, (0.0,) * 7)]
    if first.command != Command.NAV_WAYPOINT or first.frame not in GLOBAL_FRAMES:
        problem = Problem("item 0", "is not home", "write home as item 0: NAV_WAYPOINT, frame 0")
        raise MissionError(file, [problem])
    home = home or _home(first, file)
    sieve = PlanFilter(file, drop=drop)
    waypoints = sieve.waypoints(rest, home)
    return sieve.result(Mission(waypoints=tuple(waypoints), home=home))


def _items(lines: list[str], file: str) -> list[Item]:
    items, problems = [], []
    for line, text in enumerate(lines[1:], start=2):
        if not text.strip() or text.startswith("#"):
            continue
        numbers = list(_numbers(text))
        whole = [int(number) if isfinite(number) else -1 for number in numbers[:4]]
        if len(numbers) != FIELDS or whole != numbers[:4]:
            reason = f"is not {FIELDS} numbers, the first four of them whole"
            problems.append(Problem("", reason, "correct the line", line))
        else:
            items.append(Item(whole[0], whole[3], whole[2], tuple(numbers[4:11])))
    if problems:
        raise MissionError(file, problems)
    return items


def _numbers(text: str) -> Iterator[float]:
    """Yield the numbers of a line, NaN for anything else; no line may begin with NaN."""
    for word in text.split():
        try:
            yield float(word)
        except ValueError:
            yield nan


def _home(item: Item, file: str) -> Home | None:
    latitude_deg, longitude_deg = item.params[4:6]
    if not latitude_deg and not longitude_deg:
        return None
    try:
        return home_at(latitude_deg, longitude_deg)
    except UserError as error:
        raise MissionError(file, [Problem("item 0", str(error), "or use --home")]) from error


def text_of(mission: Mission, home: Home) -> str:
    """Return the text of a file; the format has no fence."""
    place = (0.0, 0.0, 0.0, 0.0, home.latitude_deg, home.longitude_deg, 0.0)
    items = [Item(0, Command.NAV_WAYPOINT, FRAME_GLOBAL, place)]
    items += [item_of(at, one, home) for at, one in enumerate(mission.waypoints, start=1)]
    return "\n".join([HEADER, *map(_line, items)]) + "\n"


def _line(item: Item) -> str:
    current = int(not item.number)
    numbers = [repr(value) if isfinite(value) else "nan" for value in item.params]
    return "\t".join(map(str, (item.number, current, item.frame, item.command, *numbers, 1)))
