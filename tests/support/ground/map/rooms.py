"""Scenes of a small room: a plain one, and one with everything."""

from dataclasses import replace
from math import inf, pi
from typing import Final

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
