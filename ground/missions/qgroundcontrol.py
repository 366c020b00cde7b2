"""Read and write QGroundControl's files: `.plan` (JSON) and `.waypoints` (lines of numbers).

Sources: docs.qgroundcontrol.com, "Plan File Format", version 1; mavlink.io, "File Formats". Item 0
of `.waypoints` is home, as in Mission Planner and ArduPilot. Unsupported items are rejected or
dropped. A yaw of 0 is what every program writes for "none": it is read as any heading, and north is
written as 360. Items that were read are written again as they were, in every field.

x points east and y north in the plane that touches the WGS 84 ellipsoid at the home. A place on
Earth is the point of the ellipsoid below or above a point of that plane (EPSG method 9840, the
orthographic projection), so both maps are exact: over 1 km they differ from distances on the ground
by less than 0.1 mm. The error of both conversions together is far less than the 0.1 mm of the wire
format.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from enum import IntEnum
from functools import lru_cache
from math import atan2, cos, degrees, hypot, isfinite, isnan, nan, radians, sin, sqrt
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar

import msgspec

from ground.missions.mission import (
    LOOSEST_M,
    Circle,
    Fence,
    Home,
    MavlinkItem,
    Mission,
    MissionError,
    Outline,
    Polygon,
    Problem,
    Step,
    Waypoint,
    fault_of,
    fence_with,
    zones_of,
)
from protocol.wire.enums import (
    FRAME_GLOBAL,
    FRAME_GLOBAL_INT,
    FRAME_GLOBAL_RELATIVE_ALT,
    FRAME_GLOBAL_RELATIVE_ALT_INT,
    FRAME_GLOBAL_TERRAIN_ALT,
    FRAME_GLOBAL_TERRAIN_ALT_INT,
    FRAME_LOCAL_ENU,
    FRAME_LOCAL_FLU,
    TYPE_GROUND_ROVER,
    Command,
)
from protocol.wire.limits import PLACES_PER_M
from runtime.config import parse
from runtime.errors import ConfigError, UserError, not_a_number
from runtime.files import value_in

SEMI_MAJOR_M: Final = 6_378_137.0
FLATTENING: Final = 1 / 298.257223563
ECCENTRICITY_2: Final = FLATTENING * (2 - FLATTENING)
NEAR_COSINE: Final = cos(radians(5.0))
"""A position more than 5 degrees from its home has no exact metres, only an approximate
distance."""


class Plane(NamedTuple):
    """The plane at a home: sine and cosine of its latitude, and its radius of curvature east."""

    sine: float
    cosine: float
    radius_m: float


@lru_cache(maxsize=16)
def _plane(latitude_deg: float) -> Plane:
    latitude = radians(latitude_deg)
    sine = sin(latitude)
    return Plane(sine, cos(latitude), SEMI_MAJOR_M / sqrt(1 - ECCENTRICITY_2 * sine * sine))


def to_local(home: Home, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return x and y in metres.

    A position more than 5 degrees away has an approximate distance, far beyond the limit of a
    mission.
    """
    plane, place = _plane(home.latitude_deg), _plane(latitude_deg)
    east_deg = (longitude_deg - home.longitude_deg + 180.0) % 360.0 - 180.0
    turn = cos(radians(east_deg))
    if place.sine * plane.sine + place.cosine * plane.cosine * turn < NEAR_COSINE:
        north_m = SEMI_MAJOR_M * radians(latitude_deg - home.latitude_deg)
        return on_the_wire(SEMI_MAJOR_M * radians(east_deg) * plane.cosine), on_the_wire(north_m)
    x_m = place.radius_m * place.cosine * sin(radians(east_deg))
    polar_m = (1 - ECCENTRICITY_2) * (place.radius_m * place.sine - plane.radius_m * plane.sine)
    # The difference of the distances from the axis, in a form without cancellation near the home.
    half = sin(radians(east_deg / 2))
    outward_m = place.radius_m * place.cosine - plane.radius_m * plane.cosine
    outward_m -= 2 * place.radius_m * place.cosine * half * half
    return on_the_wire(x_m), on_the_wire(polar_m * plane.cosine - outward_m * plane.sine)


