"""Report frames that the plant rejected: at once, and whenever their number has doubled."""

from collections.abc import Callable, Mapping


class Unreadable:
    """`counts` is how many frames were rejected, by path; `tell` gets a line."""

    def __init__(self, counts: Callable[[], Mapping[str, int]], tell: Callable[[str], None]):
        self._counts = counts
        self._tell = tell
        self._told: dict[str, int] = {}

    def look(self) -> None:
        for path, count in self._counts().items():
            if count > 2 * self._told.get(path, 0):
                self._told[path] = count
                what = f"{count} unreadable or refused on {path}"
                self._tell(f"plant: {what}: find out which other process publishes there")
