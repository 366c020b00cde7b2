"""Commands for GUIDED: a place to drive to, or a heading and a speed."""

from math import radians
from types import MappingProxyType
from typing import Final

from gateways.mavlink.commands.call import Call, whole
from gateways.mavlink.commands.results import DENIED, FAILED, UNSUPPORTED_FRAME
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import mavlink
from gateways.mavlink.frames.ned import heading_of
from gateways.mavlink.motion.guided_drive import GuidedDrive
from gateways.mavlink.motion.pilot import Pilot
from gateways.mavlink.motion.setpoints import (
    SetpointError,
    place_goal,
    pose_in,
    require_finite,
    world_heading,
)
from gateways.mavlink.motion.velocity import SPEED, Velocity
from gateways.mavlink.port import OVERTAKEN, Answered
from gateways.mavlink.vehicle import Vehicle
from ground.client.goal import Destination
from ground.client.operations import SetParameter
from protocol.wire.enums import Mode

CHANGE_MODE: Final = 1
RELATIVE_YAW: Final = 2
"""Flags of parameter 2 of DO_REPOSITION."""
OUTSIDE: Final = "only in mode GUIDED"


class GuidingCommands:
    """The handlers for one vehicle."""

    def __init__(self, vehicle: Vehicle, pilot: Pilot, drive: GuidedDrive) -> None:
        self._vehicle = vehicle
        self._pilot = pilot
        self._drive = drive

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_DO_REPOSITION: Row(self._reposition),
                mavlink.MAV_CMD_NAV_SET_YAW_SPEED: Row(self._yaw_and_speed),
            }
        )

    def _reposition(self, call: Call, reply: Reply) -> None:
        flags = whole(call.param2) or 0
        if not (flags & CHANGE_MODE or self._is_guided):
            reply.result(DENIED, f"{OUTSIDE}, or with the flag that changes the mode")
            return
        if not call.is_global:
            reply.result(UNSUPPORTED_FRAME, f"frame {call.frame} is not global")
            return
        try:
            goal = self._goal(call, is_relative=bool(flags & RELATIVE_YAW))
            speed_m_s = speed_in(call.param1)
        except SetpointError as error:
            reply.result(DENIED, str(error))
            return
        if speed_m_s is None:
            self._pilot.goto(goal, call.sender, reply.ended)
        else:
            self._drive_at(speed_m_s, goal, call, reply)

    def _goal(self, call: Call, *, is_relative: bool) -> Destination:
        pose = pose_in(self._vehicle.snapshot.odometry) if is_relative else None
        heading_rad = world_heading(call.param4, pose)
        origin = self._vehicle.origin
        return place_goal(origin, call.latitude_deg, call.longitude_deg, heading_rad)

    def _drive_at(self, speed_m_s: float, goal: Destination, call: Call, reply: Reply) -> None:
        control = self._vehicle.control
        stops = control.stops

        def limited(answered: Answered) -> None:
            if answered.ok and control.stops != stops:
                reply.ended(Answered(None, OVERTAKEN))
            elif answered.ok:
                self._pilot.goto(goal, call.sender, reply.ended)
            else:
                reply.ended(answered)

        self._vehicle.perform(call.sender, SetParameter(name=SPEED, value=speed_m_s), limited)

    def _yaw_and_speed(self, call: Call, reply: Reply) -> None:
        if not self._is_guided:
            reply.result(FAILED, OUTSIDE)
            return
        try:
            require_finite((call.param1, call.param2))
            angle_rad = radians(call.param1)
            heading_rad = heading_of(angle_rad)
            if call.param3 > 0.0:
                heading_rad = pose_in(self._vehicle.snapshot.odometry).heading_rad - angle_rad
        except SetpointError as error:
            reply.result(DENIED, str(error))
            return

        def ensured(answered: Answered) -> None:
            if answered.ok:
                velocity = Velocity(call.param2, heading_rad=heading_rad)
                self._drive.follow(velocity, call.sender, call.now_ns)
            reply.ended(answered)

        self._vehicle.control.ensure(call.sender, ensured)

    @property
    def _is_guided(self) -> bool:
        return self._vehicle.modes.number == Mode.GUIDED


def speed_in(value: float) -> float | None:
    """Return the speed of a DO_REPOSITION; None for one that is not set."""
    if value != value or value <= 0.0:
        return None
    require_finite((value,))
    return value