def to_global(home: Home, x_m: float, y_m: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees; x and y are at most FARTHEST_M."""
    plane = _plane(home.latitude_deg)
    drop_m = _drop(plane, x_m, y_m)
    outward_m = plane.radius_m * plane.cosine - y_m * plane.sine - drop_m * plane.cosine
    polar_m = (1 - ECCENTRICITY_2) * plane.radius_m * plane.sine
    polar_m += y_m * plane.cosine - drop_m * plane.sine
    axis_m = hypot(outward_m, x_m)
    latitude_deg = degrees(atan2(polar_m, (1 - ECCENTRICITY_2) * axis_m))
    longitude_deg = home.longitude_deg + degrees(atan2(x_m, outward_m))
    return latitude_deg, (longitude_deg + 180.0) % 360.0 - 180.0


def _drop(plane: Plane, x_m: float, y_m: float) -> float:
    """Return the depth of the ellipsoid below a point of the plane.

    With the ellipsoid as X^2 + Y^2 + Z^2 / (1 - e^2) = a^2, the depth solves the quadratic equation
    square * depth^2 - 2 * slope * depth + gap = 0; the smaller root is the near side.
    """
    stretch = 1 / (1 - ECCENTRICITY_2)
    square = plane.cosine * plane.cosine + plane.sine * plane.sine * stretch
    slope = plane.radius_m + y_m * plane.sine * plane.cosine * (stretch - 1)
    gap = x_m * x_m + y_m * y_m * (plane.sine * plane.sine + plane.cosine * plane.cosine * stretch)
    return gap / (slope + sqrt(slope * slope - square * gap))


def on_the_wire(metres: float) -> float:
    """Round a length to 0.1 mm, the resolution of the wire.

    A length beyond the range of the wire is returned unchanged; range checks reject it.
    """
    tenths = metres * 1e4
    return round(tenths) / 1e4 if isfinite(tenths) else metres


def heading_of(yaw_deg: float) -> float:
    """Convert a compass angle to a heading (counter-clockwise from east), -180 to 180 deg."""
    return 180.0 - (yaw_deg + 90.0) % 360.0


def yaw_of(heading_deg: float) -> float:
    """Convert a heading to a compass angle in (0, 360] deg; 0 would mean "none"."""
    return 360.0 - (heading_deg - 90.0) % 360.0


GLOBAL_FRAMES: Final = (
    FRAME_GLOBAL,
    FRAME_GLOBAL_RELATIVE_ALT,
    FRAME_GLOBAL_INT,
    FRAME_GLOBAL_RELATIVE_ALT_INT,
    FRAME_GLOBAL_TERRAIN_ALT,
    FRAME_GLOBAL_TERRAIN_ALT_INT,
)
LOCAL_FRAMES: Final = (FRAME_LOCAL_ENU, FRAME_LOCAL_FLU)
PER_DEG: Final = 10_000_000
SCALES: Final[Mapping[int, int]] = MappingProxyType(
    dict.fromkeys(GLOBAL_FRAMES, PER_DEG) | dict.fromkeys(LOCAL_FRAMES, PLACES_PER_M)
)
"""The factor of x and y in a MISSION_ITEM_INT by its frame, for the frames with a place."""
PLACED: Final = (
    Command.SIDESTEP_NAV_POSE,
    Command.NAV_WAYPOINT,
    Command.NAV_LOITER_UNLIM,
    Command.NAV_LOITER_TIME,
)
"""Commands of items with a place."""
DIGITS: Final = 6
NAMES: Final[Mapping[int, str]] = MappingProxyType(
    {
        18: "loiter in circles",
        21: "land",
        22: "take off",
        82: "spline waypoint",
        92: "enable guided mode",
        112: "wait a time",
        114: "wait for a distance",
        115: "turn to a yaw",
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


NO_HOME: Final = "latitude and longitude need a home: --home LATITUDE LONGITUDE"


class Item(NamedTuple):
    """One item; `number` as counted in its file, `params` are MAVLink's seven."""

    number: int
    command: int
    frame: int
    params: tuple[float, ...]
    autocontinue: bool = True


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


def step_of(item: Item, home: Home | None) -> Step:
    """Return the step of an item; UnsupportedItemError gives the reason if there is none."""
    check = ORDERS.get(item.command)
    if check is None and item.command not in PLACED:
        name = NAMES.get(item.command, "unknown")
        raise UnsupportedItemError(f"command {item.command} ({name}): the robot cannot do that")
    if len(item.params) != 7:
        raise UnsupportedItemError(f"has {len(item.params)} parameters, an item has 7")
    if check is None:
        return waypoint_of(item, home)
    check(*item.params[:3])
    return kept(item, item.params)


INT32: Final = 0x7FFF_FFFF
FLOAT32: Final = 3.4e38


def kept(item: Item, params: Sequence[float]) -> MavlinkItem:
    """Return an item with these parameters; each NaN is the same object, and so equals itself.

    UnsupportedItemError names a parameter that MAVLink cannot carry.
    """
    scale = SCALES.get(item.frame, 1)
    for at, value in enumerate(params, start=1):
        is_place = at in (ItemPart.PARAM5, ItemPart.PARAM6)
        if abs(value) > (INT32 / scale if is_place else FLOAT32) and (is_place or isfinite(value)):
            raise UnsupportedItemError(f"param{at} {value:g}: is out of range", ItemPart(at))
    same = tuple(nan if isnan(value) else value for value in params)
    return MavlinkItem(
        command=item.command,
        frame=item.frame,
        params=same,  # type: ignore[arg-type]
        autocontinue=item.autocontinue,
    )


def _check_delay(time_s: float, *_: float) -> None:
    if not time_s >= 0.0:
        words = f"param1 {time_s:g} (wait until a time of day): give seconds"
        raise UnsupportedItemError(words, ItemPart.PARAM1)


def _check_jump(target: float, repeats: float, *_: float) -> None:
    if not (target >= 1.0 and target.is_integer()):
        words = f"param1 {target:g}: a jump leads to an item from 1 on"
        raise UnsupportedItemError(words, ItemPart.PARAM1)
    if not (repeats >= 0.0 and repeats.is_integer()):
        words = f"param2 {repeats:g}: a jump without end is not driven, give a number of repeats"
        raise UnsupportedItemError(words, ItemPart.PARAM2)


def _check_speed(kind: float, speed_m_s: float, throttle: float) -> None:
    if kind not in (0.0, 1.0):
        words = f"param1 {kind:g}: only the ground speed can be changed (0 or 1)"
        raise UnsupportedItemError(words, ItemPart.PARAM1)
    if speed_m_s not in (-1.0, -2.0) and not speed_m_s > 0.0:
        words = f"param2 {speed_m_s:g}: is not a speed above 0 m/s"
        raise UnsupportedItemError(words, ItemPart.PARAM2)
    if throttle > 0.0:
        words = f"param3 {throttle:g} (throttle): the robot takes a speed"
        raise UnsupportedItemError(words, ItemPart.PARAM3)


def _check_return(*_: float) -> None:
    """Accept any: the parameters of a return mean nothing."""


ORDERS: Final[Mapping[int, Callable[[float, float, float], None]]] = MappingProxyType(
    {
        Command.NAV_DELAY: _check_delay,
        Command.DO_JUMP: _check_jump,
        Command.DO_CHANGE_SPEED: _check_speed,
        Command.NAV_RETURN_TO_LAUNCH: _check_return,
    }
)
"""Commands of items without a place, each with the check of its parameters."""


def waypoint_of(item: Item, home: Home | None) -> Waypoint:
    """Return the waypoint of an item with a place; UnsupportedItemError if it is not one."""
    x_m, y_m = place_in(item, home)
    if item.command != Command.SIDESTEP_NAV_POSE:
        params = (*item.params[:4], 0.0, 0.0, item.params[6])
        return waypoint_in(kept(item, params), x_m, y_m)
    hold_s, position_m, heading_deg, angle_deg = item.params[:4]
    table: dict[str, float] = {"x_m": x_m, "y_m": y_m, "hold_s": _number(hold_s)}
    if position_m and isfinite(position_m):
        table["position_tolerance_m"] = _number(position_m)
    if heading_deg and isfinite(heading_deg):
        table["heading_tolerance_deg"] = _number(heading_deg)
    if not isnan(angle_deg):
        table["heading_deg"] = _number(angle_deg)
    return _checked(table)


def waypoint_in(mavlink: MavlinkItem, x_m: float, y_m: float) -> Waypoint:
    """Return the waypoint of an item of common MAVLink; UnsupportedItemError if it is not one.

    A time to wait of NaN is none. A position within the robot's largest tolerance is also within
    every larger one, such as the 3 m of MAVSDK.
    """
    command, (hold_s, second, third, yaw_deg) = mavlink.command, mavlink.params[:4]
    table: dict[str, float] = {"x_m": x_m, "y_m": y_m}
    if command != Command.NAV_LOITER_UNLIM and not isnan(hold_s):
        table["hold_s"] = _number(hold_s)
    if command == Command.NAV_WAYPOINT:
        if third and isfinite(third):
            words = f"param3 {third:g} (pass beside the waypoint): the robot drives to it"
            raise UnsupportedItemError(words, ItemPart.PARAM3)
        if second and isfinite(second):
            table["position_tolerance_m"] = min(_number(second), LOOSEST_M)
    if command != Command.NAV_LOITER_TIME and yaw_deg and not isnan(yaw_deg):
        table["heading_deg"] = _number(heading_of(yaw_deg))
    return replace(_checked(table), mavlink=mavlink)


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
        raise UnsupportedItemError(NO_HOME, ItemPart.FRAME)
    if abs(first) > 90.0 or abs(second) > 180.0:
        words = f"({first:g}, {second:g}) is not a latitude and longitude"
        raise UnsupportedItemError(words, ItemPart.PARAM5 if abs(first) > 90 else ItemPart.PARAM6)
    return to_local(home, first, second)


def _number(value: float) -> float:
    """Round off the remains of single precision and of angle conversion."""
    return round(value, DIGITS)


def item_of(number: int, step: Step, home: Home) -> Item:
    """Return the item of a step as it was read, or a NAV_WAYPOINT, which every program knows."""
    if isinstance(step, MavlinkItem):
        return Item(number, step.command, step.frame, step.params, step.autocontinue)
    if (mavlink := step.mavlink) is None:
        yaw_deg = nan if step.heading_deg is None else round(yaw_of(step.heading_deg), DIGITS)
        first = (step.hold_s, step.position_tolerance_m, 0.0, yaw_deg)
        place = same_on_earth(home, step.x_m, step.y_m)
        return Item(number, Command.NAV_WAYPOINT, FRAME_GLOBAL_RELATIVE_ALT, (*first, *place, 0.0))
    is_local = mavlink.frame in LOCAL_FRAMES
    place = (step.x_m, step.y_m) if is_local else same_on_earth(home, step.x_m, step.y_m)
    params = (*mavlink.params[:4], *place, mavlink.params[6])
    return Item(number, mavlink.command, mavlink.frame, params, mavlink.autocontinue)


def same_on_earth(home: Home, x_m: float, y_m: float) -> tuple[float, float]:
    """Return latitude and longitude, with 7 decimals if these name the same place.

    So degrees that came by MAVLink are written as they came.
    """
    latitude_deg, longitude_deg = to_global(home, x_m, y_m)
    short = round(latitude_deg, 7), round(longitude_deg, 7)
    return short if to_local(home, *short) == (x_m, y_m) else (latitude_deg, longitude_deg)


def home_at(latitude_deg: float, longitude_deg: float, altitude_m: float = 0.0) -> Home:
    """Return a home; UserError when a value is out of range. An altitude of NaN is 0."""
    table = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg}
    table["altitude_m"] = 0.0 if isnan(altitude_m) else altitude_m
    try:
        return msgspec.convert(table, Home)
    except msgspec.ValidationError as error:
        why = "latitude -85 to 85, longitude -180 to 180 and altitude at most 100 km"
        raise UserError(f"no home at ({latitude_deg:g}, {longitude_deg:g}): {why}") from error


