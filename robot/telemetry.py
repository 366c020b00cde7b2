"""Convert the state of the core to telemetry messages, and its changes to texts for an operator."""

from math import nan
from typing import Final, NamedTuple

from protocol.outcome import BY_PERSONS, mission_state, reason_words
from protocol.wire.enums import (
    AUTOPILOT_ARDUPILOTMEGA,
    INPUT_SCAN,
    INPUT_TELEOP,
    INPUT_WHEELS,
    MODE_FLAG_CUSTOM_MODE_ENABLED,
    MODE_FLAG_SAFETY_ARMED,
    TYPE_GROUND_ROVER,
    GoalState,
    MissionState,
    Mode,
    Severity,
    SystemState,
    Vehicle,
)
from protocol.wire.limits import NEVER_MS
from protocol.wire.messages import (
    AvoidanceDecision,
    Heartbeat,
    NavigatorStatus,
    PlanarOdometry,
    Statustext,
    Teleop,
    TickInputs,
)
from protocol.wire.reasons import reason_text
from protocol.wire.statustext import pieces_of
from robot.core import reasons, states
from robot.core.modes import Machine
from robot.core.state import State
from robot.core.values import Inputs, Outputs
from robot.mission import NOBODY, MissionExecutor, Stoppers
from runtime.units import NS_PER_MS, UINT32

UNKNOWN_SPREAD: Final = (nan,) * 6
"""The covariance of a robot that does not know its place."""

SYSTEM_STATUS: Final = {
    states.BOOT: SystemState.BOOT,
    states.STANDBY: SystemState.STANDBY,
    states.ACTIVE: SystemState.ACTIVE,
    states.FAILSAFE: SystemState.CRITICAL,
    states.EMERGENCY_STOP: SystemState.EMERGENCY,
}


def heartbeat(state: State) -> Heartbeat:
    """Return the heartbeat of an ArduPilot Rover, which MAVLink ground stations recognise."""
    machine = state.machine
    armed = MODE_FLAG_SAFETY_ARMED if machine.vehicle == states.ACTIVE else 0
    return Heartbeat(
        type=TYPE_GROUND_ROVER,
        autopilot=AUTOPILOT_ARDUPILOTMEGA,
        base_mode=MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
        custom_mode=machine.mode,
        system_status=SYSTEM_STATUS[machine.vehicle],
        mavlink_version=3,
    )


def odometry(state: State, time_ns: int) -> PlanarOdometry:
    """Return pose, speeds and covariance; its values are NaN while the place is unknown."""
    odometry = state.odometry
    spread = UNKNOWN_SPREAD
    if state.machine.placed:
        spread = (
            odometry.pxx,
            odometry.pxy,
            odometry.pxh,
            odometry.pyy,
            odometry.pyh,
            odometry.phh,
        )
    return PlanarOdometry(
        time_ns=time_ns,
        x_m=odometry.pose.x_m,
        y_m=odometry.pose.y_m,
        heading_rad=odometry.pose.heading_rad,
        speed_m_s=odometry.speed_m_s,
        yaw_rate_rad_s=odometry.yaw_rate_rad_s,
        cov_xx_m2=spread[0],
        cov_xy_m2=spread[1],
        cov_xh_m_rad=spread[2],
        cov_yy_m2=spread[3],
        cov_yh_m_rad=spread[4],
        cov_hh_rad2=spread[5],
    )


def status(
    state: State,
    goal_id: int,
    time_ns: int,
    now_ms: int,
    stop_id: int = 0,
    by: Stoppers = NOBODY,
) -> NavigatorStatus:
    """Return vehicle, mode and goal; the goal's times are converted from core time to stamps."""
    machine = state.machine
    goal = machine.goal
    heading_rad = nan if goal is None or goal.heading_rad is None else goal.heading_rad
    started_ns = 0 if goal is None else _stamp(machine.goal_started_ms, time_ns, now_ms)
    over = machine.goal_state >= states.REACHED
    return NavigatorStatus(
        time_ns=time_ns,
        goal_started_ns=started_ns,
        goal_ended_ns=max(1, _stamp(machine.goal_ended_ms, time_ns, now_ms)) if over else 0,
        goal_id=goal_id,
        stop_id=stop_id,
        goal_x_m=nan if goal is None else goal.x_m,
        goal_y_m=nan if goal is None else goal.y_m,
        goal_heading_rad=heading_rad,
        goal_distance_m=state.goal_distance_m,
        vehicle=machine.vehicle,
        mode=machine.mode,
        goal=machine.goal_state,
        vehicle_reason=machine.vehicle_reason,
        goal_reason=machine.goal_reason,
        navigator=machine.navigator,
        side=machine.side,
        ended_by=by.goal if machine.goal_reason in BY_PERSONS else "",
        held_by=by.hold,
    )


def _stamp(at_ms: int, time_ns: int, now_ms: int) -> int:
    return max(0, time_ns - (now_ms - at_ms) * NS_PER_MS)


def decision(outputs: Outputs, zone_m: float, time_ns: int) -> AvoidanceDecision:
    """Return why the robot turns; values are NaN where nothing was decided."""
    chosen = outputs.decision
    bearing_rad = None if chosen is None else chosen.nearest_bearing_rad
    return AvoidanceDecision(
        time_ns=time_ns,
        nearest_bearing_rad=nan if bearing_rad is None else bearing_rad,
        nearest_range_m=nan if chosen is None else chosen.nearest_range_m,
        zone_m=zone_m,
        goal_bearing_rad=nan if chosen is None else chosen.goal_bearing_rad,
        rotation_rad=nan if chosen is None else chosen.rotation_rad,
        virtual_x_m=nan if chosen is None else chosen.virtual_x_m,
        virtual_y_m=nan if chosen is None else chosen.virtual_y_m,
        speed_m_s=outputs.twist.speed_m_s,
        yaw_rate_rad_s=outputs.twist.yaw_rate_rad_s,
        branch=states.NO_BRANCH if chosen is None else chosen.branch,
        guard=outputs.guard,
    )


