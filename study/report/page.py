"""A report page: its elements, and their forms in HTML and in Markdown.

Text may contain `code` and **strong**, nothing else; an unknown value is a dash. The HTML page is
one self-contained file: it loads no script, font or other file. Its own script sorts tables by a
column and switches between light and dark; without it the page shows everything. Before printing it
opens what is folded. Markdown has its figures as files beside it, and may stand between two marks
in a page written by hand.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import count
from math import isfinite, isnan
from typing import Final, TypeAlias

from study.intervals import Interval, Proportion
from study.report.charts import DRAWING_RULES, PAGE_STYLE, SvgDrawing


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
class PageSection:
    """A titled section with subsections in `parts`."""

    title: str
    blocks: tuple[Block, ...]
    parts: tuple["PageSection", ...] = ()


@dataclass(frozen=True, slots=True)
class ReportPage:
    """A whole page: introduction and sections."""

    title: str
    lead: tuple[Block, ...]
    sections: tuple[PageSection, ...] = field(default=())


def text_of(cell: PageCellLike) -> str:
    """Return the text of a cell."""
    return cell if isinstance(cell, str) else cell.text


def figures_of(sections: Sequence[PageSection]) -> list[PageFigure]:
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


def _numbered(section: PageSection, figures: Iterator[int], tables: Iterator[int]) -> PageSection:
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


DASH = "-"


def number(value: float, digits: int = 2) -> str:
    """Format a number; a dash if it is not finite."""
    return f"{value:.{digits}f}" if isfinite(value) else DASH


def percent(rate: float, digits: int = 1) -> str:
    """Format a rate in percent, never rounded up to 100 or down to 0."""
    if isnan(rate):
        return DASH
    text = f"{100.0 * rate:.{digits}f}"
    if rate < 1.0 and float(text) == 100.0:
        return f">{100.0 - 10.0**-digits:.{digits}f}"
    if rate > 0.0 and float(text) == 0.0:
        return f"<{10.0**-digits:.{digits}f}"
    return text


def share(found: Proportion, digits: int = 1) -> str:
    """Format a share in percent with its interval."""
    if not found.of:
        return DASH
    low, high = found.interval
    return f"{percent(found.rate, digits)} [{percent(low, digits)}, {percent(high, digits)}]"


def interval(found: Interval, digits: int = 2) -> str:
    """Format an interval; an unbounded end is a dash, as is a fully unbounded interval."""
    if not (isfinite(found.low) or isfinite(found.high)):
        return DASH
    return f"[{number(found.low, digits)}, {number(found.high, digits)}]"


def probability(p: float) -> str:
    """Format a p-value."""
    if isnan(p):
        return DASH
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}" if p < 0.1 else f"{p:.2f}"


def count_text(value: int) -> str:
    """Format a count with thousands separators."""
    return f"{value:,}"


SCRIPT: Final = """
'use strict';
const each = (where, what, act) => where.querySelectorAll(what).forEach(act);
const keyOf = cell => {
  const text = cell.textContent.trim();
  const number = parseFloat(text.replace(/^[<>\\u2264\\u2265]\\s*/, '').replace(/,/g, ''));
  return Number.isNaN(number) ? text : number;
};
const compare = (a, b) => typeof a === typeof b
  ? (a < b ? -1 : a > b ? 1 : 0)
  : (typeof a === 'number' ? -1 : 1);
each(document, 'table', table => each(table, 'thead th', (head, column) => {
  const sort = () => {
    const down = head.getAttribute('aria-sort') === 'ascending';
    each(table, 'thead th', other => other.removeAttribute('aria-sort'));
    head.setAttribute('aria-sort', down ? 'descending' : 'ascending');
    const body = table.tBodies[0], rows = [...body.rows];
    rows.sort((a, b) => compare(keyOf(a.cells[column]), keyOf(b.cells[column])) * (down ? -1 : 1));
    body.append(...rows);
  };
  head.tabIndex = 0;
  head.classList.add('sorts');
  head.addEventListener('click', sort);
  head.addEventListener('keydown', event => { if (event.key === 'Enter') sort(); });
}));
const wantsDark = matchMedia('(prefers-color-scheme: dark)');
const root = document.documentElement, button = document.createElement('button');
const isDark = () => (root.dataset.colours || (wantsDark.matches ? 'dark' : 'light')) === 'dark';
const label = () => { button.textContent = isDark() ? 'Light colours' : 'Dark colours'; };
button.addEventListener('click', () => {
  root.dataset.colours = isDark() ? 'light' : 'dark';
  label();
});
wantsDark.addEventListener('change', label);
label();
document.querySelector('header').append(button);
addEventListener('beforeprint', () => each(document, 'details', part => { part.open = true; }));
"""


SHORT = 24
"""A name of at most this many letters is not wrapped."""
MAX_ROWS = 16
"""A table with more rows is folded."""


def html_of(page: ReportPage) -> str:
    """Return the page."""
    title = escape(page.title)
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{PAGE_STYLE}{DRAWING_RULES}</style></head><body>",
        f"<header><h1>{title}</h1></header><main>",
        *map(_html_block, page.lead),
        _contents(page.sections),
        *(_html_section(section, 2) for section in page.sections),
        f"</main><script>{SCRIPT}</script></body></html>\n",
    ]
    return "\n".join(parts)


def anchor(title: str) -> str:
    """Return the id of a section."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def _contents(sections: tuple[PageSection, ...]) -> str:
    links = (f'<li><a href="#{anchor(s.title)}">{escape(s.title)}</a></li>' for s in sections)
    return f'<nav aria-label="Contents"><ol>{"".join(links)}</ol></nav>'


