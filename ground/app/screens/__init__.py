"""Contain the screens of the ground station, and name them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

SCREENS: Final[Mapping[str, int]] = MappingProxyType(
    {
        "drive": 1,
        "plots": 2,
        "params": 3,
        "log": 4,
        "links": 5,
        "worlds": 6,
        "faults": 7,
        "replay": 8,
    }
)
"""The names of the screens, and the numbers of their keys."""
