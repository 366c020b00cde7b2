"""Typed face of what operators and robots say to each other: requests, lease, teleop, mission."""

from protocol.message import Message, too_long, unfit


class GoalRequest(Message, frozen=True, kw_only=True):
    """Drive there. A repeated request_id is answered again and not acted on again."""

    request_id: int
    x_mm: int
    y_mm: int
    heading_urad: int
    position_tolerance_mm: int
    heading_tolerance_urad: int
    heading_free: int
    mode: int


class CommandRequest(Message, frozen=True, kw_only=True):
    """A MAV_CMD with an id that makes a retry harmless; answered by CommandAck."""

    request_id: int
    param1: float
    param2: float
    command: int


class LeaseRequest(Message, frozen=True, kw_only=True):
    """Asks for the lease or gives it back; who asks is told by the bus."""

    request_id: int
    action: int
    name: str

    def __post_init__(self) -> None:
        if too_long(self.name, 16):
            raise unfit(self)


class LeaseStatus(Message, frozen=True, kw_only=True):
    """Who commands the robot; while nobody does, it takes commands from anyone."""

    time_ns: int
    lapses_ms: int
    held: int
    holder: str
    name: str

    def __post_init__(self) -> None:
        if too_long(self.holder, 56) or too_long(self.name, 16):
            raise unfit(self)


class Teleop(Message, frozen=True, kw_only=True):
    """Drive like this in MANUAL, until the time-to-live runs out."""

    time_ns: int
    seq: int
    speed_mm_s: int
    yaw_rate_mrad_s: int
    ttl_ms: int


class MissionStatus(Message, frozen=True, kw_only=True):
    """How far the mission is."""

    time_ns: int
    mission_id: int
    hold_left_ms: int
    count: int
    current: int
    state: int
    reason: int


class MissionVerdict(Message, frozen=True, kw_only=True):
    """Ends a transfer: accepted as a whole, or refused with the item (65535: none) and why."""

    mission_id: int
    item: int
    reason: int
    mission_type: int
