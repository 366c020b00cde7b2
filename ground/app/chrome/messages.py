"""Place Textual's messages, and show only as many as fit."""

from typing import Any, Final

from textual.geometry import Region
from textual.screen import Screen
from textual.widgets._toast import ToastRack

MOST: Final = 3
"""Messages that are shown at once; the log has all of them."""
MOST_ROWS: Final = 4
"""Rows of a message at most, with the blank row above it; see ground.tcss."""


class MessagePlace:
    """Keeps messages in a region, where they cover no band, prompt, answer or key bar."""

    def __init__(self) -> None:
        self._placed: tuple[Region, Screen[Any]] | None = None

    def place(self, screen: Screen[Any], region: Region) -> None:
        """Move the messages of a screen into a region, and hide all but the newest few."""
        rack = next((one for one in screen.children if isinstance(one, ToastRack)), None)
        if rack is None:
            return
        if (region, screen) != self._placed:
            self._placed = region, screen
            rack.styles.margin = (region.y, 0, 0, 0)
            rack.styles.max_height = max(1, region.height)
        if rack.display:
            shown = min(MOST, region.height // MOST_ROWS)
            for age, holder in enumerate(reversed(rack.children)):
                holder.display = age < shown