class CoreInputs(NamedTuple):
    """The origin of the core's inputs, which the core itself does not see."""

    wheels_seq: int
    scan_seq: int
    scan_age_ms: int
    requests: int
    reported: int
    """Flags of the failsafe reasons reported by the host."""


def tick_inputs(
    inputs: Inputs, given: CoreInputs, teleop: Teleop | None, tick: int, time_ns: int
) -> TickInputs:
    """Return all other inputs of the core's step besides the sensor frames."""
    flags = given.reported
    flags |= INPUT_WHEELS if inputs.wheels is not None else 0
    flags |= INPUT_SCAN if inputs.scan is not None else 0
    flags |= INPUT_TELEOP if teleop is not None else 0
    age_ms = inputs.operator_age_ms
    return TickInputs(
        time_ns=time_ns,
        now_ms=inputs.now_ms,
        tick=tick & UINT32,
        wheels_seq=given.wheels_seq,
        scan_seq=given.scan_seq,
        requests=given.requests,
        scan_age_ms=given.scan_age_ms,
        operator_age_ms=NEVER_MS if age_ms is None else min(age_ms, NEVER_MS - 1),
        flags=flags,
        speed_mm_s=0 if teleop is None else teleop.speed_mm_s,
        yaw_rate_mrad_s=0 if teleop is None else teleop.yaw_rate_mrad_s,
    )


VEHICLE_SEVERITY: Final = {
    Vehicle.FAILSAFE: Severity.CRITICAL,
    Vehicle.EMERGENCY_STOP: Severity.CRITICAL,
}
GOAL_SEVERITY: Final = {GoalState.STUCK: Severity.ERROR, GoalState.ABORTED: Severity.WARNING}
REPORTED_GOALS: Final = frozenset(
    {GoalState.ACCEPTED, GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED}
)


class ChangeLog:
    """Report what has changed in the machine and the mission since the last call."""

    def __init__(self, machine: Machine, mission: MissionExecutor) -> None:
        self._machine = machine
        self._mission = mission
        self._progress = (mission.number, mission.state, mission.current)
        self._vehicle = (machine.vehicle, machine.vehicle_reason)
        self._mode = machine.mode
        self._placed = machine.placed
        self._goal = (machine.serial, machine.goal_state, machine.goal_reason)
        self._text_id = 0

    def since_last_time(self, by: Stoppers = NOBODY) -> list[Statustext]:
        """Return a text for each change of goal, vehicle, mode and mission since the last call.

        It names who has stopped what another person had begun.
        """
        machine = self._machine
        texts: list[Statustext] = []
        goal = (machine.serial, machine.goal_state, machine.goal_reason)
        if goal != self._goal and machine.goal_state in REPORTED_GOALS:
            state = GoalState(machine.goal_state)
            severity = GOAL_SEVERITY.get(state, Severity.INFO)
            words = change_text("goal", state.name, machine.goal_reason, by.goal)
            texts += self.text(severity, words)
        vehicle = (machine.vehicle, machine.vehicle_reason)
        if vehicle != self._vehicle:
            name = Vehicle(machine.vehicle)
            severity = VEHICLE_SEVERITY.get(name, Severity.INFO)
            texts += self.text(severity, change_text("vehicle", name.name, machine.vehicle_reason))
        if machine.mode != self._mode:
            whose = f" by {by.hold}" if by.hold else ""
            texts += self.text(Severity.INFO, f"mode {Mode(machine.mode).name}{whose}")
        if self._placed and not machine.placed:
            words = f"PLACE UNKNOWN: {reason_text(reasons.PLACE_UNKNOWN)}"
            texts += self.text(Severity.ERROR, words)
        self._goal, self._vehicle, self._mode = goal, vehicle, machine.mode
        self._placed = machine.placed
        return texts + self._mission_texts(by)

    def _mission_texts(self, by: Stoppers) -> list[Statustext]:
        mission = self._mission
        progress = (mission.number, mission.state, mission.current)
        if progress == self._progress:
            return []
        self._progress = progress
        state = mission_state(mission.state, mission.reason)
        words = change_text("mission", state, mission.reason, mission.stopper(by))
        if mission.items:
            words += f" (item {mission.current + 1} of {len(mission.items)})"
        failed = state == MissionState.FAILED.name
        return self.text(Severity.ERROR if failed else Severity.INFO, words)

    def text(self, severity: int, words: str) -> list[Statustext]:
        """Return the pieces of one text, at most 50 bytes each; no pieces for an empty text."""
        self._text_id = self._text_id % 65_535 + 1
        return pieces_of(words, self._text_id, severity) if words else []


def change_text(what: str, state: str, reason: int, by: str = "") -> str:
    """Return the text for a state, with the reason if there is one, and who it was."""
    if reason == reasons.OK:
        return f"{what} {state}"
    is_by = reason == reasons.BY_EMERGENCY_STOP or (by and reason == reasons.BY_OPERATOR)
    return f"{what} {state}{' ' if is_by else ': '}{reason_words(reason, by)}"
