"""Lines of the log as rows: when, how bad as a letter, who, what."""

from typing import Final

from ground.station.log import Line
from ground.widgets.rows import Row, Span, faint, head, row

ROLES: Final = {"E": "danger", "W": "caution", "I": "text", "D": "faint"}


def log_row(line: Line, found: bool = False) -> Row:
    role = "reverse" if found else ROLES[line.letter]
    return row(
        faint(f"{line.time_s:8.1f} "),
        Span(line.letter, ROLES[line.letter]),
        head(f" {line.source} "),
        Span(line.text, role),
    )
