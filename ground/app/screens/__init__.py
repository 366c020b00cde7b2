"""Contain the screens of the ground station, and name them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from ground.console import app_commands

SCREENS: Final[Mapping[str, int]] = MappingProxyType(
    {name: number for number, name in enumerate(app_commands.SCREENS, start=1)}
)
"""The names of the screens, and the numbers of their keys."""
