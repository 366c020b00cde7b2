"""Run MAVLink's mission protocol without I/O: each request is repeated until answered.

The answers decide the next step, so a repeated or late answer does no harm. Items on the wire are
tenths of a millimetre in the robot's frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isinf, isnan, nan
from struct import Struct
from typing import Final

from ground.client.requests import PATIENCE_NS, Attempt, Exchange, GaveUp, is_saving
from ground.missions.mission import (
    EVERYWHERE,
    Circle,
    Fence,
    MavlinkItem,
    Outline,
    Polygon,
    Step,
    Waypoint,
    fence_with,
    zones_of,
)
from ground.missions.qgroundcontrol import ORDERS, PLACED, SCALES, UnsupportedItemError, waypoint_in
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, MissionType
from protocol.wire.limits import NO_ITEM, PLACES_PER_M
from protocol.wire.message import Message
from protocol.wire.messages import (
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
)
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import RemoteError

ATTEMPTS: Final = 5
MAX_SAVING: Final = 60
"""Limit of IN_PROGRESS answers; longer than a robot waits for its disk."""

MAX_ITEMS: Final = 4096
"""A higher limit than that of any robot."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The robot's verdict; `item` counts from 1, None for no particular item."""

    reason: int
    item: int | None
    mission_id: int = 0

    @property
    def ok(self) -> bool:
        """True if the robot accepted without reservation."""
        return self.reason == Reason.NONE

    @property
    def in_force(self) -> bool:
        """True if it is in force, even if it will not survive a restart of the robot."""
        return self.reason in (Reason.NONE, Reason.NOT_SAVED)

    @property
    def text(self) -> str:
        """Item and reason in words."""
        where = "" if self.item is None else f"item {self.item}: "
        return f"{where}{reason_text(self.reason)}"


@dataclass(frozen=True, slots=True)
class Downloaded:
    """All items of the robot, in order."""

    items: tuple[MissionItemInt, ...]


class Transfer(Exchange[Verdict | Downloaded]):
    """A sequence of requests, at most `most`."""

    def __init__(self, first: Message, kind: MissionType, now_ns: int, most: int) -> None:
        super().__init__(first, now_ns, attempts=ATTEMPTS, patience_ns=PATIENCE_NS)
        self._kind = kind
        self._steps_left = most
        self._saving_left = MAX_SAVING

    def due(self, now_ns: int) -> list[Attempt]:
        """Return the requests to send now."""
        sends = super().due(now_ns)
        self._steps_left -= len(sends)
        return sends

    def _is_out_of_time(self, now_ns: int) -> bool:
        return not self._steps_left

    def _take(self, answer: object, now_ns: int) -> None:
        if is_saving(answer) and self._saving_left:
            self._saving_left -= 1
            self._steps_left += 1
            self.unanswered("in force, still being saved")
            self._ask_next(self._question, now_ns)
        elif isinstance(answer, MissionVerdict) and answer.mission_type == self._kind:
            item = None if answer.item == NO_ITEM else answer.item + 1
            self.outcome = Verdict(answer.reason, item, answer.mission_id)
        elif (question := self._after(answer)) is None:
            self.unanswered(f"the answer was {type(answer).__name__}, out of turn")
        elif not self.over:
            self._ask_next(question, now_ns)

    def _after(self, answer: object) -> Message | None:
        """Return the next request, or None when the answer does not fit."""
        raise NotImplementedError


class Upload(Transfer):
    """Uploads a mission or a fence, completely or not at all."""

    def __init__(self, items: Sequence[MissionItemInt], kind: MissionType, now_ns: int) -> None:
        first = MissionCount(count=len(items), mission_type=kind)
        super().__init__(first, kind, now_ns, (len(items) + 1) * ATTEMPTS)
        self._items = tuple(items)

    def _after(self, answer: object) -> Message | None:
        asked = isinstance(answer, MissionRequestInt) and answer.mission_type == self._kind
        if not (asked and isinstance(answer, MissionRequestInt)):
            return None
        return self._items[answer.seq] if answer.seq < len(self._items) else None


