"""Elements of a report page, independent of HTML and Markdown.

Text may contain `code` and **strong**, nothing else.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import TypeAlias

from study.report.charts.svg import SvgDrawing


@dataclass(frozen=True, slots=True)
class PageCell:
    """A table cell.

    `tone` is good, bad, open or none; `heat` from 0 to 1 colours a cell of a heat table.
    """

    text: str
    tone: str = ""
    heat: float | None = None


PageCellLike: TypeAlias = PageCell | str


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph of text."""

    words: str


@dataclass(frozen=True, slots=True)
class CodeBlock:
    """Lines of shell commands."""

    lines: str


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table whose first `names` columns name the row; figures in the others align right."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[PageCellLike, ...], ...]
    names: int = 1


@dataclass(frozen=True, slots=True)
class PageFigure:
    """A drawing with its caption.

    `name` is that of the file beside the Markdown; `note` may be long, `code` can be pasted.
    """

    name: str
    drawing: SvgDrawing
    caption: str
    note: str = ""
    code: str = ""


@dataclass(frozen=True, slots=True)
class Gallery:
    """Figures side by side as space permits."""

    figures: tuple[PageFigure, ...]


Block: TypeAlias = Paragraph | CodeBlock | PageTable | PageFigure | Gallery


@dataclass(frozen=True, slots=True)
class Section:
    """A titled section with subsections in `parts`."""

    title: str
    blocks: tuple[Block, ...]
    parts: tuple["Section", ...] = ()


@dataclass(frozen=True, slots=True)
class ReportPage:
    """A whole page: introduction and sections."""

    title: str
    lead: tuple[Block, ...]
    sections: tuple[Section, ...] = field(default=())


def text_of(cell: PageCellLike) -> str:
    """Return the text of a cell."""
    return cell if isinstance(cell, str) else cell.text


def figures_of(sections: Sequence[Section]) -> list[PageFigure]:
    """Return every figure in the order of the page."""
    found: list[PageFigure] = []
    for section in sections:
        for block in section.blocks:
            if isinstance(block, PageFigure):
                found.append(block)
            elif isinstance(block, Gallery):
                found += block.figures
        found += figures_of(section.parts)
    return found


def numbered(page: ReportPage) -> ReportPage:
    """Return the page with a number before the caption of each figure and table."""
    figures, tables = count(1), count(1)
    sections = tuple(_numbered(section, figures, tables) for section in page.sections)
    return replace(page, sections=sections)


def _numbered(section: Section, figures: Iterator[int], tables: Iterator[int]) -> Section:
    def figure(one: PageFigure) -> PageFigure:
        return replace(one, caption=f"**Figure {next(figures)}.** {one.caption}")

    def block(one: Block) -> Block:
        if isinstance(one, PageTable):
            return replace(one, caption=f"**Table {next(tables)}.** {one.caption}")
        if isinstance(one, PageFigure):
            return figure(one)
        return Gallery(tuple(map(figure, one.figures))) if isinstance(one, Gallery) else one

    blocks = tuple(map(block, section.blocks))
    parts = tuple(_numbered(part, figures, tables) for part in section.parts)
    return replace(section, blocks=blocks, parts=parts)
