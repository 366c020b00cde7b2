"""A status line made of parts: it fits the width there is, and what is old looks old."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple


class Part(NamedTuple):
    """What it says; `short` where room is scarce, `age_s` when it is not quite live any more."""

    text: str
    short: str = ""
    age_s: float | None = None

    @property
    def words(self) -> str:
        """With its age in brackets when it has one: for where nothing can be dimmed."""
        return self.dated(self.text)

    def dated(self, text: str) -> str:
        return text if self.age_s is None else f"{text} ({self.age_s:.1f} s)"


def in_words(parts: Iterable[Part]) -> str:
    """The whole line, however long."""
    return "  ".join(part.words for part in parts if part.text)


class Piece(NamedTuple):
    """Some text of a line; `dim`: of a part that is not quite live any more."""

    text: str
    dim: bool = False


def fitted(parts: Sequence[Part], width: int, *, dims: bool) -> list[Piece]:
    """Pieces of at most `width` characters in all; `dims`: the old are dimmed, not dated.

    Parts come in order of importance: when even their short forms are too many, the last ones go.
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
    return sum(map(len, texts)) + len(gap) * max(0, len(texts) - 1)
