"""Shortest route over cells of different cost: A* with whole numbers, eight neighbours."""

from heapq import heappop, heappush
from typing import Final

STRAIGHT: Final = 5
DIAGONAL: Final = 7
INDEX_BITS: Final = 24
INDEX: Final = (1 << INDEX_BITS) - 1
FARTHEST: Final = 1 << 40
DONE: Final = 256
AHEAD: Final = 257
"""Weights of the cost so far and of that ahead: of equal sums the one nearer to the end is first.

So a route may cost 1/256 more than the cheapest one.
"""


def search(cost: bytearray, width: int, start: int, end: int, least: int) -> list[int]:
    """Return the cells of the cheapest route with both ends; empty if there is none.

    A step costs its length times `cost` of the cell it enters, which is at least `least`; 0 is
    blocked. The cells of the rim must be blocked. The number of cells must be below 2^24.
    """
    columns, rows = away(width, end % width), away(len(cost) // width, end // width)
    steps = steps_of(width)
    best, before = [FARTHEST] * len(cost), [0] * len(cost)
    done = bytearray(len(cost))
    best[start] = 0
    waiting = [start]
    while waiting:
        here = heappop(waiting) & INDEX
        if done[here]:
            continue
        done[here] = 1
        if here == end:
            return way_of(before, start, end)
        gone = best[here]
        for step, length in steps:
            there = here + step
            each = cost[there]
            through = gone + length * each
            if each == 0 or through >= best[there]:
                continue
            best[there], before[there] = through, here
            dx, dy = columns[there % width], rows[there // width]
            rest = STRAIGHT * dx + 2 * dy if dx > dy else STRAIGHT * dy + 2 * dx
            total = DONE * through + AHEAD * rest * least
            heappush(waiting, (total << INDEX_BITS) + there)
    return []


def away(count: int, end: int) -> list[int]:
    """Return how far each column or row is from that of the end."""
    return [abs(place - end) for place in range(count)]


def steps_of(width: int) -> tuple[tuple[int, int], ...]:
    """Return the steps to the eight neighbours in rows of `width`, each with its length."""
    return (
        *((1, STRAIGHT), (-1, STRAIGHT), (width, STRAIGHT), (-width, STRAIGHT)),
        *((width + 1, DIAGONAL), (width - 1, DIAGONAL)),
        *((1 - width, DIAGONAL), (-1 - width, DIAGONAL)),
    )


def way_of(before: list[int], start: int, end: int) -> list[int]:
    """Return the cells from start to end."""
    way = [end]
    while way[-1] != start:
        way.append(before[way[-1]])
    way.reverse()
    return way
