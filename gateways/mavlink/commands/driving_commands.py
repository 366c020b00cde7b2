"""Commands that move the robot: modes, drives and their speed; places and headings in GUIDED."""

from math import radians
from types import MappingProxyType
from typing import Final

from gateways.mavlink.ardupilot import MODES_BY_NUMBER, RTL
from gateways.mavlink.commands.command_protocol import (
    ACCEPTED,
    DENIED,
    FAILED,
    UNSUPPORTED_FRAME,
    CommandAnswer,
    CommandCall,
    CommandRow,
    CommandTable,
    Handled,
    is_unset,
    reason_of,
    whole,
)
from gateways.mavlink.coordinates import heading_of
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.motion.guided import GuidedDrive
from gateways.mavlink.motion.pilot import NO_LIMIT, LimitDrive, Pilot
from gateways.mavlink.motion.setpoints import (
    SetpointError,
    Velocity,
    place_goal,
    pose_in,
    require_finite,
    world_heading,
)
from gateways.mavlink.robot_port import OVERTAKEN, Answered
from ground.client.goal import Destination
from ground.commands.resume import Resume
from protocol.wire.enums import Mode
from protocol.wire.reasons import Reason

UNCHANGED: Final = -1
GROUND_SPEEDS: Final = (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED)
MODE_NAMES: Final = "MANUAL 0, HOLD 4, AUTO 10, RTL 11, SMART_RTL 12, GUIDED 15"


class DrivingCommands:
    """The handlers, on one pilot."""

    def __init__(self, vehicle: MavVehicle, pilot: Pilot) -> None:
        self._vehicle = vehicle
        self._pilot = pilot

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_DO_SET_MODE: CommandRow(self._set_mode, stops=is_hold),
                mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: CommandRow(self._return_home),
                mavlink.MAV_CMD_MISSION_START: CommandRow(self._start_mission),
                mavlink.MAV_CMD_DO_PAUSE_CONTINUE: CommandRow(self._pause_continue, stops=is_pause),
                mavlink.MAV_CMD_DO_CHANGE_SPEED: CommandRow(self._change_speed),
                mavlink.MAV_CMD_DO_SET_REVERSE: CommandRow(self._set_reverse, outlasts=True),
            }
        )

    def _set_mode(self, call: CommandCall) -> Handled:
        number = whole(call.param2)
        mode = None if number is None else MODES_BY_NUMBER.get(number)
        if mode is None or number is None:
            return CommandAnswer(DENIED, f"no mode {call.param2:g}: use {MODE_NAMES}")
        return self._pilot.set_mode(mode, number, call.sender)

    def _return_home(self, call: CommandCall) -> Handled:
        return self._pilot.return_home(RTL, call.sender)

    def _start_mission(self, call: CommandCall) -> Handled:
        if is_unset(call.param1) and is_unset(call.param2):
            return self._pilot.start_mission(call.sender)
        words = "first and last item must be 0: set the current item, then start"
        return CommandAnswer(DENIED, words)

    def _pause_continue(self, call: CommandCall) -> Handled:
        if call.param1 == 0.0:
            return self._pilot.hold(call.sender)
        if call.param1 == 1.0:
            return self._vehicle.control.perform(call.sender, Resume())
        return CommandAnswer(DENIED, "parameter 1 must be 0 to pause or 1 to continue")

    def _change_speed(self, call: CommandCall) -> Handled:
        kind, speed_m_s = call.param1, call.param2
        if kind == kind and kind not in GROUND_SPEEDS:
            words = "only the ground speed can be changed: parameter 1 must be 0 or 1"
            return CommandAnswer(DENIED, words)
        if speed_m_s == UNCHANGED:
            return self._vehicle.control.ensure(call.sender)
        limit = LimitDrive(None if speed_m_s == NO_LIMIT else speed_m_s)
        return self._vehicle.control.perform(call.sender, limit)

    def _set_reverse(self, call: CommandCall) -> Handled:
        if call.param1 == 0.0:
            return CommandAnswer(ACCEPTED)
        return CommandAnswer(DENIED, "the robot drives to its goals forwards only")


def is_hold(call: CommandCall) -> bool:
    """Return whether a DO_SET_MODE only stops the robot."""
    return call.param2 == Mode.HOLD


def is_pause(call: CommandCall) -> bool:
    """Return whether a DO_PAUSE_CONTINUE only stops the robot."""
    return call.param1 == 0.0


CHANGE_MODE: Final = 1
RELATIVE_YAW: Final = 2
"""Flags of parameter 2 of DO_REPOSITION."""
OUTSIDE: Final = "only in mode GUIDED"


class GuidingCommands:
    """The handlers for one vehicle."""

    def __init__(self, vehicle: MavVehicle, pilot: Pilot, drive: GuidedDrive) -> None:
        self._vehicle = vehicle
        self._pilot = pilot
        self._drive = drive

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_DO_REPOSITION: CommandRow(self._reposition),
                mavlink.MAV_CMD_NAV_SET_YAW_SPEED: CommandRow(self._yaw_and_speed),
            }
        )

    def _reposition(self, call: CommandCall) -> Handled:
        flags = whole(call.param2) or 0
        if not (flags & CHANGE_MODE or self._is_guided):
            return CommandAnswer(DENIED, f"{OUTSIDE}, or with the flag that changes the mode")
        if not call.is_global:
            return CommandAnswer(UNSUPPORTED_FRAME, f"frame {call.frame} is not global")
        try:
            goal = self._goal(call, is_relative=bool(flags & RELATIVE_YAW))
            speed_m_s = speed_in(call.param1)
        except SetpointError as error:
            return CommandAnswer(DENIED, str(error))
        return self._drive_at(speed_m_s, goal, call.sender)

    def _goal(self, call: CommandCall, *, is_relative: bool) -> Destination:
        pose = pose_in(self._vehicle.snapshot.odometry) if is_relative else None
        heading_rad = world_heading(call.param4, pose)
        origin = self._vehicle.origin
        return place_goal(origin, call.latitude_deg, call.longitude_deg, heading_rad)

    async def _drive_at(
        self, speed_m_s: float | None, goal: Destination, sender: Sender
    ) -> Answered:
        """Drive to a goal; then limit the speed of this drive alone, unless it has ended."""
        control = self._vehicle.control
        stops, answered = control.stops, await self._pilot.goto(goal, sender)
        if speed_m_s is None or not answered.ok:
            return answered
        if control.stops != stops:
            return Answered(None, OVERTAKEN)
        limited = await control.perform(sender, LimitDrive(speed_m_s, for_goal=True))
        return answered if reason_of(limited.outcome) == Reason.NO_GOAL else limited

    def _yaw_and_speed(self, call: CommandCall) -> Handled:
        if not self._is_guided:
            return CommandAnswer(FAILED, OUTSIDE)
        try:
            require_finite((call.param1, call.param2))
            angle_rad = radians(call.param1)
            heading_rad = heading_of(angle_rad)
            if call.param3 > 0.0:
                heading_rad = pose_in(self._vehicle.snapshot.odometry).heading_rad - angle_rad
        except SetpointError as error:
            return CommandAnswer(DENIED, str(error))
        velocity = Velocity(call.param2, heading_rad=heading_rad)
        return self._drive.begin(velocity, call.sender, call.now_ns)

    @property
    def _is_guided(self) -> bool:
        return self._vehicle.modes.number == Mode.GUIDED


def speed_in(value: float) -> float | None:
    """Return the speed of a DO_REPOSITION; None for one that is not set."""
    if value != value or value <= 0.0:
        return None
    require_finite((value,))
    return value
