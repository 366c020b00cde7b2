"""Missions of any kind, for property tests: places on the wire's grid of 0.1 mm."""

from collections.abc import Callable
from math import cos, pi, sin

from hypothesis import strategies as st

from ground.missions.mission import Circle, Fence, Home, Mission, Polygon, Waypoint
from runtime.errors import UserError

FAR_TENTHS = 2_000_000_000
metres = st.integers(-FAR_TENTHS, FAR_TENTHS).map(lambda tenths: tenths / 1e4)
near = st.integers(-500_000, 500_000).map(lambda tenths: tenths / 1e4)
homes = st.builds(
    Home,
    latitude_deg=st.floats(-80.0, 80.0).filter(lambda value: abs(value) > 1e-6),
    longitude_deg=st.floats(-180.0, 180.0),
)


def thousandths(low: int, high: int) -> st.SearchStrategy[float]:
    return st.integers(low, high).map(lambda value: value / 1000)


def waypoints(tolerances: st.SearchStrategy[float]) -> st.SearchStrategy[Waypoint]:
    return st.builds(
        Waypoint,
        x_m=metres,
        y_m=metres,
        heading_deg=st.none() | thousandths(-359_999, 360_000),
        position_tolerance_m=thousandths(5, 1000),
        heading_tolerance_deg=tolerances,
        hold_s=thousandths(0, 86_400_000),
    )


@st.composite
def polygons(draw: st.DrawFn) -> Polygon:
    """Corners round a place, in order."""
    count = draw(st.integers(3, 12))
    x_m, y_m, radius_m = draw(near), draw(near), draw(st.floats(1.0, 50.0))
    turns = [2 * pi * at / count for at in range(count)]
    places = [(x_m + radius_m * cos(turn), y_m + radius_m * sin(turn)) for turn in turns]
    return Polygon(corners=tuple((round(x, 4), round(y, 4)) for x, y in places))


circles = st.builds(Circle, x_m=metres, y_m=metres, radius_m=thousandths(1, 100_000))
fences: st.SearchStrategy[Fence] = circles | polygons()


def missions(
    home: st.SearchStrategy[Home | None], tolerances: st.SearchStrategy[float]
) -> st.SearchStrategy[Mission]:
    listed = st.lists(waypoints(tolerances), min_size=1, max_size=8)
    return st.builds(Mission, waypoints=listed.map(tuple), fence=st.none() | fences, home=home)


def refusal_of(read: Callable[[], object]) -> str:
    """Why it was refused; empty when it was not."""
    try:
        read()
    except UserError as error:
        return str(error)
    return ""
