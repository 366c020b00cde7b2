"""Maps in the style of the Moving AI benchmarks as text: mazes, rooms and random cells."""

from collections.abc import Callable, Mapping
from typing import Final

from plant.corpus.buildings import carved
from plant.model.draws import Draws

FEWEST_CELLS: Final = 20
MAX_CELLS: Final = 32
CELL_M: Final = 0.4
FREE, BLOCKED = ".", "@"


def grid_maze(random: Draws) -> str:
    """Draw corridors one or two cells wide, with walls of one cell and few or no loops."""
    wide = random.randint(1, 2)
    columns, rows = (_count(random, wide + 1) for _ in range(2))
    doors = carved(random, columns, rows, random.choice((0.0, 0.05)))
    grid = _blocked((wide + 1) * columns + 1, (wide + 1) * rows + 1)
    for row in range(rows):
        for column in range(columns):
            left, low = column * (wide + 1) + 1, row * (wide + 1) + 1
            right = frozenset(((column, row), (column + 1, row))) in doors
            up = frozenset(((column, row), (column, row + 1))) in doors
            _clear(grid, left, low, wide + right, wide)
            _clear(grid, left, low, wide, wide + up)
    return _text(grid)


def grid_rooms(random: Draws) -> str:
    """Draw rooms of 3 to 7 cells a side with doors of one cell."""
    side = random.randint(3, 7)
    columns, rows = (_count(random, side + 1) for _ in range(2))
    doors = carved(random, columns, rows, 0.3)
    grid = _blocked((side + 1) * columns + 1, (side + 1) * rows + 1)
    for row in range(rows):
        for column in range(columns):
            left, low = column * (side + 1) + 1, row * (side + 1) + 1
            _clear(grid, left, low, side, side)
            if frozenset(((column, row), (column + 1, row))) in doors:
                _clear(grid, left + side, low + random.randrange(side), 1, 1)
            if frozenset(((column, row), (column, row + 1))) in doors:
                _clear(grid, left + random.randrange(side), low + side, 1, 1)
    return _text(grid)


def grid_random(random: Draws) -> str:
    """Draw 10 to 35 % blocked cells."""
    columns, rows = _side(random), _side(random)
    share = random.uniform(0.10, 0.35)
    cells = [BLOCKED] * round(share * columns * rows)
    cells += [FREE] * (columns * rows - len(cells))
    random.shuffle(cells)
    return _text([cells[row * columns : (row + 1) * columns] for row in range(rows)])


MAPS: Final[Mapping[str, Callable[[Draws], str]]] = {
    "grid_maze": grid_maze,
    "grid_rooms": grid_rooms,
    "grid_random": grid_random,
}


def _side(random: Draws) -> int:
    return random.randint(FEWEST_CELLS, MAX_CELLS)


def _count(random: Draws, pitch: int) -> int:
    """Draw the number of cells of a side: a multiple of the pitch, and a last wall."""
    return random.randint(-(-(FEWEST_CELLS - 1) // pitch), (MAX_CELLS - 1) // pitch)


def _blocked(columns: int, rows: int) -> list[list[str]]:
    return [[BLOCKED] * columns for _ in range(rows)]


def _clear(grid: list[list[str]], left: int, low: int, columns: int, rows: int) -> None:
    for row in grid[low : low + rows]:
        row[left : left + columns] = [FREE] * columns


def _text(grid: list[list[str]]) -> str:
    head = ["type octile", f"height {len(grid)}", f"width {len(grid[0])}", "map"]
    return "\n".join([*head, *("".join(row) for row in grid)]) + "\n"
