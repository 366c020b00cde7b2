"""The virtual tree: names are looked up in lists, so no path leads outside of it.

`@PARAM` and `@MAV_LOG` are names that ground stations use. QGroundControl lists only files that
end in `.bin` or `.ulg` as logs, so in `@MAV_LOG` the recordings have `.bin` behind their names.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from gateways.mavlink.files.recordings import Recording, Recordings
from gateways.mavlink.files.sources import BytesSource, FileSource, Source
from gateways.mavlink.files.wire import Failure
from gateways.mavlink.parameters.metadata import GENERAL_NAME, PARAMETERS_NAME
from gateways.mavlink.parameters.packed import Selection, packed, selection_in
from gateways.mavlink.parameters.store import ParameterStore
from gateways.mavlink.parameters.table import MavTable

PARAMETERS_FOLDER, PACKED_NAME = "@PARAM", "param.pck"
LOGS_FOLDER, LOG_SUFFIX = "@MAV_LOG", ".bin"
RECORDINGS_FOLDER: Final = "recordings"
FOLDERS: Final = (LOGS_FOLDER, PARAMETERS_FOLDER, RECORDINGS_FOLDER)

Opened = Callable[[Source | Failure], None]


class Entry(NamedTuple):
    """A line of a listing; `time_s` is since 1970, 0 if it is unknown."""

    name: str
    size: int = 0
    time_s: int = 0
    is_folder: bool = False

    def line(self, *, with_time: bool) -> bytes:
        """Return it as FTP lists it."""
        kind = "D" if self.is_folder else "F"
        parts = [kind + self.name]
        if with_time or not self.is_folder:
            parts.append(str(self.size))
        if with_time:
            parts.append(str(self.time_s))
        return "\t".join(parts).encode()


class VirtualTree:
    """The files of one vehicle."""

    def __init__(self, store: ParameterStore, recordings: Recordings) -> None:
        self._store = store
        self._recordings = recordings
        self._entries: dict[str, tuple[Sequence[Recording], list[Entry]]] = {}

    def entries(self, path: str, now_ns: int) -> Sequence[Entry] | None:
        """Return what a folder contains, None if there is no such folder."""
        match path.strip("/"):
            case "" | ".":
                return [*(Entry(name, is_folder=True) for name in FOLDERS), *self._metadata()]
            case "@PARAM":
                table = self._store.table
                size = 0 if table is None else len(packed(table, Selection()) or b"")
                return [Entry(PACKED_NAME, size)]
            case "@MAV_LOG":
                return self._logs(LOG_SUFFIX, now_ns)
            case "recordings":
                return self._logs("", now_ns)
        return None

    def open(self, path: str, then: Opened, now_ns: int) -> None:
        """Call `then` with the file or the reason of a failure, perhaps in a later round."""
        name, _, query = path.removeprefix("/").partition("?")
        folder, slash, file = name.partition("/")
        if name in (GENERAL_NAME, PARAMETERS_NAME):
            self._store.known(lambda table, _: then(self._described(name, table)), now_ns)
        elif name == f"{PARAMETERS_FOLDER}/{PACKED_NAME}":
            selection = selection_in(query)
            self._store.latest(lambda table, _: then(_packed(table, selection)), now_ns)
        elif slash and folder == RECORDINGS_FOLDER:
            then(self._recording(file, now_ns))
        elif slash and folder == LOGS_FOLDER and file.endswith(LOG_SUFFIX):
            then(self._recording(file.removesuffix(LOG_SUFFIX), now_ns))
        else:
            then(Failure.FILE_NOT_FOUND)

    def _metadata(self) -> list[Entry]:
        found = self._store.metadata
        if found is None:
            return []
        sizes = {GENERAL_NAME: len(found.general), PARAMETERS_NAME: len(found.parameters)}
        return [Entry(name, size) for name, size in sizes.items()]

    def _logs(self, suffix: str, now_ns: int) -> list[Entry]:
        """Return the entries of all recordings, which are made once for each new list."""
        found = self._recordings.listed(now_ns)
        before, entries = self._entries.get(suffix, (None, []))
        if before is not found:
            entries = [Entry(one.name + suffix, one.size, one.began_s) for one in found]
            self._entries[suffix] = found, entries
        return entries

    def _described(self, name: str, table: MavTable | None) -> Source | Failure:
        found = self._store.metadata
        if table is None or found is None:
            return Failure.FAIL
        return BytesSource(found.general if name == GENERAL_NAME else found.parameters)

    def _recording(self, name: str, now_ns: int) -> Source | Failure:
        found = self._recordings.find(name, now_ns)
        if found is None:
            return Failure.FILE_NOT_FOUND
        try:
            return FileSource(found.path)
        except OSError:
            return Failure.FAIL


def _packed(table: MavTable | None, selection: Selection | None) -> Source | Failure:
    data = None if table is None or selection is None else packed(table, selection)
    return Failure.FAIL if data is None else BytesSource(data)
