"""Items that survive a restart: a JSON file for the mission and one for the fence."""

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

import msgspec

from protocol.enums import MissionType
from protocol.errors import LocalError
from protocol.message import check
from protocol.messages import MissionItemInt
from robot.store import replace_whole

NAMES: Final[Mapping[int, str]] = MappingProxyType(
    {MissionType.FENCE: "fence", MissionType.MISSION: "mission"}
)
"""What is kept, in the order in which it is put up again: a mission must lie within the fence."""

Items = tuple[MissionItemInt, ...]


class Unreadable(Exception):
    """What is kept cannot be used; the text names the file and says why."""


class Kept:
    """Files in `directory`; without a directory nothing is kept."""

    def __init__(self, directory: Path | None) -> None:
        self._directory = directory
        self._written: dict[int, str] = {}

    def path(self, kind: int) -> Path | None:
        return None if self._directory is None else self._directory / f"{NAMES[kind]}.json"

    def keep(self, kind: int, items: Items) -> None:
        """These instead of those that were kept; none takes the file away. Raises OSError."""
        path, text = self.path(kind), text_of(items)
        if path is None or self._written.get(kind) == text:
            return
        if items:
            replace_whole(path, text)
        else:
            path.unlink(missing_ok=True)
        self._written[kind] = text

    def found(self, kind: int) -> Items:
        """What an earlier run of the robot kept. Raises Unreadable."""
        path = self.path(kind)
        if path is None:
            return ()
        try:
            rows = json.loads(path.read_text(encoding="utf-8"))
            items = tuple(item_of(row) for row in rows)
            if not items:
                raise ValueError("there is nothing in it")
        except FileNotFoundError:
            return ()
        except (OSError, ValueError, TypeError, RecursionError, LocalError) as error:
            raise Unreadable(f"{path}: {error}") from error
        self._written[kind] = text_of(items)
        return items


def text_of(items: Items) -> str:
    """As JSON that Python reads, with NaN as it is."""
    return json.dumps([msgspec.structs.asdict(item) for item in items], indent=1)


def item_of(row: object) -> MissionItemInt:
    """An item with just these fields. Raises ValueError, TypeError or LocalError."""
    names = MissionItemInt.__struct_fields__
    if not isinstance(row, dict) or row.keys() != set(names):
        raise ValueError(f"not an item of this version, which has {', '.join(names)}")
    try:
        item = msgspec.convert(row, MissionItemInt)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None
    check(item)
    return item