class Announcement(Transfer):
    """Announces an upload: the robot answers whether it accepts this number of items now."""

    def __init__(self, count: int, kind: MissionType, now_ns: int) -> None:
        super().__init__(MissionCount(count=count, mission_type=kind), kind, now_ns, ATTEMPTS)

    def _after(self, answer: object) -> Message | None:
        if not isinstance(answer, MissionRequestInt) or answer.mission_type != self._kind:
            return None
        self.outcome = Verdict(Reason.NONE, None)
        return answer


class Download(Transfer):
    """Downloads the robot's items; a refusal is a Verdict."""

    def __init__(self, kind: MissionType, now_ns: int) -> None:
        super().__init__(
            MissionRequestList(mission_type=kind), kind, now_ns, ATTEMPTS * (MAX_ITEMS + 2)
        )
        self._count: int | None = None
        self._items: list[MissionItemInt] = []

    def _after(self, answer: object) -> Message | None:
        if isinstance(answer, MissionCount) and self._count is None:
            self._count = answer.count
            if self._count > MAX_ITEMS:
                self.outcome = GaveUp(f"{self._count} items are announced, at most {MAX_ITEMS}")
        elif isinstance(answer, MissionItemInt) and answer.seq == len(self._items):
            self._items.append(answer)
        else:
            return None
        if len(self._items) == self._count:
            self.outcome = Downloaded(tuple(self._items))
        return MissionRequestInt(seq=len(self._items), mission_type=self._kind)


class Clear(Transfer):
    """Deletes the robot's mission or fence."""

    def __init__(self, kind: MissionType, now_ns: int) -> None:
        super().__init__(MissionClearAll(mission_type=kind), kind, now_ns, ATTEMPTS)

    def _after(self, answer: object) -> Message | None:
        return None


DIGITS: Final = 5
"""Significant decimals of a typed number after conversion to single precision."""


def items_of(steps: Sequence[Step]) -> list[MissionItemInt]:
    """Return the items of a mission."""
    return [_item(at, step) for at, step in enumerate(steps)]


def _item(at: int, step: Step) -> MissionItemInt:
    if isinstance(step, MavlinkItem):
        x, y = (whole_place(value, step.frame) for value in step.params[4:6])
        return _mavlink_item(at, step, x, y)
    x, y = round(step.x_m * PLACES_PER_M), round(step.y_m * PLACES_PER_M)
    if step.mavlink is not None:
        return _mavlink_item(at, step.mavlink, x, y)
    return MissionItemInt(
        seq=at,
        frame=FRAME_LOCAL_FLU,
        command=Command.SIDESTEP_NAV_POSE,
        autocontinue=1,
        param1=step.hold_s,
        param2=step.position_tolerance_m,
        param3=step.heading_tolerance_deg,
        param4=nan if step.heading_deg is None else step.heading_deg,
        x=x,
        y=y,
        z=0.0,
        mission_type=MissionType.MISSION,
    )


def _mavlink_item(at: int, mavlink: MavlinkItem, x: int, y: int) -> MissionItemInt:
    param1, param2, param3, param4, _, _, z_m = mavlink.params
    return MissionItemInt(
        seq=at,
        frame=mavlink.frame,
        command=mavlink.command,
        autocontinue=int(mavlink.autocontinue),
        param1=param1,
        param2=param2,
        param3=param3,
        param4=param4,
        x=x,
        y=y,
        z=z_m,
        mission_type=MissionType.MISSION,
    )


def whole_place(value: float, frame: int) -> int:
    """Return x or y of a MISSION_ITEM_INT, which has no value for "none"."""
    return 0 if isnan(value) else round(value * SCALES.get(frame, 1))


def waypoints_of(items: Sequence[MissionItemInt]) -> tuple[Step, ...]:
    """Return the steps of items; RemoteError for an item that is none."""
    return tuple(map(_step, items))


