"""What a report is made of, before anyone decides whether it becomes HTML or Markdown.

Text may hold `code` and **strong**, nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from study.report.charts.svg import Drawing


@dataclass(frozen=True, slots=True)
class Cell:
    """`tone`: good, bad, open or none; `heat` from 0 to 1 colours a cell of a heat table."""

    text: str
    tone: str = ""
    heat: float | None = None


CellLike: TypeAlias = Cell | str


@dataclass(frozen=True, slots=True)
class Text:
    words: str


@dataclass(frozen=True, slots=True)
class Items:
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Code:
    lines: str


@dataclass(frozen=True, slots=True)
class Table:
    """The first `names` columns name the row, the others hold figures and are set to the right."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[CellLike, ...], ...]
    names: int = 1


@dataclass(frozen=True, slots=True)
class Figure:
    """`name` is the file's beside the Markdown; `note` may be long, `code` can be pasted."""

    name: str
    drawing: Drawing
    caption: str
    note: str = ""
    code: str = ""


@dataclass(frozen=True, slots=True)
class Gallery:
    """Figures side by side as far as there is room."""

    figures: tuple[Figure, ...]


Block: TypeAlias = Text | Items | Code | Table | Figure | Gallery


@dataclass(frozen=True, slots=True)
class Section:
    title: str
    blocks: tuple[Block, ...]
    parts: tuple["Section", ...] = ()


@dataclass(frozen=True, slots=True)
class Page:
    title: str
    lead: tuple[Block, ...]
    sections: tuple[Section, ...] = field(default=())


def text_of(cell: CellLike) -> str:
    return cell if isinstance(cell, str) else cell.text


def figures_of(sections: Sequence[Section]) -> list[Figure]:
    """Every figure, in the order of the page."""
    found: list[Figure] = []
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Figure):
                found.append(block)
            elif isinstance(block, Gallery):
                found += block.figures
        found += figures_of(section.parts)
    return found
