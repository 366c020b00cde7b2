"""The screens of the ground station, one per file; each is imported when it is first shown."""

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
"""By name, with the number of its key."""


def screen_of(name: str, interface: "AppInterface") -> "AppScreen":
    """The screen of that name: `params` is ParamsScreen in its own module."""
    module = import_module(f"ground.app.screens.{name}")
    sheet: AppScreen = getattr(module, f"{name.capitalize()}Screen")(interface)
    return sheet
