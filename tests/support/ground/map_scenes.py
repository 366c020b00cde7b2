"""Scenes of the map: a small room, and random ones."""

from dataclasses import replace
from math import inf, pi
from typing import Final

from hypothesis import strategies as st

from ground.map.scene import Disc, GhostTrail, MapScene, MapTarget, Outline, RobotMark, floor

ROOM: Final = MapScene(
    size_m=(6.0, 4.0),
    obstacles=(
        Outline(floor((6.0, 4.0))),
        Outline(((3.0, 1.0), (3.4, 1.0), (3.4, 3.0), (3.0, 3.0))),
    ),
    robot=RobotMark(1.9, 2.0, 0.0, 0.12),
    ranges_m=(inf, inf, None, 0.9, 0.9, inf, inf, 1.6),
    trail=((0.5, 0.5), (1.0, 1.5), (1.9, 2.0)),
    goal=MapTarget(5.2, 3.2, pi / 2.0),
    zone_m=0.3,
)

EVERYTHING: Final = replace(
    ROOM,
    obstacles=(),
    truth=False,
    seen=((2.9, 1.0), (2.9, 1.2), (2.9, 1.4)),
    seen_late=((3.1, 1.0), (3.1, 1.2)),
    seen_old=((3.3, 1.0), (3.3, 1.2)),
    true_robot=RobotMark(2.2, 2.2, 0.1, 0.12),
    covariance=(0.05, 0.02, 0.03),
    virtual_goal=(2.0, 3.4),
    hits=((1.2, 1.6),),
    leaves=((1.6, 1.2),),
    fence=Disc(3.0, 2.0, 1.9),
    mission=(MapTarget(0.6, 0.6), MapTarget(4.4, 0.8, 0.0, 0.3)),
    current=1,
    draft=(MapTarget(2.4, 0.4), MapTarget(5.6, 0.4, pi / 2.0)),
    movers=(Disc(4.0, 2.6, 0.3),),
    others=(RobotMark(5.2, 1.6, pi, 0.12, name="r2"),),
    ghosts=(GhostTrail("bug", ((0.5, 0.5), (2.5, 0.6)), "stuck"),),
    cursor=(0.4, 3.6),
    note="t 12 s",
)


ANY = st.floats(allow_nan=True, allow_infinity=True)
POINTS = st.tuples(ANY, ANY)
MANY = st.lists(POINTS, max_size=4).map(tuple)
SHAPES = st.builds(Outline, MANY, st.booleans()) | st.builds(Disc, ANY, ANY, ANY)
ROBOTS = st.builds(RobotMark, ANY, ANY, ANY, ANY, st.text(max_size=5))
TARGETS = st.builds(MapTarget, ANY, ANY, st.none() | ANY, ANY)
SCENES = st.builds(
    MapScene,
    size_m=st.none() | POINTS,
    obstacles=st.lists(SHAPES, max_size=3).map(tuple),
    truth=st.booleans(),
    seen=MANY,
    trail=MANY,
    robot=st.none() | ROBOTS,
    live=st.booleans(),
    covariance=st.none() | st.tuples(ANY, ANY, ANY),
    ranges_m=st.lists(st.none() | ANY, max_size=8),
    zone_m=st.none() | ANY,
    goal=st.none() | TARGETS,
    virtual_goal=st.none() | POINTS,
    hits=MANY,
    leaves=MANY,
    fence=st.none() | SHAPES,
    mission=st.lists(TARGETS, max_size=3),
    current=st.none() | st.integers(),
    draft=st.lists(TARGETS, max_size=3),
    movers=st.lists(st.builds(Disc, ANY, ANY, ANY), max_size=2),
    others=st.lists(ROBOTS, max_size=2),
    ghosts=st.lists(
        st.builds(GhostTrail, st.text(max_size=5), MANY, st.text(max_size=5)), max_size=2
    ),
    cursor=st.none() | POINTS,
    note=st.text(max_size=5),
)
