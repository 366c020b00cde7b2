"""What ink on the map means. A cell has one role: the one drawn last, in the order given here."""

from typing import Final

ROLES: Final = (
    "seen",
    "wall",
    "truth",
    "fence",
    "ghost",
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
    "robot",
    "text",
    "cursor",
)
"""`wall` is known to stand there, `truth` is what only the simulation knows."""

RANK: Final = {role: rank for rank, role in enumerate(ROLES, start=1)}
"""Rank 0 is paper."""
