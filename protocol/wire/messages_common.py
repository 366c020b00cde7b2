"""Messages taken over from MAVLink's common.xml.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from protocol.wire.message import Message, too_long, unfit


class Heartbeat(Message, frozen=True, kw_only=True):
    """Sign of life, sent from inside the control loop."""

    type: int
    autopilot: int
    base_mode: int
    custom_mode: int
    system_status: int
    mavlink_version: int = 3


class SystemTime(Message, frozen=True, kw_only=True):
    """Time of the sender's master clock."""

    time_unix_usec: int
    time_boot_ms: int


class ParamRequestRead(Message, frozen=True, kw_only=True):
    """Request one parameter, by name (index -1) or by index."""

    target_system: int = 0
    target_component: int = 0
    param_id: str
    param_index: int

    def __post_init__(self) -> None:
        if too_long(self.param_id, 16):
            raise unfit(self)


class ParamRequestList(Message, frozen=True, kw_only=True):
    """Request all parameters."""

    target_system: int = 0
    target_component: int = 0


class ParamValue(Message, frozen=True, kw_only=True):
    """Value of a parameter."""

    param_id: str
    param_value: float
    param_type: int
    param_count: int
    param_index: int

    def __post_init__(self) -> None:
        if too_long(self.param_id, 16):
            raise unfit(self)


class ParamSet(Message, frozen=True, kw_only=True):
    """Set a parameter."""

    target_system: int = 0
    target_component: int = 0
    param_id: str
    param_value: float
    param_type: int

    def __post_init__(self) -> None:
        if too_long(self.param_id, 16):
            raise unfit(self)


class MissionSetCurrent(Message, frozen=True, kw_only=True):
    """Make an item the current one."""

    target_system: int = 0
    target_component: int = 0
    seq: int


class MissionCurrent(Message, frozen=True, kw_only=True):
    """Index of the current item."""

    seq: int
    total: int = 0
    mission_state: int = 0
    mission_mode: int = 0


class MissionRequestList(Message, frozen=True, kw_only=True):
    """Request the mission."""

    target_system: int = 0
    target_component: int = 0
    mission_type: int = 0


class MissionCount(Message, frozen=True, kw_only=True):
    """Number of items of a mission; opens a transfer."""

    target_system: int = 0
    target_component: int = 0
    count: int
    mission_type: int = 0


class MissionClearAll(Message, frozen=True, kw_only=True):
    """Delete the mission."""

    target_system: int = 0
    target_component: int = 0
    mission_type: int = 0


class MissionItemReached(Message, frozen=True, kw_only=True):
    """An item has been reached."""

    seq: int


class MissionAck(Message, frozen=True, kw_only=True):
    """Result of a mission transfer, which it ends."""

    target_system: int = 0
    target_component: int = 0
    type: int
    mission_type: int = 0


class MissionRequestInt(Message, frozen=True, kw_only=True):
    """Request one item."""

    target_system: int = 0
    target_component: int = 0
    seq: int
    mission_type: int = 0


class ManualControl(Message, frozen=True, kw_only=True):
    """Joystick axes and buttons, axes -1000 to 1000."""

    target: int
    x: int
    y: int
    z: int
    r: int
    buttons: int
    buttons2: int = 0
    enabled_extensions: int = 0
    s: int = 0
    t: int = 0
    aux1: int = 0
    aux2: int = 0
    aux3: int = 0
    aux4: int = 0
    aux5: int = 0
    aux6: int = 0


class MissionItemInt(Message, frozen=True, kw_only=True):
    """One mission item."""

    target_system: int = 0
    target_component: int = 0
    seq: int
    frame: int
    command: int
    current: int = 0
    autocontinue: int = 0
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float
    mission_type: int = 0


class CommandInt(Message, frozen=True, kw_only=True):
    """Command with a position as integers."""

    target_system: int = 0
    target_component: int = 0
    frame: int
    command: int
    current: int = 0
    autocontinue: int = 0
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int
    y: int
    z: float


class CommandLong(Message, frozen=True, kw_only=True):
    """Command with seven parameters."""

    target_system: int = 0
    target_component: int = 0
    command: int
    confirmation: int = 0
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    param5: float = 0.0
    param6: float = 0.0
    param7: float = 0.0


class CommandAck(Message, frozen=True, kw_only=True):
    """Answer to a command; result_param2 is a Reason."""

    command: int
    result: int
    progress: int = 0
    result_param2: int = 0
    target_system: int = 0
    target_component: int = 0


class Timesync(Message, frozen=True, kw_only=True):
    """Request for the time (tc1 = 0), or the answer to one."""

    tc1: int
    ts1: int


class Statustext(Message, frozen=True, kw_only=True):
    """Line of text for the operator."""

    severity: int
    text: str
    id: int = 0
    chunk_seq: int = 0

    def __post_init__(self) -> None:
        if too_long(self.text, 50):
            raise unfit(self)
