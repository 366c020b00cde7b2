"""Filter the rows of a list by typed words."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

from ground.app.widgets.rows import Row, Span, faint, row

MAX_TERMS: Final = 20


class ListFilter:
    """Words that a row must contain, in any case and any order.

    `COLUMN:WORD` looks in one column only. A prefix that names no column is plain text. `aliases`
    are further names of columns.
    """

    def __init__(
        self,
        words: str = "",
        columns: Iterable[str] = (),
        aliases: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        names = {name: name for name in columns} | dict(aliases)
        self.words = words
        self._everywhere: list[str] = []
        self._in_column: list[tuple[str, str]] = []
        for term in words.casefold().split()[:MAX_TERMS]:
            column, colon, word = term.partition(":")
            if colon and column in names:
                self._in_column.append((names[column], word))
            else:
                self._everywhere.append(term)

    def passes(self, cells: Mapping[str, str]) -> bool:
        """Return whether a row passes; `cells` are its texts by column."""
        if any(word not in cells[column].casefold() for column, word in self._in_column):
            return False
        if not self._everywhere:
            return True
        text = " ".join(cells.values()).casefold()
        return all(term in text for term in self._everywhere)

    def narrows(self, before: "ListFilter") -> bool:
        """Return whether every row that passes this filter passes `before`, too."""
        everywhere = all(any(old in new for new in self._everywhere) for old in before._everywhere)
        return everywhere and all(
            any(column == other and old in new for other, new in self._in_column)
            for column, old in before._in_column
        )


def filter_spans(words: str, shown: int, total: int, *, typing: bool) -> Row:
    """Return the filter with the number of rows that pass, for a heading; empty without one."""
    if not words and not typing:
        return ()
    counts = Span(f"   {shown} of {total}", "accent" if shown else "caution")
    next_keys = "Enter keeps, Esc clears" if typing else "Esc clears"
    return row(counts, Span(f"  /{words}", "accent"), faint(f"  {next_keys}"))


def nothing_row(words: str) -> Row:
    """Return the row that is shown instead of an empty list."""
    return row(faint(" nothing matches "), Span(words, "caution"), faint(": Esc clears the filter"))


def hidden_spans(above: int, below: int) -> Row:
    """Return the number of hidden rows above and below, for the heading.

    Empty if all are visible.
    """
    signs = [f"▲ {above} above"] * bool(above) + [f"▼ {below} below"] * bool(below)
    return (Span(f"   {'  '.join(signs)}", "key"),) if signs else ()
