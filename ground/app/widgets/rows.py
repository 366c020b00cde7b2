"""Rows of text as values: what a panel shows, before there is a terminal."""

from typing import Final, NamedTuple, TypeAlias

ASCII: Final = str.maketrans(
    {
        "●": "*", "○": "o", "◎": "O", "◇": "o", "▲": "^", "▶": ">", "■": "#",
        "█": "#", "▉": "#", "▊": "#", "▋": "#", "▌": "=", "▍": "=", "▎": "-", "▏": "-",
        "▁": "_", "▂": "_", "▃": "-", "▄": "-", "▅": "=", "▆": "=", "▇": "#",
        "·": ".", "°": "d", "γ": "y", "σ": "s", "µ": "u", "±": "~", "…": "~", "–": "-", "—": "-",
        "│": "|", "─": "-", "┃": "|", "━": "=", "→": ">", "←": "<", "↑": "^", "↓": "v",
        "↻": "@", "≥": ">", "≤": "<", "×": "x", "∞": "-", "²": "2", "₀": "0",
    }
)  # fmt: skip
"""One character for one, so that columns stay where they are."""


class Span(NamedTuple):
    """Some text in one role; roles are the names of colours in `ground.app.widgets.paint`."""

    text: str
    role: str = "text"


Row: TypeAlias = tuple[Span, ...]


def row(*pieces: str | Span) -> Row:
    """Plain strings are in the role `text`."""
    return tuple(Span(piece) if isinstance(piece, str) else piece for piece in pieces)


def head(text: str) -> Span:
    """The name of a value."""
    return Span(text, "head")


def faint(text: str) -> Span:
    return Span(text, "faint")


def width_of(row: Row) -> int:
    """In characters: panels use none that are two cells wide."""
    return sum(len(span.text) for span in row)


def words_of(row: Row) -> str:
    return "".join(span.text for span in row)


def cut(row: Row, width: int) -> Row:
    """No wider than that; what does not fit is cut off, with a mark."""
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
    """For fonts without anything else; what has no likeness becomes a question mark."""
    return text.translate(ASCII).encode("ascii", "replace").decode()
