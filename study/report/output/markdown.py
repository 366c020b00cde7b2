"""A page as Markdown, with its figures as files beside it."""

from study.report.page import (
    Block,
    CodeBlock,
    Gallery,
    PageCellLike,
    PageFigure,
    PageTable,
    Paragraph,
    ReportPage,
    Section,
    text_of,
)


def markdown(page: ReportPage, folder: str) -> str:
    """Return the page; `folder` holds the figures, relative to the page."""
    parts = [f"# {page.title}", *(_block(block, folder) for block in page.lead)]
    parts += (_section(section, 2, folder) for section in page.sections)
    return "\n\n".join(parts) + "\n"


def table_lines(table: PageTable) -> str:
    """Return a table without its caption."""
    rule = ["---" if index < table.names else "---:" for index in range(len(table.head))]
    return "\n".join(
        [_line(table.head), f"|{'|'.join(rule)}|", *(_line(row) for row in table.rows)]
    )


def _line(cells: tuple[PageCellLike, ...]) -> str:
    return "| " + " | ".join(text_of(cell).replace("|", "\\|") for cell in cells) + " |"


def _section(section: Section, level: int, folder: str) -> str:
    parts = [f"{'#' * level} {section.title}"]
    parts += (_block(block, folder) for block in section.blocks)
    parts += (_section(part, level + 1, folder) for part in section.parts)
    return "\n\n".join(parts)


def _block(block: Block, folder: str) -> str:
    if isinstance(block, Paragraph):
        return block.words
    if isinstance(block, CodeBlock):
        return f"```sh\n{block.lines}\n```"
    if isinstance(block, PageTable):
        return f"{block.caption}\n\n{table_lines(block)}"
    if isinstance(block, PageFigure):
        return _figure(block, folder)
    return _gallery(block, folder)


def _gallery(gallery: Gallery, folder: str) -> str:
    return "\n\n".join(_figure(figure, folder) for figure in gallery.figures)


def _figure(figure: PageFigure, folder: str) -> str:
    title = figure.drawing.title.replace("[", "(").replace("]", ")").replace("\n", " ")
    lines = [f"![{title}]({folder}/{figure.name}.svg)", figure.caption]
    lines += [figure.note] if figure.note else []
    lines += [f"```sh\n{figure.code}\n```"] if figure.code else []
    return "\n\n".join(lines)
