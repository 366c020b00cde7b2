"""Remove control characters from every row before the terminal gets it."""

from rich.cells import cell_len
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from runtime.cli.terminal import REPLACEMENT


class Printable(LineFilter):
    """Replaces each unprintable character by as many cells as Textual counted for it.

    Textual passes the rows of all widgets, its own included, through this filter.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments without control characters."""
        if all(segment.text.isprintable() for segment in segments):
            return segments
        return [Segment(cleaned(text), style, control) for text, style, control in segments]


def cleaned(text: str) -> str:
    """Return the text without control characters."""
    return "".join(one if one.isprintable() else REPLACEMENT * cell_len(one) for one in text)
