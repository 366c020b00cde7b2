"""Store mission and fence items in one JSON file each, to survive a restart."""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import msgspec

from protocol.wire.enums import MissionType
from protocol.wire.message import check
from protocol.wire.messages import MissionItemInt
from robot.storage.sealed import sealed, text_in, unsealed
from robot.storage.writer import Directory, StateFile, Ticket
from runtime.errors import LocalError

NAMES: Final[Mapping[int, str]] = MappingProxyType(
    {MissionType.FENCE: "fence", MissionType.MISSION: "mission"}
)
"""The stored kinds in the order of their restoration: a mission must lie within the fence."""

Items = tuple[MissionItemInt, ...]


class UnreadableItemsError(Exception):
    """The stored items cannot be used; the text contains the file and the reason."""


class MissionStore:
    """The item files of a directory; without a path nothing is stored."""

    def __init__(self, directory: Directory) -> None:
        self._files: dict[int, StateFile | None] = {
            kind: directory.file(name) for kind, name in NAMES.items()
        }

    def ticket(self, kind: int) -> Ticket | None:
        """Return the ticket of the newest write, or None if nothing is stored."""
        file = self._files.get(kind)
        return None if file is None else file.ticket

    def keep(self, kind: int, items: Items) -> None:
        """Store these items instead of the former ones; without items remove the file."""
        file = self._files.get(kind)
        if file is not None:
            file.put(sealed(text_of(items)) if items else None)

    def found(self, kind: int) -> Items:
        """Return the items of an earlier run; raise UnreadableItemsError if they cannot be read."""
        file = self._files.get(kind)
        if file is None:
            return ()
        try:
            text = text_in(file.path)
            items = tuple(item_of(row) for row in unsealed(text))
            if not items:
                raise ValueError("it contains no items")
        except FileNotFoundError:
            file.found(None)
            return ()
        except (OSError, ValueError, TypeError, RecursionError, LocalError) as error:
            raise UnreadableItemsError(f"{file.path}: {error}") from error
        file.found(text)
        return items


def text_of(items: Items) -> str:
    """Return JSON with one item per line, in which NaN is written as Python does."""
    rows = ",\n".join(json.dumps(msgspec.structs.asdict(item)) for item in items)
    return f"[\n{rows}\n]"


def item_of(row: object) -> MissionItemInt:
    """Return the item in a JSON object with exactly its fields.

    Raises ValueError, TypeError or LocalError.
    """
    names = MissionItemInt.__struct_fields__
    if not isinstance(row, dict) or row.keys() != set(names):
        raise ValueError(f"not an item of this version, which has {', '.join(names)}")
    try:
        item = msgspec.convert(row, MissionItemInt)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None
    check(item)
    return item
