"""The plans while driving: the current item, reached items, and breaches of the fence.

Items are numbered as in MAVLink: 0 is home, so the mission begins at 1. A client that chooses 0
chooses the first waypoint, and receives 0 until the mission runs. A stored fence is always in
force. So "disable" deletes the fence from the robot, and "enable" uploads the deleted fence again.
"""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Final

from gateways.mavlink.commands.command_protocol import (
    DENIED,
    FAILED,
    CommandAnswer,
    CommandCall,
    CommandRow,
    CommandTable,
    Handled,
    answer_to,
    whole,
)
from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCurrent, mavlink
from gateways.mavlink.missions.plan_answers import ClientKey, key_of, refusal_of
from gateways.mavlink.missions.plan_kinds import FenceKind, MissionKind
from gateways.mavlink.robot_port import Answered
from ground.client.requests import CROSSING_NS
from ground.commands.fence import ClearFence, SetFence
from ground.commands.mission import JumpTo
from ground.missions.mission import Fence, MavlinkItem
from protocol.wire.enums import Command, MissionState, Mode
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

NO_TOTAL: Final = 0xFFFF
MAX_ITEM: Final = 0xFFFF
MAX_WAITING: Final = 8
"""Jumps that wait for the robot."""
FIRST: Final = 1
STATES: Final = MappingProxyType(
    {
        MissionState.NONE: mavlink.MISSION_STATE_NO_MISSION,
        MissionState.READY: mavlink.MISSION_STATE_NOT_STARTED,
        MissionState.RUNNING: mavlink.MISSION_STATE_ACTIVE,
        MissionState.HOLDING: mavlink.MISSION_STATE_ACTIVE,
        MissionState.PAUSED: mavlink.MISSION_STATE_PAUSED,
        MissionState.DONE: mavlink.MISSION_STATE_COMPLETE,
        MissionState.FAILED: mavlink.MISSION_STATE_NOT_STARTED,
    }
)
"""The MISSION_STATE of each state. A mission that has failed can be started again."""
UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING)
NEVER_REACHED: Final = (Command.DO_JUMP, Command.DO_CHANGE_SPEED)
IN_MISSION_MODE: Final = 1
SUSPENDED: Final = 2