def _step(item: MissionItemInt) -> Step:
    is_own = item.command == Command.SIDESTEP_NAV_POSE
    is_placed = item.command in PLACED
    if is_own and item.frame == FRAME_LOCAL_FLU:
        return Waypoint(
            x_m=item.x / PLACES_PER_M,
            y_m=item.y / PLACES_PER_M,
            heading_deg=None if isnan(item.param4) else round(item.param4, DIGITS),
            position_tolerance_m=round(item.param2, DIGITS),
            heading_tolerance_deg=round(item.param3, DIGITS),
            hold_s=round(item.param1, DIGITS),
        )
    scale = SCALES.get(item.frame, 1)
    place = (0.0, 0.0) if is_placed else (item.x / scale, item.y / scale)
    given = (item.param1, item.param2, item.param3, item.param4)
    mavlink = MavlinkItem(
        command=item.command,
        frame=item.frame,
        params=(*map(typed, given), *place, typed(item.z)),  # type: ignore[arg-type]
        autocontinue=item.autocontinue != 0,
    )
    try:
        if is_own or item.command not in (*PLACED, *ORDERS):
            raise UnsupportedItemError(f"command {item.command}")
        if not is_placed:
            return mavlink
        return waypoint_in(mavlink, item.x / PLACES_PER_M, item.y / PLACES_PER_M)
    except UnsupportedItemError as error:
        raise RemoteError(f"item {item.seq + 1} of the robot is no step: {error}") from error


FLOAT: Final = Struct("<f")


def typed(value: float) -> float:
    """Return the shortest decimal number that a 32-bit float stands for; every NaN is the same."""
    if isnan(value):
        return nan
    for digits in (7, 8):
        short = float(f"{value:.{digits}g}")
        if isinf(value) or FLOAT.pack(short) == FLOAT.pack(value):
            return short
    return float(f"{value:.9g}")


INCLUSIONS: Final = (
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    Command.NAV_FENCE_CIRCLE_INCLUSION,
)
EXCLUSIONS: Final = (
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    Command.NAV_FENCE_CIRCLE_EXCLUSION,
)
CIRCLES: Final = (Command.NAV_FENCE_CIRCLE_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION)
Corners = tuple[int, float, Sequence[tuple[float, float]]]


def corners_of(fence: Fence) -> list[Corners]:
    """Return command, parameter 1 and places of each outline, in the order of drawing."""
    found: list[Corners] = []
    for is_inclusion, outline in zones_of(fence).drawn:
        polygon, circle = INCLUSIONS if is_inclusion else EXCLUSIONS
        if isinstance(outline, Circle):
            found.append((circle, outline.radius_m, [(outline.x_m, outline.y_m)]))
        else:
            found.append((polygon, float(len(outline.corners)), outline.corners))
    return found


def fence_items_of(fence: Fence) -> list[MissionItemInt]:
    """Return the items of a fence; one that only keeps the robot out allows all the rest."""
    outlines = corners_of(fence)
    if all(command in EXCLUSIONS for command, _, _ in outlines):
        circle = EVERYWHERE
        place = (circle.x_m, circle.y_m)
        outlines.append((Command.NAV_FENCE_CIRCLE_INCLUSION, circle.radius_m, [place]))
    items: list[MissionItemInt] = []
    for command, param1, places in outlines:
        items += [_corner(len(items) + at, command, param1, one) for at, one in enumerate(places)]
    return items


def _corner(at: int, command: int, param1: float, place: tuple[float, float]) -> MissionItemInt:
    return MissionItemInt(
        seq=at,
        frame=FRAME_LOCAL_FLU,
        command=command,
        param1=param1,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        x=round(place[0] * PLACES_PER_M),
        y=round(place[1] * PLACES_PER_M),
        z=0.0,
        mission_type=MissionType.FENCE,
    )


def fence_of(items: Sequence[MissionItemInt]) -> Fence | None:
    """Return the fence of items, None without items; RemoteError for an unknown kind."""
    drawn: list[tuple[bool, Outline]] = []
    at = 0
    while at < len(items):
        first = items[at]
        size = 1 if first.command in CIRCLES else max(1, round(first.param1))
        run = items[at : at + size]
        if first.command not in (*INCLUSIONS, *EXCLUSIONS) or len(run) < size:
            kinds = sorted({item.command for item in items})
            raise RemoteError(f"the robot's fence is of an unknown kind: commands {kinds}")
        places = tuple((item.x / PLACES_PER_M, item.y / PLACES_PER_M) for item in run)
        x_m, y_m = places[0]
        circle = Circle(x_m=x_m, y_m=y_m, radius_m=round(first.param1, DIGITS))
        outline = circle if first.command in CIRCLES else Polygon(corners=places)
        drawn.append((first.command in INCLUSIONS, outline))
        at += size
    return fence_with(drawn) if drawn else None
