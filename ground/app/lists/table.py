"""Lay out a list as columns, filtered by typed words and sorted by a click on a column's head."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from types import MappingProxyType
from typing import Any, Final, Generic, TypeAlias, TypeVar

from textual import events

from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, faint, row

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


T = TypeVar("T")
Order: TypeAlias = float | str
UP: Final = "▲"
DOWN: Final = "▼"


@dataclass(frozen=True)
class Column(Generic[T]):
    """A column: its head, its width in characters, and the text of a row in it.

    `order` is what rows are sorted by, else their text; None sorts last in both directions.
    `short` is the head of a narrow column. `numeric` columns are aligned to the right, and sorted
    the largest first.
    """

    name: str
    width: int
    text: Callable[[T], str]
    order: Callable[[T], Order | None] | None = None
    role: Callable[[T], str] = lambda _: "text"
    unit: str = ""
    numeric: bool = False
    short: str = ""

    @property
    def title(self) -> str:
        """The head with the unit."""
        return f"{self.short or self.name} {self.unit}".rstrip()

    def fitted(self, text: str) -> str:
        """Return a text in the width of the column; a width of 0 has no end."""
        if not self.width:
            return text
        cell = text if len(text) <= self.width else f"{text[: max(0, self.width - 1)]}…"
        return f"{cell:>{self.width}}" if self.numeric else f"{cell:<{self.width}}"


class Heads(Generic[T]):
    """The heads of columns, and the column that the rows are sorted by."""

    def __init__(self, columns: Sequence[Column[T]]) -> None:
        self.columns = tuple(columns)
        self.sorted_by: int | None = None
        self.is_descending = False

    def sort_by_next(self) -> None:
        """Sort by the next column; after the last one, as the list came."""
        after = 0 if self.sorted_by is None else self.sorted_by + 1
        self.sorted_by = None if after >= len(self.columns) else after
        self.is_descending = after < len(self.columns) and self.columns[after].numeric

    def turn(self) -> None:
        """Reverse the order."""
        if self.sorted_by is not None:
            self.is_descending = not self.is_descending

    def sort_by(self, column: int) -> None:
        """Sort by a column, or reverse the order if the list is sorted by it."""
        if self.sorted_by == column:
            self.turn()
        else:
            self.sorted_by, self.is_descending = column, self.columns[column].numeric

    @property
    def order_words(self) -> str:
        """The column that the list is sorted by, with its direction."""
        if self.sorted_by is None:
            return "off"
        return f"{self.columns[self.sorted_by].name}{DOWN if self.is_descending else UP}"

    def sorted(self, rows: list[T]) -> list[T]:
        """Return the rows in order; rows without a value come last in both directions."""
        if self.sorted_by is None:
            return rows
        column = self.columns[self.sorted_by]
        order: Callable[[T], Any] = column.order or (lambda one: column.text(one).casefold())
        known = [one for one in rows if order(one) is not None]
        unknown = [one for one in rows if order(one) is None]
        return [*sorted(known, key=order, reverse=self.is_descending), *unknown]

    def column_at(self, x: int) -> int:
        """Return the column at a position in a row."""
        ends = accumulate(column.width + 1 for column in self.columns[:-1])
        return sum(x >= 1 + end for end in ends)

    def heads(self) -> Row:
        """Return the row of heads; the column that the list is sorted by has a mark."""
        spans = [Span(" ")]
        for number, column in enumerate(self.columns):
            is_chosen = number == self.sorted_by
            mark = (DOWN if self.is_descending else UP) if is_chosen else ""
            title = f"{mark}{column.title}" if column.numeric else f"{column.title}{mark}"
            spans.append(Span(f"{column.fitted(title)} ", "accent" if is_chosen else "head"))
        return tuple(spans)


class Table(Heads[T]):
    """The rows of a list that pass the filter, in order. `key` identifies a row for ever.

    `rows` are those of the last update; the choice stays on its row when the order changes.
    """

    def __init__(self, columns: Sequence[Column[T]], key: Callable[[T], Hashable]) -> None:
        super().__init__(columns)
        self.names = tuple(column.name for column in columns)
        self.filter = ListFilter()
        self.rows: list[T] = []
        self.total = 0
        self._key = key

    def update(self, items: Iterable[T], words: str, at: int) -> int:
        """Filter and sort the items; return where the row is now that was row `at`."""
        if words != self.filter.words:
            self.filter = ListFilter(words, self.names)
        before = self.at(at)
        every = list(items)
        self.total = len(every)
        self.rows = self.sorted([one for one in every if self.filter.passes(self.cells(one))])
        if before is None:
            return at
        key = self._key(before)
        return next((row for row, one in enumerate(self.rows) if self._key(one) == key), 0)

    def cells(self, item: T) -> dict[str, str]:
        """Return the texts of a row by column."""
        return {column.name: column.text(item) for column in self.columns}

    def at(self, row: int) -> T | None:
        """Return the item in a row, if there is one."""
        return self.rows[row] if 0 <= row < len(self.rows) else None

    def paint(self, item: T, chosen: bool) -> Row:
        """Return the row of an item; the first cell of the chosen row is marked."""
        spans = [Span(" ")]
        for number, column in enumerate(self.columns):
            role = "reverse" if chosen and number == 0 else column.role(item)
            spans += [Span(column.fitted(column.text(item)), role), Span(" ")]
        return tuple(spans)


class ColumnHeads(Lines):
    """The heads of the columns in one row."""

    def __init__(self, heads: Heads[Any], *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._heads = heads

    def draw(self) -> None:
        """Draw the heads."""
        self.show([cut(self._heads.heads(), self.size.width)])

    def on_click(self, event: events.Click) -> None:
        """Sort by the column that was clicked."""
        event.stop()
        self._heads.sort_by(self._heads.column_at(event.x))
        self.draw()