class CurrentItem(MavService):
    """Chooses the current item, and sends it on request, after a change, and periodically."""

    handles = (mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT,)

    def __init__(self, vehicle: MavVehicle, mission: MissionKind, fence: FenceKind) -> None:
        self.jumped_ns = -CROSSING_NS
        self._vehicle = vehicle
        self._mission = mission
        self._fence = fence
        self._chosen: int | None = None
        self._of_mission = 0
        self._sent: tuple[int, ...] | None = None
        self._waiting: set[ClientKey] = set()
        number, group = MissionCurrent.id, mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
        vehicle.catalogue.add(MessageSource(number, self.messages, 1.0, 1.0, group))

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: CommandRow(self._command, outlasts=True)}
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Choose an item; a refusal is a STATUSTEXT, as there is no acknowledgement."""
        client = key_of(sender)
        if client in self._waiting or len(self._waiting) >= MAX_WAITING:
            return
        self._waiting.add(client)
        self._vehicle.start(self._jump(message.seq, sender))

    async def _jump(self, item: int, sender: Sender) -> None:
        answered = await self._choose(item, sender)
        self._waiting.discard(key_of(sender))
        if not answered.ok:
            words = refusal_of(answered, f"mission item {item}", 0).words
            self._vehicle.refusals.say(words, sender.client, self._vehicle.snapshot.now_ns)

    async def _choose(self, item: int, sender: Sender) -> Answered:
        """Make an item the current one, and send MISSION_CURRENT if the robot accepts."""
        answered = await self._vehicle.control.perform(sender, JumpTo(item=max(item, FIRST)))
        if answered.ok:
            snapshot = self._vehicle.snapshot
            self._chosen, self.jumped_ns = item, snapshot.now_ns
            self._of_mission = 0 if snapshot.mission is None else snapshot.mission.mission_id
            self._announce()
        return answered

    def due(self, now_ns: int) -> None:
        """Read the robot's mission status, and send changes."""
        status = self._vehicle.snapshot.mission
        if self._chosen is not None and not self._is_still_shown(status, now_ns):
            self._chosen = None
        if status is not None and self._facts(status) != self._sent:
            self._announce()

    def forget(self, client: int) -> None:
        """Do nothing: the robot's answer ends a jump."""

    def messages(self, now_ns: int) -> Sequence[MavMessage]:
        """Return MISSION_CURRENT; nothing without the robot's mission status."""
        status = self._vehicle.snapshot.mission
        return () if status is None else (MissionCurrent(*self._facts(status), 0),)

    def _announce(self) -> None:
        status = self._vehicle.snapshot.mission
        if status is not None:
            self._sent = self._facts(status)
            self._vehicle.outbox.send(MissionCurrent(*self._sent, 0))

    def _facts(self, status: MissionStatus) -> tuple[int, ...]:
        """Return all fields of MISSION_CURRENT but the id of the rally points."""
        mode, chosen = self._vehicle.modes.mode, self._chosen
        item = status.current + FIRST if status.count else 0
        state = MissionState(status.state) if status.state in STATES else MissionState.NONE
        mission, fence = self._mission, self._fence
        return (
            item if chosen is None else chosen,
            status.count or NO_TOTAL,
            STATES[state],
            IN_MISSION_MODE if mode == Mode.AUTO else SUSPENDED,
            mission.id_of(mission.copy.values or ()),
            fence.id_of(fence.copy.values or ()),
        )

    def is_reached(self, index: int) -> bool:
        """Return whether an item of the robot, from 0, can be reached."""
        steps = self._mission.copy.values or ()
        step = steps[index] if index < len(steps) else None
        return not isinstance(step, MavlinkItem) or step.command not in NEVER_REACHED

    def _is_still_shown(self, status: MissionStatus | None, now_ns: int) -> bool:
        if status is None or status.mission_id != self._of_mission:
            return False
        if now_ns < self.jumped_ns + CROSSING_NS:
            return True
        is_first = status.current == 0 and status.state not in UNDER_WAY
        return self._chosen == 0 and is_first

    def _command(self, call: CommandCall) -> Handled:
        item = whole(call.param1)
        if item is None or not 0 <= item <= MAX_ITEM:
            return CommandAnswer(DENIED, "parameter 1 must be the number of an item")
        return self._choose(item, call.sender)


AGAIN_NS: Final = NS_PER_S
COPIES: Final = 4
"""Number of repetitions of the message: MAVSDK does not finish a mission before it receives one."""


class ReachedItems(MavService):
    """Sends each item that is reached, after a change of the robot's mission status.

    The robot waits at an item, starts another one, or has finished the last one. A jump by another
    operator looks like the second case. Jumps and changes of speed are not reached.
    """

    def __init__(self, vehicle: MavVehicle, current: CurrentItem) -> None:
        self._vehicle = vehicle
        self._current = current
        self._last: MissionStatus | None = None
        self._reached: int | None = None
        self._copies = 0
        self._next_ns = 0

    def due(self, now_ns: int) -> None:
        """Find reached items, and repeat the message some times."""
        last, status = self._last, self._vehicle.snapshot.mission
        self._last = status
        if status is None or last is None or status.mission_id != last.mission_id:
            self._reached, self._copies = None, 0
        else:
            index = self._index(last, status, now_ns)
            if index is not None and index != self._reached:
                self._reached, self._copies, self._next_ns = index, COPIES, now_ns
            elif status.state == MissionState.RUNNING and self._reached == status.current:
                self._reached = None  # the robot drives to it once more
        if self._copies and now_ns >= self._next_ns:
            self._send(now_ns)

    def _index(self, last: MissionStatus, status: MissionStatus, now_ns: int) -> int | None:
        """Return the index of the item that has been reached between two states."""
        if status.state == MissionState.HOLDING:
            return status.current
        if status.state == MissionState.DONE and last.state != MissionState.DONE:
            return status.current
        has_jumped = now_ns < self._current.jumped_ns + CROSSING_NS
        has_left = status.current != last.current and self._current.is_reached(last.current)
        was_under_way = last.state in UNDER_WAY and status.state in UNDER_WAY
        return last.current if has_left and was_under_way and not has_jumped else None

    def _send(self, now_ns: int) -> None:
        self._copies, self._next_ns = self._copies - 1, now_ns + AGAIN_NS
        item = 0 if self._reached is None else self._reached + 1
        self._vehicle.outbox.send(mavlink.MAVLink_mission_item_reached_message(item))


