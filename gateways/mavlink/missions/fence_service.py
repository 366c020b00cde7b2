"""The fence while driving: FENCE_STATUS, and DO_FENCE_ENABLE.

A stored fence is always in force. So "disable" deletes the fence from the robot, and "enable"
uploads the deleted fence again.
"""

from collections.abc import Sequence
from types import MappingProxyType

from gateways.mavlink.catalogue import Source
from gateways.mavlink.commands.call import Call
from gateways.mavlink.commands.results import DENIED, FAILED
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.missions.kinds import FenceKind
from gateways.mavlink.port import Answered
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from ground.client.operations import ClearFence, SetFence
from ground.missions.mission import Fence
from protocol.wire.reasons import Reason


class FenceService:
    """Counts breaches, and enables the fence."""

    handles = ()

    def __init__(self, vehicle: Vehicle, kind: FenceKind) -> None:
        self._vehicle = vehicle
        self._kind = kind
        self._disabled: tuple[Fence, ...] = ()
        self._is_breached = False
        self._breaches = 0
        self._breached_ms = 0
        number, group = mavlink.MAVLINK_MSG_ID_FENCE_STATUS, mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
        vehicle.catalogue.add(Source(number, self.messages, 1.0, 1.0, group))

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {mavlink.MAV_CMD_DO_FENCE_ENABLE: Row(self._command, outlasts=True)}
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Take no message."""

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

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

    def messages(self, now_ns: int) -> Sequence[MavMessage]:
        """Return FENCE_STATUS; nothing without the robot's status."""
        if self._vehicle.snapshot.status is None:
            return ()
        boundary, none = mavlink.FENCE_BREACH_BOUNDARY, mavlink.FENCE_BREACH_NONE
        kind = boundary if self._is_breached else none
        fields = (int(self._is_breached), self._breaches, kind, self._breached_ms)
        return (mavlink.MAVLink_fence_status_message(*fields),)

    def _command(self, call: Call, reply: Reply) -> None:
        if call.param1 not in (0.0, 1.0):
            reply.result(DENIED, "parameter 1 must be 1 to enable or 0 to disable the fence")
            return

        def then(fences: tuple[Fence, ...] | None, why: str) -> None:
            if fences is None:
                reply.result(FAILED, f"fence: {why}")
            elif call.param1 == 0.0:
                self._disable(fences, call, reply)
            else:
                self._enable(fences, call, reply)

        self._kind.copy.latest(then, call.now_ns)

    def _disable(self, fences: tuple[Fence, ...], call: Call, reply: Reply) -> None:
        def ended(answered: Answered) -> None:
            if answered.ok:
                self._disabled = fences or self._disabled
                self._kind.accepted((), answered, self._vehicle.snapshot.now_ns)
            reply.ended(answered)

        self._vehicle.perform(call.sender, ClearFence(), ended)

    def _enable(self, fences: tuple[Fence, ...], call: Call, reply: Reply) -> None:
        if fences:
            self._vehicle.control.ensure(call.sender, reply.ended)
            return
        if not self._disabled:
            reply.result(FAILED, "there is no fence: upload one")
            return
        kept = self._disabled

        def ended(answered: Answered) -> None:
            if answered.ok:
                self._kind.accepted(kept, answered, self._vehicle.snapshot.now_ns)
            reply.ended(answered)

        self._vehicle.perform(call.sender, SetFence(fence=kept[0]), ended)
