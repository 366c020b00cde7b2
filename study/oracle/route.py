"""Shortest route over cells of different cost: A* with whole numbers, eight neighbours."""

from heapq import heappop, heappush
from typing import Final

STRAIGHT: Final = 5
DIAGONAL: Final = 7
INDEX_BITS: Final = 24
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
    end_x, end_y = end % width, end // width
    best = [FARTHEST] * len(cost)
    before = [0] * len(cost)
    done = bytearray(len(cost))
    steps = (
        *((1, STRAIGHT), (-1, STRAIGHT), (width, STRAIGHT), (-width, STRAIGHT)),
        *((width + 1, DIAGONAL), (width - 1, DIAGONAL)),
        *((1 - width, DIAGONAL), (-1 - width, DIAGONAL)),
    )
    best[start] = 0
    waiting = [start]
    mask = (1 << INDEX_BITS) - 1
    while waiting:
        here = heappop(waiting) & mask
        if done[here]:
            continue
        done[here] = 1
        if here == end:
            return way_of(before, start, end)
        gone = best[here]
        for step, length in steps:
            there = here + step
            each = cost[there]
            if each == 0 or done[there]:
                continue
            through = gone + length * each
            if through < best[there]:
                best[there] = through
                before[there] = here
                dx, dy = there % width - end_x, there // width - end_y
                if dx < 0:
                    dx = -dx
                if dy < 0:
                    dy = -dy
                rest = STRAIGHT * dx + 2 * dy if dx > dy else STRAIGHT * dy + 2 * dx
                total = DONE * through + AHEAD * rest * least
                heappush(waiting, (total << INDEX_BITS) + there)
    return []


def way_of(before: list[int], start: int, end: int) -> list[int]:
    """Return the cells from start to end."""
    way = [end]
    while way[-1] != start:
        way.append(before[way[-1]])
    way.reverse()
    return way
