"""A status line made of parts, shortened to the width of the terminal; old values are marked."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple


class Part(NamedTuple):
    """One part of the line.

    `short` is used where room is scarce; `age_s` is set once the value is not live any more.
    """

    text: str
    short: str = ""
    age_s: float | None = None

    @property
    def words(self) -> str:
        """The text, with its age in brackets if it has one, for output that cannot be dimmed."""
        return self.dated(self.text)

    def dated(self, text: str) -> str:
        """Append the age to a text, if there is one."""
        return text if self.age_s is None else f"{text} ({self.age_s:.1f} s)"


def in_words(parts: Iterable[Part]) -> str:
    """Return the whole line, without a limit of its length."""
    return "  ".join(part.words for part in parts if part.text)


class Piece(NamedTuple):
    """Some text of a line; `dim` if its value is not live any more."""

    text: str
    dim: bool = False


def fitted(parts: Sequence[Part], width: int, *, dims: bool) -> list[Piece]:
    """Return pieces of at most `width` characters; with `dims` old ones are dimmed, not dated.

    Parts come in order of importance: if even their short forms do not fit, the last ones are left
    out.
    """
    shown = [part for part in parts if part.text]
    texts = [part.text if dims else part.words for part in shown]
    gap = "  "
    if length_of(texts, gap) > width:
        short = [part.short or part.text for part in shown]
        texts, gap = short, " "
        if not dims:
            texts = [part.dated(text) for part, text in zip(shown, short, strict=True)]
    while len(texts) > 1 and length_of(texts, gap) > width:
        texts.pop()
    texts = [text[:width] for text in texts]
    ages = [part.age_s for part in shown]
    pieces: list[Piece] = []
    for text, age_s in zip(texts, ages, strict=False):
        pieces += [Piece(gap)] if pieces else []
        pieces.append(Piece(text, dim=dims and age_s is not None))
    return pieces


def length_of(texts: Sequence[str], gap: str) -> int:
    """Return the length of the joined texts."""
    return sum(map(len, texts)) + len(gap) * max(0, len(texts) - 1)
