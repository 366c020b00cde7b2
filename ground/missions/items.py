"""Convert items of `.plan` and `.waypoints` files to waypoints and back.

A yaw of 0 is what every program writes for "none": it is read as any heading, and north is written
as 360.
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from math import isfinite, isnan, nan
from types import MappingProxyType
from typing import Final, NamedTuple

import msgspec

from ground.missions.geography import heading_of, on_the_wire, to_global, to_local, yaw_of
from ground.missions.mission import Home, Waypoint
from protocol.wire.enums import (
    FRAME_GLOBAL,
    FRAME_GLOBAL_INT,
    FRAME_GLOBAL_RELATIVE_ALT,
    FRAME_GLOBAL_RELATIVE_ALT_INT,
    FRAME_GLOBAL_TERRAIN_ALT,
    FRAME_GLOBAL_TERRAIN_ALT_INT,
    FRAME_LOCAL_ENU,
    FRAME_LOCAL_FLU,
    Command,
)
from runtime.config import parse
from runtime.errors import ConfigError, UserError

GLOBAL_FRAMES: Final = (
    FRAME_GLOBAL,
    FRAME_GLOBAL_RELATIVE_ALT,
    FRAME_GLOBAL_INT,
    FRAME_GLOBAL_RELATIVE_ALT_INT,
    FRAME_GLOBAL_TERRAIN_ALT,
    FRAME_GLOBAL_TERRAIN_ALT_INT,
)
LOCAL_FRAMES: Final = (FRAME_LOCAL_ENU, FRAME_LOCAL_FLU)
DIGITS: Final = 6
NAMES: Final[Mapping[int, str]] = MappingProxyType(
    {
        17: "loiter for ever",
        18: "loiter in circles",
        19: "loiter for a time",
        20: "return to launch",
        21: "land",
        22: "take off",
        82: "spline waypoint",
        92: "enable guided mode",
        93: "delay",
        112: "wait a time",
        114: "wait for a distance",
        115: "turn to a yaw",
        177: "jump",
        178: "change speed",
        179: "set home",
        183: "set servo",
        189: "start of landing",
        195: "region of interest",
        201: "region of interest",
        203: "trigger the camera",
        205: "turn the gimbal",
        206: "trigger the camera by distance",
        211: "gripper",
        2000: "take pictures",
        2500: "take video",
    }
)


class Item(NamedTuple):
    """One item; `number` as counted in its file, `params` are MAVLink's seven."""

    number: int
    command: int
    frame: int
    params: tuple[float, ...]


class ItemPart(IntEnum):
    """The part of an item that the robot cannot execute."""

    COMMAND = 0
    PARAM1 = 1
    PARAM2 = 2
    PARAM3 = 3
    PARAM4 = 4
    PARAM5 = 5
    PARAM6 = 6
    PARAM7 = 7
    FRAME = 8
    SHAPE = 9  # of a fence


PARTS: Final = MappingProxyType(
    {
        "hold_s": ItemPart.PARAM1,
        "position_tolerance_m": ItemPart.PARAM2,
        "heading_tolerance_deg": ItemPart.PARAM3,
        "heading_deg": ItemPart.PARAM4,
        "x_m": ItemPart.PARAM5,
        "y_m": ItemPart.PARAM6,
    }
)
"""The parameter of the item for each key of a waypoint."""


class UnsupportedItemError(UserError):
    """The robot cannot execute this item, because of a `part` of it."""

    def __init__(self, words: str, part: ItemPart = ItemPart.COMMAND) -> None:
        super().__init__(words)
        self.part = part