def lost(mission: Mission) -> list[str]:
    """Return what a NAV_WAYPOINT cannot hold, in words."""
    usual = Waypoint(x_m=0.0, y_m=0.0).heading_tolerance_deg
    numbers = [at for at, one in mission.places if one.heading_tolerance_deg != usual]
    return [f"the heading tolerance of waypoint {at}" for at in numbers]


DROP = "take it out, or use --drop to go without it"


class Foreign(NamedTuple):
    """A mission of another program's file, and what was dropped from it, in words."""

    mission: Mission
    dropped: tuple[str, ...] = ()


def target_of(step: Step) -> int | None:
    """Return the number of the item to which a step jumps, None if it does not jump."""
    if not isinstance(step, MavlinkItem) or step.command != Command.DO_JUMP:
        return None
    return int(step.params[0])


def _led(step: Step, numbers: Sequence[int]) -> Step:
    """Return a step; a jump counts its target among the items that are left."""
    target = target_of(step)
    if target is None or not isinstance(step, MavlinkItem):
        return step
    return replace(step, params=(float(numbers.index(target) + 1), *step.params[1:]))


class PlanFilter:
    """Accepts supported items and collects the others; `drop` omits those.

    `fix` is what to do about them.
    """

    def __init__(self, file: str, *, drop: bool, fix: str = DROP) -> None:
        self._file = file
        self._drop = drop
        self._fix = fix
        self._refused: list[Problem] = []
        self._left: list[str] = []

    def steps(self, items: Iterable[Item | Problem], home: Home | None) -> list[Step]:
        """Return the steps; a Problem is an item that could not be parsed.

        A jump leads to an item by its number; without the items that are dropped it is another.
        """
        found: list[tuple[int, Step]] = []
        for item in items:
            if isinstance(item, Problem):
                self._refused.append(item)
                continue
            try:
                found.append((item.number, step_of(item, home)))
            except UnsupportedItemError as error:
                self.refuse(f"item {item.number}", str(error))
        numbers = [number for number, _ in found]
        while astray := [at for at, step in found if target_of(step) not in (None, *numbers)]:
            for number in astray:
                self.refuse(f"item {number}", "jumps to an item that is not there")
            found = [one for one in found if one[0] not in astray]
            numbers = [number for number, _ in found]
        return [_led(step, numbers) for _, step in found]

    def refuse(self, where: str, reason: str) -> None:
        """Note an item or a part that is not supported."""
        self._refused.append(self.problem(where, reason))

    def problem(self, where: str, reason: str) -> Problem:
        """Return an item or a part that is not supported."""
        return Problem(where, reason, "" if self._drop else self._fix)

    def unreadable(self, where: str, error: UserError) -> MissionError:
        """Return the error for a part that cannot be read; without it the plan means another."""
        return MissionError(self._file, [Problem(where, str(error), "")])

    def leave(self, words: str) -> None:
        """Note what is left out in any case."""
        self._left.append(words)

    def check(self) -> None:
        """Raise MissionError for rejected items."""
        if self._refused and not self._drop:
            raise MissionError(self._file, self._refused)

    def result(self, mission: Mission) -> Foreign:
        """Return the mission; MissionError for rejected items or without any waypoint."""
        self.check()
        if not mission.waypoints:
            problem = Problem("", "no waypoint is left", "the mission needs at least one")
            raise MissionError(self._file, [*self._refused, problem])
        dropped = tuple(f"{problem.where}: {problem.reason}" for problem in self._refused)
        return Foreign(mission, (*dropped, *self._left))


