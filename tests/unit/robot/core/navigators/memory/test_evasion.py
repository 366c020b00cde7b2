"""Evade people whose places and velocities are known."""

from math import cos, hypot, inf, sin

from hypothesis import given
from hypothesis import strategies as st

from robot.core.navigators import evasion
from robot.core.navigators.evasion import Evasion
from robot.core.navigators.open_headings import Sectors
from robot.core.parameters import DEFAULTS
from robot.core.perception.echoes import BRADS, HALF_CIRCLE, QUARTER
from robot.core.perception.people import MAX_LEFT, MAX_PEOPLE, PROVEN, People
from robot.core.values import Pose
from tests.support.each import each

HERE = Pose(0.0, 0.0, 0.0)
places, speeds = st.floats(-1.5, 1.5), st.floats(-0.4, 0.4)


def people_of(*each: tuple[float, float, float, float]) -> People:
    """Return proven people: x_m, y_m and velocity of each."""
    people = People()
    for k, (x_m, y_m, vx_m_s, vy_m_s) in enumerate(each):
        people.x_m[k], people.y_m[k] = x_m, y_m
        people.vx_m_s[k], people.vy_m_s[k] = vx_m_s, vy_m_s
        people.left[k], people.proof[k] = MAX_LEFT, PROVEN
        people.any = True
    return people


def chosen(people: People, wanted: int = 0, e: "Evasion | None" = None) -> int:
    return evasion.choose(e or Evasion(), people, Sectors(), wanted, HERE, DEFAULTS)


def least_gap_m(person: tuple[float, float, float, float], heading: int) -> float:
    """Return the gap of the closest approach in 3 s, turning on the spot at 2.2 rad/s first."""
    x_m, y_m, vx_m_s, vy_m_s = person
    turn_s, gaps = abs(heading) / BRADS / 2.2, []
    for tick in range(10, 61):
        way_m = 0.3 * max(0.0, 0.05 * tick - turn_s)
        dx_m = x_m + 0.05 * tick * vx_m_s - way_m * cos(heading / BRADS)
        dy_m = y_m + 0.05 * tick * vy_m_s - way_m * sin(heading / BRADS)
        gaps.append(hypot(dx_m, dy_m) - 0.32)
    return min(gaps)


def test_heading_is_kept_without_people() -> None:
    assert chosen(People(), 700) == 700


@each(
    "person",
    [(-0.6, 0.0, 0.1, 0.0), (0.8, 0.6, 0.1, 0.1), (0.0, 1.0, 0.0, -0.05), (2.0, 0.0, -0.2, 0.0)],
)
def test_heading_is_kept_if_the_person_stays_away(
    person: tuple[float, float, float, float],
) -> None:
    e = Evasion()
    assert chosen(people_of(person), 0, e) == 0
    assert (e.active, e.most_m_s) == (False, inf)


@each(
    "person",
    [(1.1, 0.1, -0.15, 0.0), (0.9, 0.5, 0.0, -0.15), (0.4, -0.5, 0.05, 0.15)],
)
def test_robot_leaves_the_line_of_a_person(person: tuple[float, float, float, float]) -> None:
    e = Evasion()
    heading = chosen(people_of(person), 0, e)
    assert e.active
    if e.most_m_s == inf:
        assert least_gap_m(person, heading) > least_gap_m(person, 0)


def test_person_that_has_not_proved_to_move_is_ignored() -> None:
    people = people_of((1.1, 0.1, -0.15, 0.0))
    people.proof[0] = PROVEN - 1
    assert chosen(people) == 0


def test_choice_is_kept_while_it_is_as_good() -> None:
    e, people = Evasion(), people_of((1.0, 0.0, -0.15, 0.0))
    first = chosen(people, 0, e)
    assert first != 0
    people.y_m[0] = 0.01 if first > 0 else -0.01
    assert chosen(people, 0, e) == first


def test_closed_headings_are_avoided() -> None:
    people, sectors = people_of((1.0, 0.02, -0.15, 0.0)), Sectors()
    free = chosen(people)
    sectors.count, sectors.point[0], sectors.away_mm[0] = 1, 0, 200
    sectors.bearing[0], sectors.tight[0] = free, QUARTER // 2
    other = evasion.choose(Evasion(), people, sectors, 0, HERE, DEFAULTS)
    assert abs(other - free) >= QUARTER // 2


def test_robot_waits_where_no_other_way_is_open() -> None:
    e, sectors = Evasion(), Sectors()
    sectors.count, sectors.point[0], sectors.away_mm[0] = 1, 0, 200
    sectors.bearing[0], sectors.tight[0] = HALF_CIRCLE, HALF_CIRCLE - 100
    people = people_of((0.75, 0.6, 0.0, -0.2))
    assert evasion.choose(e, people, sectors, 0, HERE, DEFAULTS) == 0
    assert e.active
    assert e.most_m_s == 0.0


@given(
    st.lists(st.tuples(places, places, speeds, speeds), min_size=1, max_size=MAX_PEOPLE),
    st.integers(-HALF_CIRCLE, HALF_CIRCLE),
    st.floats(0.0, 4.0),
    st.floats(0.0, 12.0),
)
def test_risk_that_ends_early_is_high_enough(
    persons: list[tuple[float, float, float, float]], heading: int, cost: float, least: float
) -> None:
    people, near = people_of(*persons), (1 << len(persons)) - 1
    speed_m_s = DEFAULTS.v_max_m_s
    whole = evasion.risk(people, near, heading, HERE, speed_m_s, DEFAULTS)
    found = evasion.risk(people, near, heading, HERE, speed_m_s, DEFAULTS, cost, least)
    assert found <= whole
    assert found == whole or cost + evasion.PASS_COST * found >= least
