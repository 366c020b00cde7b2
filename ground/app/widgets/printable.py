"""The last thing that is done to a row before a terminal gets it: no control character stays."""

from rich.cells import cell_len
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from runtime.cli.terminal import REPLACEMENT


class Printable(LineFilter):
    """Replaces what is not printable, in as many cells as it was counted to take.

    Textual passes the rows of all widgets, its own included, through the filters of the app.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        if all(segment.text.isprintable() for segment in segments):
            return segments
        return [Segment(cleaned(text), style, control) for text, style, control in segments]


def cleaned(text: str) -> str:
    return "".join(one if one.isprintable() else REPLACEMENT * cell_len(one) for one in text)
