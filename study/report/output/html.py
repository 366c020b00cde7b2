"""A page as one self-contained HTML file: it loads no script, font or other file."""

import re
from html import escape

from study.report.charts.style import DRAWING_RULES, PAGE_STYLE
from study.report.output.interaction import SCRIPT
from study.report.page import (
    Block,
    CodeBlock,
    Gallery,
    PageCell,
    PageCellLike,
    PageFigure,
    PageTable,
    Paragraph,
    ReportPage,
    Section,
)

SHORT = 24
"""A name of at most this many letters is not wrapped."""
MAX_ROWS = 16
"""A table with more rows is folded."""


def html(page: ReportPage) -> str:
    """Return the page."""
    title = escape(page.title)
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{PAGE_STYLE}{DRAWING_RULES}</style></head><body>",
        f"<header><h1>{title}</h1></header><main>",
        *map(_block, page.lead),
        _contents(page.sections),
        *(_section(section, 2) for section in page.sections),
        f"</main><script>{SCRIPT}</script></body></html>\n",
    ]
    return "\n".join(parts)


def anchor(title: str) -> str:
    """Return the id of a section."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def _contents(sections: tuple[Section, ...]) -> str:
    links = (f'<li><a href="#{anchor(s.title)}">{escape(s.title)}</a></li>' for s in sections)
    return f'<nav aria-label="Contents"><ol>{"".join(links)}</ol></nav>'


def _section(section: Section, level: int) -> str:
    name = f' id="{anchor(section.title)}"' if level == 2 else ""
    head = f"<h{level}>{_words(section.title)}</h{level}>"
    parts = [*map(_block, section.blocks), *(_section(one, level + 1) for one in section.parts)]
    if level > 2:
        return _folded(head, "\n".join(parts))
    return "\n".join((f"<section{name}>{head}", *parts, "</section>"))


def _folded(head: str, content: str) -> str:
    """Return content that is shown when its head is clicked."""
    return f"<details><summary>{head}</summary>\n{content}</details>"


def _block(block: Block) -> str:
    if isinstance(block, Paragraph):
        return f"<p>{_words(block.words)}</p>"
    if isinstance(block, CodeBlock):
        return f"<pre><code>{escape(block.lines)}</code></pre>"
    if isinstance(block, PageTable):
        return _table(block)
    if isinstance(block, PageFigure):
        return _figure(block)
    return _gallery(block)


def _gallery(gallery: Gallery) -> str:
    return f'<div class="gallery">{"".join(map(_figure, gallery.figures))}</div>'


def _figure(figure: PageFigure) -> str:
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