T = TypeVar("T")
PLAN_VERSION: Final = 1
PART_VERSION: Final = 2
FIRMWARE_ARDUPILOT: Final = 3
ALTITUDE_RELATIVE: Final = 1
ALTITUDE_ABSOLUTE: Final = 2
ALTITUDE_TERRAIN: Final = 4


def read_plan(text: str, file: str, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Return the mission of a plan; `home` replaces the plan's own."""
    plan, body = _plan_of(text, file)
    home = home or _plan_home(body.get("plannedHomePosition"), file)
    sieve = PlanFilter(file, drop=drop)
    listed = body.get("items")
    items = _plan_items(listed if isinstance(listed, list) else [], sieve)
    steps = tuple(sieve.steps(items, home))
    fence = _fence(plan.get("geoFence"), home, sieve)
    points = plan.get("rallyPoints")
    if isinstance(points, dict) and points.get("points"):
        sieve.refuse("rallyPoints", "the robot does not support rally points")
    return sieve.result(Mission(waypoints=steps, fence=fence, home=home))


def read_plan_fence(text: str, file: str) -> Fence | None:
    """Return the fence of a plan, whose other parts are ignored; MissionError lists its faults."""
    plan, body = _plan_of(text, file)
    home, drawn = _plan_home(body.get("plannedHomePosition"), file), plan.get("geoFence")
    if home is None and any(_shapes(drawn)):
        problem = Problem("plannedHomePosition", "is missing", "set it in QGroundControl")
        raise MissionError(file, [problem])
    sieve = PlanFilter(file, drop=False, fix="correct it in QGroundControl")
    fence = _fence(drawn, home, sieve)
    sieve.check()
    return fence


def _plan_of(text: str, file: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a plan and its mission."""
    plan = _object(text, file)
    body = plan.get("mission")
    if plan.get("fileType") != "Plan" or not isinstance(body, dict):
        problem = Problem("fileType", "this is not a plan", "save it as a .plan in QGroundControl")
        raise MissionError(file, [problem])
    return plan, body


def _object(text: str, file: str) -> dict[str, Any]:
    try:
        plan = value_in(text)
    except ValueError as error:
        problem = Problem("", f"is not JSON: {error}", "save it again in QGroundControl")
        raise MissionError(file, [problem]) from error
    return plan if isinstance(plan, dict) else {}


def _plan_home(place: object, file: str) -> Home | None:
    try:
        numbers = _plan_numbers(place)
        if len(numbers) < 2 or not any(numbers[:2]):
            return None
        return home_at(*numbers[:3])
    except UserError as error:
        problem = Problem("plannedHomePosition", str(error), "or use --home")
        raise MissionError(file, [problem]) from error


CAMERA: Final = frozenset({203, 206, 530, 531, 532, 2000, 2001, 2500, 2501})
"""Commands to the camera, which QGroundControl puts between the waypoints of a survey."""


def _plan_items(listed: list[Any], sieve: PlanFilter) -> Iterator[Item | Problem]:
    """Yield the items, numbered from 1 as in QGroundControl, each jump with such a number.

    The waypoints of a survey, along its transects, stand in the plan. Raises MissionError for a
    parameter that is neither a number nor null.
    """
    flat = [one for each in listed for one in _simple_items(each, sieve)]
    ids = {one.get("doJumpId"): number for number, one in enumerate(flat, start=1)}
    for number, one in enumerate(flat, start=1):
        if one.get("type") != "SimpleItem":
            kind = f"{one.get('type') or 'not an item'} {one.get('complexItemType', '')}".strip()
            yield sieve.problem(f"item {number}", f"{kind}: the robot cannot do that")
            continue
        command, frame = _whole(one.get("command")), _whole(one.get("frame"))
        try:
            numbers = _plan_numbers(one.get("params"))
        except NotANumberError as error:
            raise sieve.unreadable(f"item {number}: params", error) from error
        if command == Command.DO_JUMP and numbers:
            numbers[0] = float(ids.get(numbers[0], numbers[0]))
        yield Item(number, command, frame, tuple(numbers), one.get("autoContinue") is not False)


def _simple_items(one: Any, sieve: PlanFilter) -> list[dict[str, Any]]:
    """Return the items of a survey without those for the camera, or the item itself."""
    if not isinstance(one, dict):
        return [{}]
    body = one.get("TransectStyleComplexItem")
    items = body.get("Items") if isinstance(body, dict) else None
    if not isinstance(items, list) or not items:
        return [one]
    found = [item if isinstance(item, dict) else {} for item in items]
    left = [item for item in found if item.get("command") not in CAMERA]
    if len(left) < len(found):
        what = f"{one.get('complexItemType', 'survey')}: {len(found) - len(left)} commands"
        sieve.leave(f"{what} to the camera, which the robot does not have")
    return left


def _whole(value: object) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) else -1


class NotANumberError(UserError):
    """A value of a file should be a number or missing, and is neither."""


def _plan_numbers(values: object) -> list[float]:
    """Return numbers, NaN for null, as in MAVLink; NotANumberError for anything else."""
    if not isinstance(values, list):
        return []
    return [_plan_number(value) for value in values]


def _plan_number(value: object) -> float:
    if value is None:
        return nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise NotANumberError(not_a_number(str(value)[:40]))
    try:
        return float(value)
    except OverflowError:
        return nan


def _fence(part: object, home: Home | None, sieve: PlanFilter) -> Fence | None:
    """Return the shape to stay in with those to stay out of; what is neither is rejected."""
    drawn: list[tuple[bool, Outline]] = []
    for where, shape in _shapes(part):
        stays = shape.get("inclusion", True) is not False
        if home is None:
            sieve.refuse(where, NO_HOME)
            continue
        if stays and any(one for one, _ in drawn):
            sieve.refuse(where, "is a second fence to stay in: only one is supported")
            continue
        try:
            outline = _circle(shape, home) if "circle" in shape else _polygon(shape, home)
        except NotANumberError as error:
            raise sieve.unreadable(where, error) from error
        fault = fault_of(outline.corners) if isinstance(outline, Polygon) else ""
        if outline is None or fault:
            sieve.refuse(where, fault or "cannot be read")
        else:
            drawn.append((stays, outline))
    return fence_with(drawn) if drawn else None


def _shapes(part: object) -> Iterator[tuple[str, dict[str, Any]]]:
    for kind in ("polygons", "circles"):
        listed = part.get(kind) if isinstance(part, dict) else None
        for at, shape in enumerate(listed if isinstance(listed, list) else []):
            yield f"geoFence.{kind}[{at}]", shape if isinstance(shape, dict) else {}


def _circle(shape: dict[str, Any], home: Home) -> Circle | None:
    circle = shape["circle"]
    centre = _plan_numbers(circle.get("center")) if isinstance(circle, dict) else []
    radius_m = _plan_number(circle.get("radius")) if isinstance(circle, dict) else nan
    if len(centre) < 2 or not all(map(isfinite, (*centre[:2], radius_m))):
        return None
    x_m, y_m = to_local(home, *centre[:2])
    return _fitting({"x_m": x_m, "y_m": y_m, "radius_m": radius_m}, Circle)


def _polygon(shape: dict[str, Any], home: Home) -> Polygon | None:
    listed = shape.get("polygon")
    corners = [_plan_numbers(one)[:2] for one in listed] if isinstance(listed, list) else []
    if any(len(corner) != 2 or not all(map(isfinite, corner)) for corner in corners):
        return None
    return _fitting({"corners": [to_local(home, *corner) for corner in corners]}, Polygon)


def _fitting(table: dict[str, Any], schema: type[T]) -> T | None:
    """Return None when a value is out of range."""
    try:
        return msgspec.convert(table, schema)
    except msgspec.ValidationError:
        return None


def plan_text(mission: Mission, home: Home) -> str:
    """Return a plan for a rover as QGroundControl writes it."""
    items = [_item(item_of(at, one, home)) for at, one in enumerate(mission.waypoints, start=1)]
    plan = {
        "fileType": "Plan",
        "geoFence": _fence_part(mission.fence, home),
        "groundStation": "Sidestep",
        "mission": {
            "cruiseSpeed": 0.3,
            "firmwareType": FIRMWARE_ARDUPILOT,
            "globalPlanAltitudeMode": ALTITUDE_RELATIVE,
            "hoverSpeed": 0.3,
            "items": items,
            "plannedHomePosition": [home.latitude_deg, home.longitude_deg, home.altitude_m],
            "vehicleType": TYPE_GROUND_ROVER,
            "version": PART_VERSION,
        },
        "rallyPoints": {"points": [], "version": PART_VERSION},
        "version": PLAN_VERSION,
    }
    return json.dumps(plan, indent=4, allow_nan=False) + "\n"


ALTITUDE_MODES: Final[Mapping[int, int]] = MappingProxyType(
    {
        FRAME_GLOBAL: ALTITUDE_ABSOLUTE,
        FRAME_GLOBAL_INT: ALTITUDE_ABSOLUTE,
        FRAME_GLOBAL_TERRAIN_ALT: ALTITUDE_TERRAIN,
        FRAME_GLOBAL_TERRAIN_ALT_INT: ALTITUDE_TERRAIN,
    }
)
"""QGroundControl's name for the frame of an altitude; all others are relative to home."""


def _item(item: Item) -> dict[str, object]:
    written: dict[str, object] = {
        "autoContinue": item.autocontinue,
        "command": item.command,
        "doJumpId": item.number,
        "frame": item.frame,
        "params": [value if isfinite(value) else None for value in item.params],
        "type": "SimpleItem",
    }
    if item.command not in PLACED:
        return written
    mode = ALTITUDE_MODES.get(item.frame, ALTITUDE_RELATIVE)
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": item.params[6],
        "AltitudeMode": mode,
        **written,
    }


def _fence_part(fence: Fence | None, home: Home) -> dict[str, object]:
    circles: list[object] = []
    polygons: list[object] = []
    for stays, outline in () if fence is None else zones_of(fence).drawn:
        if isinstance(outline, Circle):
            centre = list(same_on_earth(home, outline.x_m, outline.y_m))
            circle = {"center": centre, "radius": outline.radius_m}
            circles.append({"circle": circle, "inclusion": stays, "version": 1})
        else:
            corners = [list(same_on_earth(home, *corner)) for corner in outline.corners]
            polygons.append({"inclusion": stays, "polygon": corners, "version": 1})
    return {"circles": circles, "polygons": polygons, "version": PART_VERSION}


HEADER: Final = "QGC WPL 110"
FIELDS: Final = 12


def read_waypoints(
    text: str, file: str, *, home: Home | None = None, drop: bool = False
) -> Foreign:
    """Return the mission of a file; `home` replaces its item 0."""
    lines = text.lstrip("\ufeff").splitlines()
    if not lines or lines[0].split() != HEADER.split():
        problem = Problem("", f"the first line is not {HEADER!r}", "save it as QGC WPL 110", 1)
        raise MissionError(file, [problem])
    first, *rest = _line_items(lines, file) or [
        Item(0, Command.NAV_WAYPOINT, FRAME_GLOBAL, (0.0,) * 7)
    ]
    if first.command != Command.NAV_WAYPOINT or first.frame not in GLOBAL_FRAMES:
        problem = Problem("item 0", "is not home", "write home as item 0: NAV_WAYPOINT, frame 0")
        raise MissionError(file, [problem])
    home = home or _line_home(first, file)
    sieve = PlanFilter(file, drop=drop)
    steps = tuple(sieve.steps(rest, home))
    return sieve.result(Mission(waypoints=steps, home=home))


def _line_items(lines: list[str], file: str) -> list[Item]:
    items, problems = [], []
    for line, text in enumerate(lines[1:], start=2):
        if not text.strip() or text.startswith("#"):
            continue
        try:
            numbers = list(map(_line_number, text.split()))
        except NotANumberError as error:
            problems.append(Problem("", str(error), "", line))
            continue
        whole = [int(number) if isfinite(number) else -1 for number in numbers[:4]]
        if len(numbers) != FIELDS or whole != numbers[:4]:
            reason = f"is not {FIELDS} numbers, the first four of them whole"
            problems.append(Problem("", reason, "correct the line", line))
        else:
            params, goes_on = tuple(numbers[4:11]), numbers[11] != 0.0
            items.append(Item(whole[0], whole[3], whole[2], params, goes_on))
    if problems:
        raise MissionError(file, problems)
    return items


def _line_number(word: str) -> float:
    """Return a number, which may be NaN; NotANumberError for anything else."""
    try:
        return float(word)
    except ValueError:
        raise NotANumberError(not_a_number(word[:40])) from None


def _line_home(item: Item, file: str) -> Home | None:
    latitude_deg, longitude_deg, altitude_m = item.params[4:]
    if not latitude_deg and not longitude_deg:
        return None
    try:
        return home_at(latitude_deg, longitude_deg, altitude_m)
    except UserError as error:
        raise MissionError(file, [Problem("item 0", str(error), "or use --home")]) from error


def waypoints_text(mission: Mission, home: Home) -> str:
    """Return the text of a file; the format has no fence."""
    place = (0.0, 0.0, 0.0, 0.0, home.latitude_deg, home.longitude_deg, home.altitude_m)
    items = [Item(0, Command.NAV_WAYPOINT, FRAME_GLOBAL, place)]
    items += [item_of(at, one, home) for at, one in enumerate(mission.waypoints, start=1)]
    return "\n".join([HEADER, *map(_line, items)]) + "\n"


def _line(item: Item) -> str:
    current = int(not item.number)
    numbers = [repr(value) if isfinite(value) else "nan" for value in item.params]
    head = (item.number, current, item.frame, item.command)
    return "\t".join(map(str, (*head, *numbers, int(item.autocontinue))))
