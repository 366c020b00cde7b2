"""Random scenes for property tests."""

from hypothesis import strategies as st

from ground.map.scene import Disc, GhostTrail, MapScene, MapTarget, Outline, RobotMark

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
