"""A drawing in a grid of character cells: 2 x 4 dots and one role in each, marks and text above.

Dots count from the top left corner, x to the right and y downwards. Dots and cells outside the
canvas are skipped without an error. The role of a cell is the one drawn last.
"""

import re
from collections.abc import Iterable
from functools import cache, lru_cache
from typing import Final
from unicodedata import combining, east_asian_width

DOTS: Final = (0x01, 0x08, 0x02, 0x10, 0x04, 0x20, 0x40, 0x80)
"""The bit of the dot at [2 * (y % 4) + x % 2] in Unicode's braille patterns."""

BLANK: Final = " "
UNKNOWN: Final = "?"

MARKS: Final = {
    "seen": ("▒", ":"),
    "seen late": ("·", ","),
    "goal": ("◎", "O"),
    "virtual": ("◇", "o"),
    "cursor": ("✛", "+"),
    "hit": ("H", "H"),
    "leave": ("L", "L"),
    "waypoint": ("•", "*"),
    "draft": ("◦", "%"),
    "other": ("◆", "r"),
    "in need": ("!", "!"),
    "mover": ("●", "@"),
    "lost": ("?", "?"),
    "dead sonar": ("×", "X"),
    "reached": ("✓", "="),
    "collided": ("✕", "x"),
    "unreachable": ("∅", "0"),
    "ghost lost": ("¿", "&"),
    "stuck": ("■", "#"),
    "ended": ("□", "~"),
    "bar left": ("├", "|"),
    "bar": ("─", "-"),
    "bar right": ("┤", "|"),
}
"""The character of each meaning, in Unicode and in ASCII."""

DOTTED: Final = "⠿"
"""Echoes in colour: dots without a character of their own."""

HEADINGS: Final = ("▶◥▲◤◀◣▼◢", ">/^\\</v\\")
"""Arrowheads in steps of 45 degrees, counter-clockwise from the x axis."""

POINTERS: Final = ("→↗↑↖←↙↓↘", ">/^\\</v\\")
"""Arrows towards places outside the map, in the same order."""


def braille(bits: bytes | bytearray) -> str:
    """Return braille characters, one for each byte of dots; a cell without dots becomes a blank."""
    pairs = bytearray(b"\x00\x28" * len(bits))
    pairs[::2] = bits
    return pairs.decode("utf-16-le").replace("\u2800", BLANK)


def ascii_art(bits: bytes | bytearray) -> str:
    """Return ASCII characters, one for each byte of dots, for fonts without braille."""
    return bits.translate(_strokes()).decode("ascii")


@cache
def _strokes() -> bytes:
    return "".join(map(stroke, range(256))).encode("ascii")


def stroke(bits: int) -> str:
    """Return the ASCII character that looks most like a pattern of dots."""
    left = [row for row in range(4) if bits & DOTS[2 * row]]
    right = [row for row in range(4) if bits & DOTS[2 * row + 1]]
    rows = {*left, *right}
    if not rows:
        return BLANK
    if not left or not right:
        return "|" if len(rows) > 1 else "'" if rows <= {0, 1} else "."
    if len(rows) == 1:
        return "_" if rows == {3} else "-"
    if len(left) + len(right) >= 5:
        return "#" if len(left) + len(right) >= 7 else "+"
    lean = sum(left) / len(left) - sum(right) / len(right)
    if abs(lean) < 0.5:
        return "+" if len(rows) > 2 else "-"
    return "/" if lean > 0.0 else "\\"


@lru_cache(1024)
def printable(text: str, ascii_only: bool) -> str:
    """Replace each character that does not take exactly one printable cell by a question mark."""
    return "".join(
        character if _fits(character) and (character.isascii() or not ascii_only) else UNKNOWN
        for character in text
    )


def _fits(character: str) -> bool:
    wide = east_asian_width(character) in "WF"
    return character.isprintable() and not wide and not combining(character)


HUES: Final = 6
"""The colours of other robots and their trails, by name."""


def hue_of(robot: str) -> int:
    """Return the colour of a robot, which is the same in every session; r1 to r6 differ."""
    return sum(robot.encode()) % HUES


ROLES: Final = (
    "seen old",
    "seen late",
    "seen",
    "wall",
    "truth",
    "fence",
    "ghost",
    *(f"trail {hue}" for hue in range(HUES)),
    "trail",
    "ellipse",
    "zone",
    "cone",
    "echo",
    "leave",
    "hit",
    "draft",
    "mission",
    "virtual",
    "goal",
    *(f"other {hue}" for hue in range(HUES)),
    "danger",
    "true robot",
    "robot",
    "dead sonar",
    "text",
    "cursor",
)
"""`wall` is an obstacle known to the robot, `truth` one that only the simulation knows."""

RANK: Final = {role: rank for rank, role in enumerate(ROLES, start=1)}
"""Rank 0 is a blank cell."""


DOTS_WIDE: Final = 2
DOTS_HIGH: Final = 4

RUN: Final = re.compile(rb"\x00*([^\x00])(?:\1|\x00)*")

