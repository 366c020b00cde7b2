"""Define rows of text as values, independent of a terminal."""

from typing import Final, NamedTuple, TypeAlias

ASCII: Final = str.maketrans(
    {
        "●": "*", "○": "o", "◎": "O", "◇": "o", "▲": "^", "▼": "v", "▶": ">", "▸": ">", "■": "#",
        "█": "#", "▉": "#", "▊": "#", "▋": "#", "▌": "=", "▍": "=", "▎": "-", "▏": "-",
        "▁": "_", "▂": "_", "▃": "-", "▄": "-", "▅": "=", "▆": "=", "▇": "#",
        "·": ".", "°": "d", "γ": "y", "σ": "s", "µ": "u", "±": "~", "…": "~", "–": "-", "—": "-",
        "│": "|", "─": "-", "┃": "|", "━": "=", "→": ">", "←": "<", "↑": "^", "↓": "v",
        "↻": "@", "≥": ">", "≤": "<", "×": "x", "∞": "-", "²": "2", "₀": "0",
    }
)  # fmt: skip
"""Each character has one replacement, so that columns keep their places."""


class Span(NamedTuple):
    """A text in one role; roles are the names of colours in `ground.app.widgets.role_colours`."""

    text: str
    role: str = "text"


Row: TypeAlias = tuple[Span, ...]


def row(*pieces: str | Span) -> Row:
    """Return a row; plain strings get the role `text`."""
    return tuple(Span(piece) if isinstance(piece, str) else piece for piece in pieces)


def head(text: str) -> Span:
    """Return the name of a value."""
    return Span(text, "head")


def faint(text: str) -> Span:
    """Return a faint text."""
    return Span(text, "faint")


def width_of(row: Row) -> int:
    """Return the width in characters; panels use no wide characters."""
    return sum(len(span.text) for span in row)


def words_of(row: Row) -> str:
    """Return the text of a row."""
    return "".join(span.text for span in row)


def cut(row: Row, width: int) -> Row:
    """Return the row cut to a width; an ellipsis marks the cut."""
    if width_of(row) <= width:
        return row
    kept: list[Span] = []
    room = width - 1
    for span in row:
        kept.append(Span(span.text[:room], span.role))
        room -= len(span.text)
        if room <= 0:
            break
    return (*kept, faint("…")) if width > 0 else ()


def in_ascii(text: str) -> str:
    """Replace characters by ASCII ones; unknown characters become a question mark."""
    return text.translate(ASCII).encode("ascii", "replace").decode()
