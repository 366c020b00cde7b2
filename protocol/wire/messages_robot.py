"""Messages of the control loop and of a run: senses, wheels, status, score.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from protocol.wire.message import Message, unfit


class SonarScan(Message, frozen=True, kw_only=True):
    """One period of the sonar ring.

    Sonar i looks at (i - 3.5) * 22.5 degrees: 0 right, 7 left.

    Attributes:
        time_ns: Stamp of the scan, clock of the plant. [ns]
        seq: Counts control periods.
        range_mm: Range from the rim of the robot; only where the echo bit is set. [8 values, mm]
        ping_age_us: Age of each ping at time_ns. [8 values, us]
        valid: Bit i: sonar i measured in this period.
        echo: Bit i: an echo came back. Valid without echo is free space up to the maximum range.
    """

    time_ns: int
    seq: int
    range_mm: tuple[int, ...]
    ping_age_us: tuple[int, ...]
    valid: int
    echo: int

    def __post_init__(self) -> None:
        if len(self.range_mm) != 8 or len(self.ping_age_us) != 8:
            raise unfit(self)


class WheelTicks(Message, frozen=True, kw_only=True):
    """Encoder counters and bumper, latched at the tick.

    Attributes:
        time_ns: Stamp, clock of the plant. [ns]
        seq: Counts control periods.
        left: Left encoder, wraps at 32 bits.
        right: Right encoder, wraps at 32 bits.
        bumper: Pressed sectors. [BUMPER_*]
        expired: 1 while the motor driver stands because the last command's time-to-live ran out.
    """

    time_ns: int
    seq: int
    left: int
    right: int
    bumper: int
    expired: int


class WheelCommand(Message, frozen=True, kw_only=True):
    """Wheel speeds, valid until the time-to-live runs out.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        seq: Counts commands.
        sense_seq: seq of the senses it answers.
        epoch: Start of the robot process, UTC in s; 0 without a clock. The newest epoch drives.
        left_mrad_s: Left wheel. [mrad/s]
        right_mrad_s: Right wheel. [mrad/s]
        ttl_ms: Valid for this long from the tick it answers. [ms, at most 150]
    """

    time_ns: int
    seq: int
    sense_seq: int
    epoch: int = 0
    left_mrad_s: int
    right_mrad_s: int
    ttl_ms: int


class PlanarOdometry(Message, frozen=True, kw_only=True):
    """Estimated pose in the odometry frame.

    With the upper triangle of its covariance.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        x_m: Position. [m]
        y_m: Position. [m]
        heading_rad: Heading. [rad]
        speed_m_s: Forward speed. [m/s]
        yaw_rate_rad_s: Yaw rate. [rad/s]
        cov_xx_m2: Covariance.
        cov_xy_m2: Covariance.
        cov_xh_m_rad: Covariance.
        cov_yy_m2: Covariance.
        cov_yh_m_rad: Covariance.
        cov_hh_rad2: Covariance.
    """

    time_ns: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    cov_xx_m2: float
    cov_xy_m2: float
    cov_xh_m_rad: float
    cov_yy_m2: float
    cov_yh_m_rad: float
    cov_hh_rad2: float


class NavigatorStatus(Message, frozen=True, kw_only=True):
    """Vehicle, mode, goal and navigator, each tick.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        goal_started_ns: When the goal was accepted; 0 without one. [ns]
        goal_ended_ns: When the goal ended; 0 while it lives. [ns]
        goal_id: request_id of the goal.
        stop_id: request_id of the newest emergency stop that the robot has acted on; 0 before the
            first.
        goal_x_m: Goal. [m]
        goal_y_m: Goal. [m]
        goal_heading_rad: Final heading; NaN when free. [rad]
        goal_distance_m: Believed distance to the goal. [m]
        vehicle: Vehicle state. [Vehicle]
        mode: Mode. [Mode]
        goal: Goal state. [GoalState]
        vehicle_reason: Why the vehicle is in its state. [Reason]
        goal_reason: Why the goal is in its state. [Reason]
        navigator: Navigator. [Navigator]
        side: Side on which obstacles are passed by navigators that leave it to the user: 1 left, -1
            right.
    """

    time_ns: int
    goal_started_ns: int
    goal_ended_ns: int
    goal_id: int
    stop_id: int = 0
    goal_x_m: float
    goal_y_m: float
    goal_heading_rad: float
    goal_distance_m: float
    vehicle: int
    mode: int
    goal: int
    vehicle_reason: int
    goal_reason: int
    navigator: int
    side: int


class AvoidanceDecision(Message, frozen=True, kw_only=True):
    """What the navigator saw and chose in this tick.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        nearest_bearing_rad: Bearing of the nearest echo from the heading; NaN when none. [rad]
        nearest_range_m: Nearest echo; infinite when none. [m]
        zone_m: Width of the avoidance zone (d_obs of vgm, d_th of bug); NaN when the navigator has
            none. [m]
        goal_bearing_rad: Bearing of the goal from the heading (alpha). [rad]
        rotation_rad: Rotation from the goal to the virtual goal (gamma). [rad]
        virtual_x_m: Virtual goal. [m]
        virtual_y_m: Virtual goal. [m]
        speed_m_s: Commanded forward speed. [m/s]
        yaw_rate_rad_s: Commanded yaw rate. [rad/s]
        branch: Branch taken. [Branch]
        guard: What the guard did. [Reason]
    """

    time_ns: int
    nearest_bearing_rad: float
    nearest_range_m: float
    zone_m: float
    goal_bearing_rad: float
    rotation_rad: float
    virtual_x_m: float
    virtual_y_m: float
    speed_m_s: float
    yaw_rate_rad_s: float
    branch: int
    guard: int


class CycleReport(Message, frozen=True, kw_only=True):
    """Cost and lateness of one control cycle.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        tick: Index of the tick.
        missed: Ticks missed since the start.
        overruns: Ticks over budget since the start.
        rejected: Frames that could not be read since the start.
        late_us: Lateness of this tick, wall time. [us]
        sense_age_us: Oldest sonar ping to wheel command. [us]
        budget_us: CPU time allowed per tick. [us]
        stage_us: CPU time spent: read, odometry, navigate, guard, write (of the tick before). [5
            values, us]
    """

    time_ns: int
    tick: int
    missed: int
    overruns: int
    rejected: int
    late_us: int
    sense_age_us: int
    budget_us: int
    stage_us: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.stage_us) != 5:
            raise unfit(self)


class GroundTruth(Message, frozen=True, kw_only=True):
    """True pose of the robot.

    For evaluation only; nothing that drives may read it.

    Attributes:
        time_ns: Stamp, clock of the plant. [ns]
        seq: Counts control periods.
        x_m: Position. [m]
        y_m: Position. [m]
        heading_rad: Heading. [rad]
        speed_m_s: Forward speed. [m/s]
        yaw_rate_rad_s: Yaw rate. [rad/s]
        clearance_m: Rim to nearest obstacle; negative in contact. [m]
        contact: 1 while in contact.
    """

    time_ns: int
    seq: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    clearance_m: float
    contact: int


class RunRequest(Message, frozen=True, kw_only=True):
    """Request to the plant: start, pause, score.

    Attributes:
        until_ns: Score up to this stamp. [ns]
        action: What to do. [RunAction]
    """

    until_ns: int
    action: int


class RunScore(Message, frozen=True, kw_only=True):
    """The plant's evaluation of a run, from ground truth.

    Attributes:
        time_ns: Stamp of the last tick scored. [ns]
        ticks: Ticks scored.
        contacts: Contacts begun.
        own_contacts: Of these, begun by the robot's own motion.
        x_m: True position at the end. [m]
        y_m: True position at the end. [m]
        heading_rad: True heading at the end. [rad]
        path_m: Distance travelled. [m]
        min_clearance_m: Smallest clearance. [m]
        digest: SHA-256 over the trajectory. [32 values]
    """

    time_ns: int
    ticks: int
    contacts: int
    own_contacts: int
    x_m: float
    y_m: float
    heading_rad: float
    path_m: float
    min_clearance_m: float
    digest: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.digest) != 32:
            raise unfit(self)


class TickInputs(Message, frozen=True, kw_only=True):
    """Inputs of the core in this tick, so that a recorded run can be executed again.

    Attributes:
        time_ns: Stamp, clock of the robot. [ns]
        now_ms: Time as the core was told it. [ms]
        tick: Index of the tick.
        wheels_seq: seq of the wheel ticks it was given.
        scan_seq: seq of the scan it was given.
        requests: Requests acted on before this tick, since the start; they are on tlm/commanded.
        scan_age_ms: Age of the scan. [ms]
        operator_age_ms: Since an operator was heard; all ones: never. [ms]
        flags: What there was. [INPUT_*]
        speed_mm_s: Of that TELEOP. [mm/s]
        yaw_rate_mrad_s: Of that TELEOP. [mrad/s]
    """

    time_ns: int
    now_ms: int
    tick: int
    wheels_seq: int
    scan_seq: int
    requests: int
    scan_age_ms: int
    operator_age_ms: int
    flags: int
    speed_mm_s: int
    yaw_rate_mrad_s: int
