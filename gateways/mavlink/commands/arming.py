"""Arming, its checks, and the emergency stop.

Disarming and the emergency stop need no control. DO_FLIGHTTERMINATION with parameter 1 = 0 clears
the stop, and so does forced arming; both need control.
"""

from types import MappingProxyType
from typing import Final

from gateways.mavlink.ardupilot import FORCE
from gateways.mavlink.commands.call import Call
from gateways.mavlink.commands.results import ACCEPTED, DENIED, LATER, result_of
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import mavlink
from gateways.mavlink.port import Answered, Done
from gateways.mavlink.prearm import faults
from gateways.mavlink.vehicle import Vehicle
from ground.client.operations import Arm, ClearEmergencyStop, Disarm
from protocol.wire.enums import Severity
from protocol.wire.enums import Vehicle as VehicleState

PREARM: Final = "PreArm: "
"""The prefix by which clients recognise why a robot cannot be armed."""
REFUSED: Final = "refused: "


class ArmingCommands:
    """The handlers for one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._pressed_id: int | None = None

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_COMPONENT_ARM_DISARM: Row(self._arm_disarm, stops=is_disarm),
                mavlink.MAV_CMD_RUN_PREARM_CHECKS: Row(self._check, reads=True),
                mavlink.MAV_CMD_DO_FLIGHTTERMINATION: Row(
                    self._terminate, stops=is_termination, is_unlimited=True
                ),
            }
        )

    def _arm_disarm(self, call: Call, reply: Reply) -> None:
        is_forced = call.param2 in FORCE
        if call.param1 == 1.0:
            self._arm(call, reply, is_forced=is_forced)
        elif call.param1 == 0.0:
            self._vehicle.perform(call.sender, Disarm(), reply.ended)
        else:
            reply.result(DENIED, "parameter 1 must be 1 to arm or 0 to disarm")

    def _arm(self, call: Call, reply: Reply, *, is_forced: bool) -> None:
        def ended(answered: Answered) -> None:
            words = "" if answered.ok else f"{PREARM}{answered.text.removeprefix(REFUSED)}"
            reply.result(result_of(answered), words, Severity.CRITICAL)

        def arm(answered: Answered) -> None:
            if answered.ok:
                self._vehicle.perform(call.sender, Arm(), ended)
            else:
                ended(answered)

        status = self._vehicle.snapshot.status
        is_stopped = status is not None and status.vehicle == VehicleState.EMERGENCY_STOP
        if is_forced and is_stopped:
            self._clear(call, reply, arm)
        else:
            self._vehicle.perform(call.sender, Arm(), ended)

    def _clear(self, call: Call, reply: Reply, done: Done) -> None:
        """Release the newest stop seen now: the request waits for those before.

        A stop that a client has just pressed may be acknowledged before the status shows it.
        """
        known = (self._vehicle.stop_id, self._pressed_id)
        stop_ids = tuple(one for one in known if one is not None)
        if not stop_ids:
            reply.result(LATER, "no status of the robot has named an emergency stop yet")
        else:
            self._vehicle.perform(call.sender, ClearEmergencyStop(stop_ids=stop_ids), done)

    def _stop(self, reply: Reply) -> None:
        self._pressed_id = self._vehicle.port.stop(reply.ended)

    def _check(self, call: Call, reply: Reply) -> None:
        status = self._vehicle.snapshot.status
        if status is not None and status.vehicle == VehicleState.ACTIVE:
            reply.result(LATER, "already armed")
            return
        for fault in faults(self._vehicle.snapshot):
            words, client = f"{PREARM}{fault}", call.sender.client
            self._vehicle.refusals.say(words, client, call.now_ns, Severity.CRITICAL)
        reply.result(ACCEPTED)

    def _terminate(self, call: Call, reply: Reply) -> None:
        if is_termination(call):
            self._stop(reply)
        elif call.param1 == 0.0:
            self._clear(call, reply, reply.ended)
        else:
            reply.result(DENIED, "parameter 1 must be 1 to stop or 0 to clear the emergency stop")


def is_disarm(call: Call) -> bool:
    """Return whether a COMPONENT_ARM_DISARM only stops the robot."""
    return call.param1 == 0.0


def is_termination(call: Call) -> bool:
    """Return whether a DO_FLIGHTTERMINATION stops the robot, as more than 0.5 does."""
    return call.param1 > 0.5