def _html_section(section: PageSection, level: int) -> str:
    name = f' id="{anchor(section.title)}"' if level == 2 else ""
    head = f"<h{level}>{_words(section.title)}</h{level}>"
    parts = [
        *map(_html_block, section.blocks),
        *(_html_section(part, level + 1) for part in section.parts),
    ]
    if level > 2:
        return _folded(head, "\n".join(parts))
    return "\n".join((f"<section{name}>{head}", *parts, "</section>"))


def _folded(head: str, content: str) -> str:
    """Return content that is shown when its head is clicked."""
    return f"<details><summary>{head}</summary>\n{content}</details>"


def _html_block(block: Block) -> str:
    if isinstance(block, Paragraph):
        return f"<p>{_words(block.words)}</p>"
    if isinstance(block, CodeBlock):
        return f"<pre><code>{escape(block.lines)}</code></pre>"
    if isinstance(block, PageTable):
        return _table(block)
    if isinstance(block, PageFigure):
        return _html_figure(block)
    return f'<div class="gallery">{"".join(map(_html_figure, block.figures))}</div>'


def _html_figure(figure: PageFigure) -> str:
    note = f"<br>{_words(figure.note)}" if figure.note else ""
    code = f"<pre><code>{escape(figure.code)}</code></pre>" if figure.code else ""
    caption = f"<figcaption>{_words(figure.caption)}{note}</figcaption>"
    return f"<figure>{figure.drawing.inline()}{caption}{code}</figure>"


def _table(table: PageTable) -> str:
    head = "".join(
        f'<th scope="col"{_right(index, table)}>{_words(name)}</th>'
        for index, name in enumerate(table.head)
    )
    rows = "\n".join(
        f"<tr>{''.join(_cell(cell, index, table) for index, cell in enumerate(row))}</tr>"
        for row in table.rows
    )
    caption = _words(table.caption)
    is_long = len(table.rows) > MAX_ROWS
    # Wide tables scroll on their own, also with the keyboard.
    shown = (
        f'<div class="wide" tabindex="0" role="region" aria-label="{_plain(table.caption)}"><table>'
        f"{'' if is_long else f'<caption>{caption}</caption>'}"
        f"<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>"
    )
    return _folded(f"{caption} ({len(table.rows)} rows)", shown) if is_long else shown


def _right(index: int, table: PageTable) -> str:
    return "" if index < table.names else ' class="figure"'


def _cell(cell: PageCellLike, index: int, table: PageTable) -> str:
    found = PageCell(cell) if isinstance(cell, str) else cell
    words = _words(found.text)
    if found.tone:
        words = f'<span class="{found.tone}">{words}</span>'
    if index == 0:
        short = ' class="short"' if len(found.text) <= SHORT else ""
        return f'<th scope="row"{short}>{words}</th>'
    return f"<td{_right(index, table)}{_heat(found.heat)}>{words}</td>"


def _heat(heat: float | None) -> str:
    """Return a background from warm at 0 over none at 0.5 to cool at 1."""
    if heat is None:
        return ""
    name, strength = ("cool", 2 * heat - 1) if heat >= 0.5 else ("warm", 1 - 2 * heat)
    return f' style="background:rgba(var(--{name}),{0.5 * strength:.2f})"'


def _plain(words: str) -> str:
    return escape(words.replace("`", "").replace("**", ""), quote=True)


def _words(words: str) -> str:
    text = escape(words, quote=False)
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", text)
    return re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", text)


def markdown_of(page: ReportPage, folder: str) -> str:
    """Return the page; `folder` holds the figures, relative to the page."""
    parts = [f"# {page.title}", *(_markdown_block(block, folder) for block in page.lead)]
    parts += (_markdown_section(section, 2, folder) for section in page.sections)
    return "\n\n".join(parts) + "\n"


def table_lines(table: PageTable) -> str:
    """Return a table without its caption."""
    rule = ["---" if index < table.names else "---:" for index in range(len(table.head))]
    return "\n".join(
        [_line(table.head), f"|{'|'.join(rule)}|", *(_line(row) for row in table.rows)]
    )


def _line(cells: tuple[PageCellLike, ...]) -> str:
    return "| " + " | ".join(text_of(cell).replace("|", "\\|") for cell in cells) + " |"


def _markdown_section(section: PageSection, level: int, folder: str) -> str:
    parts = [f"{'#' * level} {section.title}"]
    parts += (_markdown_block(block, folder) for block in section.blocks)
    parts += (_markdown_section(part, level + 1, folder) for part in section.parts)
    return "\n\n".join(parts)


def _markdown_block(block: Block, folder: str) -> str:
    if isinstance(block, Paragraph):
        return block.words
    if isinstance(block, CodeBlock):
        return f"```sh\n{block.lines}\n```"
    if isinstance(block, PageTable):
        return f"{block.caption}\n\n{table_lines(block)}"
    if isinstance(block, PageFigure):
        return _markdown_figure(block, folder)
    return "\n\n".join(_markdown_figure(figure, folder) for figure in block.figures)


def _markdown_figure(figure: PageFigure, folder: str) -> str:
    title = figure.drawing.title.replace("[", "(").replace("]", ")").replace("\n", " ")
    lines = [f"![{title}]({folder}/{figure.name}.svg)", figure.caption]
    lines += [figure.note] if figure.note else []
    lines += [f"```sh\n{figure.code}\n```"] if figure.code else []
    return "\n\n".join(lines)


def with_text(page: str, begin: str, end: str, text: str) -> str:
    """Return the page with this text between its marks; raise ValueError for a missing mark."""
    before, found_begin, rest = page.partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found_begin and found_end):
        raise ValueError(
            f"the page has no {begin.strip()} and {end.strip()}; add both where the text goes"
        )
    return f"{before}{begin}{text}{end}{after}"
