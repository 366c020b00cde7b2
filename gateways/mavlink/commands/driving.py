"""Commands that choose a mode, start or pause a drive, or limit its speed."""

from types import MappingProxyType
from typing import Final

from gateways.mavlink.ardupilot import MODES_BY_NUMBER, RTL
from gateways.mavlink.commands.call import Call, is_unset, whole
from gateways.mavlink.commands.results import ACCEPTED, DENIED
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import mavlink
from gateways.mavlink.motion.pilot import Pilot
from gateways.mavlink.motion.velocity import SPEED
from gateways.mavlink.vehicle import Vehicle
from ground.client.operations import ResetParameter, Resume, SetParameter
from protocol.wire.enums import Mode

UNCHANGED: Final = -1
DEFAULT: Final = -2
GROUND_SPEEDS: Final = (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED)
MODE_NAMES: Final = "MANUAL 0, HOLD 4, AUTO 10, RTL 11, SMART_RTL 12, GUIDED 15"


class DrivingCommands:
    """The handlers, on one pilot."""

    def __init__(self, vehicle: Vehicle, pilot: Pilot) -> None:
        self._vehicle = vehicle
        self._pilot = pilot

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_DO_SET_MODE: Row(self._set_mode, stops=is_hold),
                mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Row(self._return_home),
                mavlink.MAV_CMD_MISSION_START: Row(self._start_mission),
                mavlink.MAV_CMD_DO_PAUSE_CONTINUE: Row(self._pause_continue, stops=is_pause),
                mavlink.MAV_CMD_DO_CHANGE_SPEED: Row(self._change_speed, outlasts=True),
                mavlink.MAV_CMD_DO_SET_REVERSE: Row(self._set_reverse, outlasts=True),
            }
        )

    def _set_mode(self, call: Call, reply: Reply) -> None:
        number = whole(call.param2)
        mode = None if number is None else MODES_BY_NUMBER.get(number)
        if mode is None or number is None:
            reply.result(DENIED, f"no mode {call.param2:g}: use {MODE_NAMES}")
        else:
            self._pilot.set_mode(mode, number, call.sender, reply.ended)

    def _return_home(self, call: Call, reply: Reply) -> None:
        self._pilot.return_home(RTL, call.sender, reply.ended)

    def _start_mission(self, call: Call, reply: Reply) -> None:
        if is_unset(call.param1) and is_unset(call.param2):
            self._pilot.start_mission(call.sender, reply.ended)
        else:
            words = "first and last item must be 0: set the current item, then start"
            reply.result(DENIED, words)

    def _pause_continue(self, call: Call, reply: Reply) -> None:
        if call.param1 == 0.0:
            self._pilot.hold(call.sender, reply.ended)
        elif call.param1 == 1.0:
            self._vehicle.perform(call.sender, Resume(), reply.ended)
        else:
            reply.result(DENIED, "parameter 1 must be 0 to pause or 1 to continue")

    def _change_speed(self, call: Call, reply: Reply) -> None:
        kind, speed_m_s = call.param1, call.param2
        if kind == kind and kind not in GROUND_SPEEDS:
            reply.result(DENIED, "only the ground speed can be changed: parameter 1 must be 0 or 1")
        elif speed_m_s == UNCHANGED:
            self._vehicle.control.ensure(call.sender, reply.ended)
        elif speed_m_s == DEFAULT:
            self._vehicle.perform(call.sender, ResetParameter(name=SPEED), reply.ended)
        else:
            self._vehicle.perform(
                call.sender, SetParameter(name=SPEED, value=speed_m_s), reply.ended
            )

    def _set_reverse(self, call: Call, reply: Reply) -> None:
        if call.param1 == 0.0:
            reply.result(ACCEPTED)
        else:
            reply.result(DENIED, "the robot drives to its goals forwards only")


def is_hold(call: Call) -> bool:
    """Return whether a DO_SET_MODE only stops the robot."""
    return call.param2 == Mode.HOLD


def is_pause(call: Call) -> bool:
    """Return whether a DO_PAUSE_CONTINUE only stops the robot."""
    return call.param1 == 0.0
