"""Messages of operators and robots: requests, lease, teleop, mission.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from protocol.wire.message import Message, too_long, unfit


class GoalRequest(Message, frozen=True, kw_only=True):
    """Drive there.

    A repeated request_id is answered again and not acted on again.

    Attributes:
        request_id: Chosen by the sender, never reused.
        x_mm: Goal in the odometry frame. [mm]
        y_mm: Goal in the odometry frame. [mm]
        heading_urad: Final heading, microradians.
        position_tolerance_mm: Arrived within this distance. [mm]
        heading_tolerance_urad: Aligned within this angle, microradians.
        heading_free: 1: any final heading will do.
        mode: GUIDED (needs an operator) or AUTO. [Mode]
    """

    request_id: int
    x_mm: int
    y_mm: int
    heading_urad: int
    position_tolerance_mm: int
    heading_tolerance_urad: int
    heading_free: int
    mode: int


class CommandRequest(Message, frozen=True, kw_only=True):
    """A MAV_CMD with an id that makes a retry harmless.

    Answered by COMMAND_ACK, whose result_param2 is a SIDESTEP_REASON.

    Attributes:
        request_id: Chosen by the sender, never reused.
        param1: First parameter of the command.
        param2: Second parameter of the command.
        command: Command. [Command]
    """

    request_id: int
    param1: float
    param2: float
    command: int


class LeaseRequest(Message, frozen=True, kw_only=True):
    """Request or release the lease.

    The bus names the sender. Answered by COMMAND_ACK, whose result_param2 is a SIDESTEP_REASON.

    Attributes:
        request_id: Chosen by the sender, never reused.
        action: What to do. [LeaseAction]
        name: Display name of the operator. [at most 16 bytes]
    """

    request_id: int
    action: int
    name: str

    def __post_init__(self) -> None:
        if too_long(self.name, 16):
            raise unfit(self)


class LeaseStatus(Message, frozen=True, kw_only=True):
    """Holder of the lease.

    While it is free, the robot takes commands from every operator.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        lapses_ms: The lease ends after this time unless the holder is heard; 0 while nobody holds
            it. [ms, at most 3000]
        held: 1 while an operator holds it.
        holder: Identity of the holder on the bus: operator/session. [at most 56 bytes]
        name: Display name of the holder. [at most 16 bytes]
    """

    time_ns: int
    lapses_ms: int
    held: int
    holder: str
    name: str

    def __post_init__(self) -> None:
        if too_long(self.holder, 56) or too_long(self.name, 16):
            raise unfit(self)


class Teleop(Message, frozen=True, kw_only=True):
    """Velocity in MANUAL, valid until the time-to-live, counted from the stamp, runs out.

    Nothing else drives the robot in MANUAL: without these frames it stops.

    Attributes:
        time_ns: Stamp, clock of the operator. [ns]
        seq: Counts the frames of this operator.
        speed_mm_s: Forward speed. [mm/s]
        yaw_rate_mrad_s: Yaw rate. [mrad/s]
        ttl_ms: Valid for this long. [ms, at most 500]
    """

    time_ns: int
    seq: int
    speed_mm_s: int
    yaw_rate_mrad_s: int
    ttl_ms: int


class MissionStatus(Message, frozen=True, kw_only=True):
    """Progress of the mission.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        mission_id: Counts the missions accepted since the start; 0 without one.
        hold_left_ms: What is left of the hold time; 0 while not HOLDING. [ms]
        count: Items.
        current: Item it is about, from 0.
        state: State. [MissionState]
        reason: Why it is in its state. [Reason]
    """

    time_ns: int
    mission_id: int
    hold_left_ms: int
    count: int
    current: int
    state: int
    reason: int


class MissionVerdict(Message, frozen=True, kw_only=True):
    """Ends a transfer: accepted as a whole (reason 0), or refused, and the old one stays.

    Attributes:
        mission_id: The mission in force from now on.
        item: The item that is refused; 65535: none in particular.
        reason: What is wrong with it. [Reason]
        mission_type: 0 mission, 1 fence. [MissionType]
    """

    mission_id: int
    item: int
    reason: int
    mission_type: int
