"""The search for the cheapest route."""

from study.oracle.grid_map import search_route

WIDTH = 12


def plain(*blocked: int) -> bytearray:
    cost = bytearray([4] * WIDTH * WIDTH)
    for k in range(WIDTH):
        for rim in (k, WIDTH * (WIDTH - 1) + k, k * WIDTH, k * WIDTH + WIDTH - 1):
            cost[rim] = 0
    for cell in blocked:
        cost[cell] = 0
    return cost


def test_route_in_the_open_is_straight() -> None:
    start = 5 * WIDTH + 2
    assert search_route(plain(), WIDTH, start, start + 6, 4) == list(range(start, start + 7))


def test_route_leads_round_a_wall() -> None:
    wall = [row * WIDTH + 6 for row in range(1, 9)]
    found = search_route(plain(*wall), WIDTH, 5 * WIDTH + 3, 5 * WIDTH + 9, 4)
    assert 9 * WIDTH + 6 in found
    assert not set(found) & set(wall)


def test_there_is_no_route_through_a_closed_wall() -> None:
    wall = [row * WIDTH + 6 for row in range(WIDTH)]
    assert search_route(plain(*wall), WIDTH, 5 * WIDTH + 3, 5 * WIDTH + 9, 4) == []


def test_dear_cells_are_passed_by_if_that_costs_less() -> None:
    cost = plain()
    for row in range(3, 8):
        cost[row * WIDTH + 6] = 100
    found = search_route(cost, WIDTH, 5 * WIDTH + 3, 5 * WIDTH + 9, 4)
    assert not {row * WIDTH + 6 for row in range(3, 8)} & set(found)


def test_start_may_be_the_end() -> None:
    assert search_route(plain(), WIDTH, 5 * WIDTH + 3, 5 * WIDTH + 3, 4) == [5 * WIDTH + 3]
