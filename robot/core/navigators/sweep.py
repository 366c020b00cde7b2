"""Sweeps over closed sectors: find the smallest turn to an open heading, and the room beyond.

Headings and turns are brads: integers, 4096 to the circle.
"""

from typing import Final

from robot.core.navigators.open_headings import FREE_MM, Sectors
from robot.core.perception.echoes import CIRCLE, HALF_CIRCLE, NOTHING

STEPS: Final = 16
STEP: Final = CIRCLE // STEPS


def closer(sectors: Sectors, heading: int, halves: "list[int]") -> int:
    """Return the nearest sector that closes this heading, or NOTHING."""
    bearing, away_mm = sectors.bearing, sectors.away_mm
    nearest, least_mm = NOTHING, FREE_MM
    across, circle, half_circle = HALF_CIRCLE - heading, CIRCLE, HALF_CIRCLE
    for k in range(sectors.count):
        off, half = (bearing[k] + across) % circle - half_circle, halves[k]
        if off < half and -half < off and away_mm[k] < least_mm:
            nearest, least_mm = k, away_mm[k]
    return nearest


def closed_steps(sectors: Sectors, start: int, halves: "list[int]") -> int:
    """Return a bit for each closed heading among STEPS, the first of which is `start`.

    The same as `closer` for each of them, in one pass over the sectors.
    """
    bearing, away_mm, closed, step = sectors.bearing, sectors.away_mm, 0, STEP
    for k in range(sectors.count):
        half = halves[k]
        if half > 0 and away_mm[k] < FREE_MM:
            middle = bearing[k] - start
            before = (middle - half) // step
            inside = (middle + half - 1) // step - before
            bits = (1 << inside) - 1 << (before + 1 & STEPS - 1)
            closed |= bits | bits >> STEPS
    return closed & (1 << STEPS) - 1


def aim(sectors: Sectors, start: int, side: int) -> None:
    """Compute the turn from `start` towards `side` to the middle of each sector."""
    bearing, offset = sectors.bearing, sectors.offset
    across, circle = -side * start, CIRCLE
    for k in range(sectors.count):
        offset[k] = (side * bearing[k] + across) % circle


def sweep(sectors: Sectors, start: int, side: int, halves: "list[int]") -> int:
    """Return the turn from `start` towards `side` to an open heading; CIRCLE if there is none."""
    aim(sectors, start, side)
    return open_from(sectors, halves, 0, CIRCLE)


def open_from(sectors: Sectors, halves: "list[int]", turn: int, most: int) -> int:
    """Return the turn, from `turn` on, to an open heading; CIRCLE if there is none before `most`.

    The first pass handles the sectors in their order, once around the circle. Sectors that cover
    the heading are done; the others are checked again until none covers the next heading.
    """
    offset, low, rest = sectors.offset, sectors.low, sectors.rest
    count, closing = 0, NOTHING
    circle = CIRCLE
    for k in range(sectors.count):
        half, middle = halves[k], offset[k]
        start, end = middle - half, middle + half
        if end > circle:
            start, end = start - circle, end - circle
        if start < 0 and start + circle < most:
            most = start + circle
        if turn < end:
            if start < turn:
                turn, closing = end, k
            elif start < most:
                low[k], rest[count] = start, k
                count += 1
    before = NOTHING
    while before != turn and turn <= most:
        before, j = turn, 0
        while j < count:
            k = rest[j]
            if low[k] < turn:
                end = low[k] + 2 * halves[k]
                if turn < end:
                    turn, closing = end, k
                count -= 1
                rest[j] = rest[count]
            else:
                j += 1
    sectors.closing = closing
    return turn if turn <= most and turn < CIRCLE else CIRCLE


def room(sectors: Sectors, turn: int, halves: "list[int]") -> int:
    """Return how far headings stay open beyond the one found by the last sweep."""
    offset, least, circle = sectors.offset, HALF_CIRCLE, CIRCLE
    for k in range(sectors.count):
        half = halves[k]
        if half > 0:
            ahead = (offset[k] - half - turn) % circle
            if ahead < least:
                least = ahead
    return least
