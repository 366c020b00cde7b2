"""The current item: MISSION_CURRENT, MISSION_SET_CURRENT and DO_SET_MISSION_CURRENT.

Items are numbered as in MAVLink: 0 is home, so the mission begins at 1. A client that chooses 0
chooses the first waypoint, and receives 0 until the mission runs.
"""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Final

from gateways.mavlink.catalogue import Source
from gateways.mavlink.commands.call import Call, whole
from gateways.mavlink.commands.results import DENIED
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import MavMessage, MissionCurrent, mavlink
from gateways.mavlink.missions.clients import ClientKey, key_of
from gateways.mavlink.missions.kinds import FenceKind, MissionKind
from gateways.mavlink.missions.results import refusal_of
from gateways.mavlink.port import Answered, Done
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from ground.client.operations import JumpTo
from protocol.wire.enums import MissionState, Mode
from protocol.wire.messages import MissionStatus
from runtime.units import NS_PER_MS

CROSSING_NS: Final = 300 * NS_PER_MS
"""A status sent before a jump may arrive up to this time after it."""
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
IN_MISSION_MODE: Final = 1
SUSPENDED: Final = 2


class CurrentItem:
    """Chooses the current item, and sends it on request, after a change, and periodically."""

    handles = (mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT,)

    def __init__(self, vehicle: Vehicle, mission: MissionKind, fence: FenceKind) -> None:
        self.jumped_ns = -CROSSING_NS
        self._vehicle = vehicle
        self._mission = mission
        self._fence = fence
        self._chosen: int | None = None
        self._of_mission = 0
        self._sent: tuple[int, ...] | None = None
        self._waiting: set[ClientKey] = set()
        number, group = MissionCurrent.id, mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
        vehicle.catalogue.add(Source(number, self.messages, 1.0, 1.0, group))

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: Row(self._command, outlasts=True)}
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Choose an item; a refusal is a STATUSTEXT, as there is no acknowledgement."""
        client = key_of(sender)
        if client in self._waiting or len(self._waiting) >= MAX_WAITING:
            return
        self._waiting.add(client)

        def ended(answered: Answered) -> None:
            self._waiting.discard(client)
            if not answered.ok:
                words = refusal_of(answered, f"mission item {message.seq}", 0).words
                self._vehicle.refusals.say(words, sender.client, self._vehicle.snapshot.now_ns)

        self.choose(message.seq, sender, ended)

    def choose(self, item: int, sender: Sender, done: Done) -> None:
        """Make an item the current one, and send MISSION_CURRENT if the robot accepts."""

        def ended(answered: Answered) -> None:
            if answered.ok:
                snapshot = self._vehicle.snapshot
                self._chosen, self.jumped_ns = item, snapshot.now_ns
                self._of_mission = 0 if snapshot.mission is None else snapshot.mission.mission_id
                self._announce()
            done(answered)

        self._vehicle.perform(sender, JumpTo(item=max(item, FIRST)), ended)

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

    def _is_still_shown(self, status: MissionStatus | None, now_ns: int) -> bool:
        if status is None or status.mission_id != self._of_mission:
            return False
        if now_ns < self.jumped_ns + CROSSING_NS:
            return True
        is_first = status.current == 0 and status.state not in UNDER_WAY
        return self._chosen == 0 and is_first

    def _command(self, call: Call, reply: Reply) -> None:
        item = whole(call.param1)
        if item is None or not 0 <= item <= MAX_ITEM:
            reply.result(DENIED, "parameter 1 must be the number of an item")
        else:
            self.choose(item, call.sender, reply.ended)