def waypoint_of(item: Item, home: Home | None) -> Waypoint:
    """Return the waypoint of an item; UnsupportedItemError gives the reason if there is none."""
    if item.command not in (Command.NAV_WAYPOINT, Command.SIDESTEP_NAV_POSE):
        name = NAMES.get(item.command, "unknown")
        raise UnsupportedItemError(
            f"command {item.command} ({name}): the robot only drives to waypoints"
        )
    if len(item.params) != 7:
        raise UnsupportedItemError(f"has {len(item.params)} parameters, an item has 7")
    x_m, y_m = place_in(item, home)
    hold_s, second, third, angle_deg = item.params[:4]
    posed = item.command == Command.SIDESTEP_NAV_POSE
    if not posed and third and isfinite(third):
        raise UnsupportedItemError(
            f"param3 {third:g} (pass beside the waypoint): the robot drives to it", ItemPart.PARAM3
        )
    table: dict[str, float] = {"x_m": x_m, "y_m": y_m, "hold_s": _number(hold_s)}
    if second and isfinite(second):
        table["position_tolerance_m"] = _number(second)
    if posed and third and isfinite(third):
        table["heading_tolerance_deg"] = _number(third)
    if posed and not isnan(angle_deg):
        table["heading_deg"] = _number(angle_deg)
    elif not posed and angle_deg and not isnan(angle_deg):
        table["heading_deg"] = _number(heading_of(angle_deg))
    return _checked(table)


def _checked(table: dict[str, float]) -> Waypoint:
    try:
        return parse(table, Waypoint, file="")
    except ConfigError as error:
        value = table.get(error.key)
        shown_value = "" if value is None else f" {value:g}"
        words, part = f"{error.key}{shown_value}: {error.reason}", PARTS[error.key]
        raise UnsupportedItemError(words, part) from error


def place_in(item: Item, home: Home | None) -> tuple[float, float]:
    """Return the x and y of an item; UnsupportedItemError if its position is missing or invalid."""
    first, second = item.params[4:6]
    if not (isfinite(first) and isfinite(second)):
        part = ItemPart.PARAM6 if isfinite(first) else ItemPart.PARAM5
        raise UnsupportedItemError("has no place", part)
    if item.frame in LOCAL_FRAMES:
        return on_the_wire(first), on_the_wire(second)
    if item.frame not in GLOBAL_FRAMES:
        raise UnsupportedItemError(
            f"frame {item.frame}: use a global one, or local east-north-up (4)", ItemPart.FRAME
        )
    if not first and not second:
        words = "latitude and longitude are 0: it has no place of its own"
        raise UnsupportedItemError(words, ItemPart.PARAM5)
    if home is None:
        words = "latitude and longitude need a home: --home LATITUDE LONGITUDE"
        raise UnsupportedItemError(words, ItemPart.FRAME)
    if abs(first) > 90.0 or abs(second) > 180.0:
        words = f"({first:g}, {second:g}) is not a latitude and longitude"
        raise UnsupportedItemError(words, ItemPart.PARAM5 if abs(first) > 90 else ItemPart.PARAM6)
    return to_local(home, first, second)


def _number(value: float) -> float:
    """Round off the remains of single precision and of angle conversion."""
    return round(value, DIGITS)


def item_of(number: int, waypoint: Waypoint, home: Home) -> Item:
    """Return a NAV_WAYPOINT, which every program understands."""
    yaw_deg = nan if waypoint.heading_deg is None else round(yaw_of(waypoint.heading_deg), DIGITS)
    place = to_global(home, waypoint.x_m, waypoint.y_m)
    first = (waypoint.hold_s, waypoint.position_tolerance_m, 0.0, yaw_deg)
    return Item(number, Command.NAV_WAYPOINT, FRAME_GLOBAL_RELATIVE_ALT, (*first, *place, 0.0))


def home_at(latitude_deg: float, longitude_deg: float) -> Home:
    """Return a home; UserError when its latitude or longitude is out of range."""
    try:
        return msgspec.convert({"latitude_deg": latitude_deg, "longitude_deg": longitude_deg}, Home)
    except msgspec.ValidationError as error:
        why = "latitude -85 to 85 and longitude -180 to 180"
        raise UserError(f"no home at ({latitude_deg:g}, {longitude_deg:g}): {why}") from error


def lost(waypoints: Sequence[Waypoint]) -> list[str]:
    """Return what a NAV_WAYPOINT cannot hold, in words."""
    usual = Waypoint(x_m=0.0, y_m=0.0).heading_tolerance_deg
    listed = enumerate(waypoints, start=1)
    numbers = [at for at, one in listed if one.heading_tolerance_deg != usual]
    return [f"the heading tolerance of waypoint {at}" for at in numbers]