Dot = tuple[int, int]
Run = tuple[str, str]
"""A role ("" for blank cells) and the text drawn in this role."""
ECHO_RANK: Final = RANK["seen"]
"""Marks up to this rank are hidden by dots that were drawn later."""
SHORT: Final = 6
"""The dots of lines up to this length are stored in a table."""
OFF_CANVAS: Final = (0, 0, 0, 0, 0, 1)
"""The result of `clip_line` for a line that misses the canvas."""


class Canvas:
    """`columns` x `rows` cells, `width` x `height` dots."""

    __slots__ = (
        *("_bits", "_glyphs", "_ranks", "ascii_only", "columns", "height"),
        *("is_mono", "rows", "width"),
    )

    def __init__(
        self, columns: int, rows: int, ascii_only: bool = False, *, is_mono: bool = False
    ) -> None:
        self.columns, self.rows = max(0, columns), max(0, rows)
        self.width, self.height = DOTS_WIDE * self.columns, DOTS_HIGH * self.rows
        self.ascii_only, self.is_mono = ascii_only, is_mono
        self._bits = bytearray(self.columns * self.rows)
        self._ranks = bytearray(self.columns * self.rows)
        self._glyphs: list[dict[int, tuple[int, str]]] = [{} for _ in range(self.rows)]

    def copy(self) -> "Canvas":
        """Return an independent canvas with the same drawing."""
        twin = Canvas(self.columns, self.rows, self.ascii_only, is_mono=self.is_mono)
        twin._bits[:] = self._bits
        twin._ranks[:] = self._ranks
        twin._glyphs = [dict(row) for row in self._glyphs]
        return twin

    def dots(self, dots: Iterable[Dot], role: str, *, below: str = "") -> None:
        """Set single dots; cells that have a role from `below` on keep it."""
        bits, ranks, rank = self._bits, self._ranks, RANK[role]
        lowest = RANK.get(below, len(ROLES) + 1)
        columns, width, height = self.columns, self.width, self.height
        for x, y in dots:
            if 0 <= x < width and 0 <= y < height:
                cell = (y >> 2) * columns + (x >> 1)
                bits[cell] |= DOTS[(y & 3) << 1 | x & 1]
                if ranks[cell] < lowest:
                    ranks[cell] = rank

    def line(self, x0: int, y0: int, x1: int, y1: int, role: str) -> None:
        """Draw a line by Bresenham's algorithm.

        Both directions set the same dots. The part outside the canvas is clipped first, so the cost
        does not grow with the length.
        """
        if abs(x1 - x0) >= abs(y1 - y0):
            self._shallow((x0, y0, x1, y1) if x0 <= x1 else (x1, y1, x0, y0), RANK[role])
        else:
            self._steep((y0, x0, y1, x1) if y0 <= y1 else (y1, x1, y0, x0), RANK[role])

    def polyline(self, dots: Iterable[Dot], role: str) -> None:
        """Draw lines from dot to dot.

        Short lines, as in a trail, are set dot by dot instead of one by one.
        """
        found: list[Dot] = []
        last: Dot | None = None
        for dot in dots:
            if last is None:
                found.append(dot)
            elif dot != last:
                x, y = last
                dx, dy = dot[0] - x, dot[1] - y
                if -SHORT <= dx <= SHORT and -SHORT <= dy <= SHORT:
                    found += [(x + right, y + down) for right, down in short_line(dx, dy)]
                else:
                    self.line(*last, *dot, role)
            last = dot
        self.dots(found, role)

    def mark(self, column: int, row: int, meaning: str, role: str) -> None:
        """Put the character of a meaning (see `glyphs.MARKS`) into a cell."""
        self._put(column, row, MARKS[meaning][self.ascii_only], RANK[role])

    def heading(self, column: int, row: int, eighth: int, role: str) -> None:
        """Put an arrowhead that points `eighth` times 45 degrees left of the x axis."""
        self._put(column, row, HEADINGS[self.ascii_only][eighth % 8], RANK[role])

    def pointer(self, column: int, row: int, eighth: int, role: str) -> None:
        """Put an arrow towards a place outside the map; `eighth` as in `heading`."""
        self._put(column, row, POINTERS[self.ascii_only][eighth % 8], RANK[role])

    def text(self, column: int, row: int, words: str, role: str) -> None:
        """Write one line, moved left as far as needed to end on the canvas."""
        words = printable(words, self.ascii_only)
        column = max(0, min(column, self.columns - len(words)))
        for offset, character in enumerate(words):
            self._put(column + offset, row, character, RANK[role])

    def uncover(self, column: int, row: int, role: str) -> None:
        """Remove the mark of a lower rank from a cell."""
        if 0 <= row < self.rows and self._glyphs[row].get(column, (RANK[role],))[0] < RANK[role]:
            del self._glyphs[row][column]

    def is_occupied(self, column: int, row: int, cells: int) -> bool:
        """Return whether a mark or text is in any of `cells` cells; True outside the canvas."""
        if not 0 <= row < self.rows:
            return True
        return any(column <= at < column + cells for at in self._glyphs[row])

    def changed_rows(self, other: "Canvas") -> list[int]:
        """Return the rows that differ from those of `other`, a canvas of the same size."""
        wide = self.columns
        return [
            row
            for row in range(self.rows)
            if self._bits[row * wide : (row + 1) * wide]
            != other._bits[row * wide : (row + 1) * wide]
            or self._ranks[row * wide : (row + 1) * wide]
            != other._ranks[row * wide : (row + 1) * wide]
            or self._glyphs[row] != other._glyphs[row]
        ]

    def strip(self, row: int) -> list[Run]:
        """Return a row as runs of equal role, one character for each column.

        Blank cells belong to the run before them, because a change of colour costs more than a
        blank.
        """
        text, ranks = self._cells(row)
        runs = [(ROLES[run[1][0] - 1], text[slice(*run.span())]) for run in RUN.finditer(ranks)]
        return runs or ([("", text)] if text else [])

    def to_rows(self) -> list[str]:
        """Return the drawing as plain text."""
        return [self._cells(row)[0] for row in range(self.rows)]

    def _cells(self, row: int) -> tuple[str, bytearray]:
        """Return the characters of a row and their ranks; blank cells have rank 0."""
        if not 0 <= row < self.rows:
            return BLANK * self.columns, bytearray(self.columns)
        cells = slice(row * self.columns, (row + 1) * self.columns)
        bits, ranks = self._bits[cells], self._ranks[cells]
        text = ascii_art(bits) if self.ascii_only else braille(bits)
        if not self._glyphs[row]:
            return text, ranks
        characters = list(text)
        for column, (rank, character) in self._glyphs[row].items():
            if not ECHO_RANK >= rank < ranks[column]:
                characters[column], ranks[column] = character, rank
        return "".join(characters), ranks

    def _put(self, column: int, row: int, character: str, rank: int) -> None:
        if 0 <= row < self.rows and 0 <= column < self.columns:
            glyphs = self._glyphs[row]
            if column not in glyphs or glyphs[column][0] <= rank:
                glyphs[column] = rank, character

    def _shallow(self, ends: tuple[int, int, int, int], rank: int) -> None:
        bits, ranks, columns = self._bits, self._ranks, self.columns
        first, y, error, count, rise, full = clip_line(*ends, self.width, self.height)
        row, low = (y >> 2) * columns, (y & 3) << 1
        for x in range(first, first + count):
            cell = row + (x >> 1)
            bits[cell] |= DOTS[low | x & 1]
            ranks[cell] = rank
            error += rise
            if not 0 <= error < full:
                step = 1 if error > 0 else -1
                y += step
                error -= step * full
                row, low = (y >> 2) * columns, (y & 3) << 1

    def _steep(self, ends: tuple[int, int, int, int], rank: int) -> None:
        bits, ranks, columns = self._bits, self._ranks, self.columns
        first, x, error, count, rise, full = clip_line(*ends, self.height, self.width)
        for y in range(first, first + count):
            cell = (y >> 2) * columns + (x >> 1)
            bits[cell] |= DOTS[(y & 3) << 1 | x & 1]
            ranks[cell] = rank
            error += rise
            if not 0 <= error < full:
                step = 1 if error > 0 else -1
                x += step
                error -= step * full