class FenceService(MavService):
    """Counts breaches, and enables the fence."""

    def __init__(self, vehicle: MavVehicle, kind: FenceKind) -> None:
        self._vehicle = vehicle
        self._kind = kind
        self._disabled: tuple[Fence, ...] = ()
        self._is_breached = False
        self._breaches = 0
        self._breached_ms = 0
        number, group = mavlink.MAVLINK_MSG_ID_FENCE_STATUS, mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
        vehicle.catalogue.add(MessageSource(number, self.messages, 1.0, 1.0, group))

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {mavlink.MAV_CMD_DO_FENCE_ENABLE: CommandRow(self._command, outlasts=True)}
        )

    def due(self, now_ns: int) -> None:
        """Count a breach, and send it at once."""
        if self._kind.copy.values is not None:
            self._vehicle.has_fence = bool(self._kind.copy.values)
        status = self._vehicle.snapshot.status
        if status is None:
            return
        is_breached = status.vehicle_reason == Reason.FENCE_BREACHED
        if is_breached and not self._is_breached:
            self._breaches = min(self._breaches + 1, 0xFFFF)
            self._breached_ms = self._vehicle.boot_ms(now_ns)
        if is_breached != self._is_breached:
            self._is_breached = is_breached
            for message in self.messages(now_ns):
                self._vehicle.outbox.send(message)

    def messages(self, now_ns: int) -> Sequence[MavMessage]:
        """Return FENCE_STATUS; nothing without the robot's status."""
        if self._vehicle.snapshot.status is None:
            return ()
        boundary, none = mavlink.FENCE_BREACH_BOUNDARY, mavlink.FENCE_BREACH_NONE
        kind = boundary if self._is_breached else none
        fields = (int(self._is_breached), self._breaches, kind, self._breached_ms)
        return (mavlink.MAVLink_fence_status_message(*fields),)

    def _command(self, call: CommandCall) -> Handled:
        if call.param1 in (0.0, 1.0):
            return self._change(call)
        words = "parameter 1 must be 1 to enable or 0 to disable the fence"
        return CommandAnswer(DENIED, words)

    async def _change(self, call: CommandCall) -> CommandAnswer:
        try:
            fences = await self._kind.copy.latest(call.now_ns)
        except RemoteError as error:
            return CommandAnswer(FAILED, f"fence: {error}")
        vehicle, sender = self._vehicle, call.sender
        if call.param1 == 0.0:
            answered = await vehicle.control.perform(sender, ClearFence())
            if answered.ok:
                self._disabled = fences or self._disabled
                self._kind.accepted((), answered, vehicle.snapshot.now_ns)
        elif fences:
            answered = await vehicle.control.ensure(sender)
        elif self._disabled:
            kept = self._disabled
            answered = await vehicle.control.perform(sender, SetFence(fence=kept[0]))
            if answered.ok:
                self._kind.accepted(kept, answered, vehicle.snapshot.now_ns)
        else:
            return CommandAnswer(FAILED, "there is no fence: upload one")
        return answer_to(answered)
