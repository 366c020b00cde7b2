"""Define the roles of what is drawn on the map.

A cell has one role: the one drawn last, in the order given here.
"""

from typing import Final

ROLES: Final = (
    "seen old",
    "seen late",
    "seen",
    "wall",
    "truth",
    "fence",
    "ghost",
    "other trail",
    "trail",
    "ellipse",
    "zone",
    "cone",
    "echo",
    "leave",
    "hit",
    "draft",
    "mission",
    "virtual",
    "goal",
    "other",
    "true robot",
    "robot",
    "dead sonar",
    "text",
    "cursor",
)
"""`wall` is an obstacle known to the robot, `truth` one that only the simulation knows."""

RANK: Final = {role: rank for rank, role in enumerate(ROLES, start=1)}
"""Rank 0 is a blank cell."""
