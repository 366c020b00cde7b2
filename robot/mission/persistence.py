"""Items that survive a restart: a JSON file for the mission and one for the fence."""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import msgspec

from protocol.wire.enums import MissionType
from protocol.wire.message import check
from protocol.wire.messages import MissionItemInt
from robot.storage.writer import Directory, File, Ticket
from runtime.errors import LocalError

NAMES: Final[Mapping[int, str]] = MappingProxyType(
    {MissionType.FENCE: "fence", MissionType.MISSION: "mission"}
)
"""What is kept, in the order in which it is put up again: a mission must lie within the fence."""

Items = tuple[MissionItemInt, ...]


class UnreadableItemsError(Exception):
    """What is kept cannot be used; the text names the file and says why."""


class MissionStore:
    """Files in `directory`; where that has no path nothing is kept."""

    def __init__(self, directory: Directory) -> None:
        self._files: dict[int, File | None] = {
            kind: directory.file(name) for kind, name in NAMES.items()
        }

    def ticket(self, kind: int) -> Ticket | None:
        """A ticket for what was kept last; None where nothing is kept."""
        file = self._files.get(kind)
        return None if file is None else file.ticket

    def keep(self, kind: int, items: Items) -> None:
        """Have these survive a restart instead of those that were kept; none: no file does."""
        file = self._files.get(kind)
        if file is not None:
            file.put(text_of(items) if items else None)

    def found(self, kind: int) -> Items:
        """Return what an earlier run of the robot kept. Raises UnreadableItemsError."""
        file = self._files.get(kind)
        if file is None:
            return ()
        try:
            rows = json.loads(file.path.read_text(encoding="utf-8"))
            items = tuple(item_of(row) for row in rows)
            if not items:
                raise ValueError("there is nothing in it")
        except FileNotFoundError:
            file.found(None)
            return ()
        except (OSError, ValueError, TypeError, RecursionError, LocalError) as error:
            raise UnreadableItemsError(f"{file.path}: {error}") from error
        file.found(text_of(items))
        return items


def text_of(items: Items) -> str:
    """Return JSON that Python reads, with NaN as it is, and an item in each line."""
    rows = ",\n".join(json.dumps(msgspec.structs.asdict(item)) for item in items)
    return f"[\n{rows}\n]"


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