@cache
def short_line(dx: int, dy: int) -> tuple[Dot, ...]:
    """Return the dots of a line from its first dot, which is left out, as `Canvas.line` sets them.

    One of `dx` and `dy` must not be 0.
    """
    if abs(dx) < abs(dy):
        return tuple((x, y) for y, x in short_line(dy, dx))
    if dx < 0:
        return tuple((dx + x, dy + y) for x, y in ((0, 0), *short_line(-dx, -dy)[:-1]))
    return tuple((x, (2 * x * dy + dx) // (2 * dx)) for x in range(1, dx + 1))


def clip_line(
    a0: int, b0: int, a1: int, b1: int, a_size: int, b_size: int
) -> tuple[int, int, int, int, int, int]:
    """Clip the line from (a0, b0) to (a1, b1) to the canvas; a1 - a0 >= |b1 - b0|.

    Dot i of the line is at a0 + i, b0 + floor((2 i rise + n) / 2 n), with n = a1 - a0. Return the
    first visible a and b, the error there, the number of visible dots, the increase of the error
    for each dot, and its limit. b steps when the error leaves 0 .. limit - 1.
    """
    n, rise = a1 - a0, b1 - b0
    if n == 0:
        inside = 0 <= a0 < a_size and 0 <= b0 < b_size
        return (a0, b0, 0, 1, 0, 1) if inside else OFF_CANVAS
    low, high = max(0, -a0), min(n, a_size - 1 - a0)
    below, above = -(2 * b0 + 1) * n, (2 * (b_size - b0) - 1) * n - 1
    if rise > 0:
        low, high = max(low, -(-below // (2 * rise))), min(high, above // (2 * rise))
    elif rise < 0:
        low, high = max(low, -(above // (-2 * rise))), min(high, -below // (-2 * rise))
    elif not 0 <= b0 < b_size:
        return OFF_CANVAS
    if low > high:
        return OFF_CANVAS
    steps, error = divmod(2 * low * rise + n, 2 * n)
    return a0 + low, b0 + steps, error, high - low + 1, 2 * rise, 2 * n
