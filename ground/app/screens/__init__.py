"""Contain the screens of the ground station, each imported when it is first shown."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from ground.app.playback.app_interface import AppInterface
    from ground.app.screens.app_screen import AppScreen

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


def screen_of(name: str, interface: "AppInterface") -> "AppScreen":
    """Return a new screen by its name: `params` is ParamsScreen in the module params."""
    module = import_module(f"ground.app.screens.{name}")
    screen: AppScreen = getattr(module, f"{name.capitalize()}Screen")(interface)
    return screen
