"""Signs of life: HEARTBEAT, the robot's texts, a text when it is silent, TIMESYNC and PING.

HEARTBEAT is sent once a second and at once when it changes (rows 1 and 2 of the checklist). One
that is sent because of a change does not delay the next regular one. A client does nothing before
its first heartbeat: one that has joined gets it at once, and again 0.2 s later in case that the
first is lost.
"""

from collections.abc import Sequence
from typing import Final

from gateways.mavlink import ardupilot
from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import HEARTBEAT, SILENT_NS, MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import MavMessage, TimeSync, mavlink
from gateways.mavlink.operator_control import GATEWAY_NAME
from gateways.mavlink.robot_port import NO_TELEMETRY, Snapshot
from protocol.wire.enums import Severity
from protocol.wire.reasons import Reason
from protocol.wire.statustext import StatustextAssembler
from runtime.cli.terminal import printable
from runtime.units import NS_PER_MS, NS_PER_S

PERIOD_NS: Final = NS_PER_S
AGAIN_NS: Final = 200 * NS_PER_MS


class HeartbeatStream(MavService):
    """Sends the heartbeat to all clients."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        vehicle.catalogue.add(MessageSource(HEARTBEAT, self._messages))
        self._sent: ardupilot.MavState | None = None
        self._due_ns: int | None = None
        self._live_ns = -SILENT_NS
        self._greeted: set[int] = set()
        self._again_ns: dict[int, int] = {}

    def due(self, now_ns: int) -> None:
        """Send the heartbeat if its second is over or the state has changed."""
        state = self._state(now_ns)
        newcomers = self._vehicle.clients.keys() - self._greeted
        receivers = [*newcomers, *(key for key, at_ns in self._again_ns.items() if now_ns >= at_ns)]
        is_due = self._due_ns is None or now_ns >= self._due_ns
        if is_due:
            late_ns = now_ns - (self._due_ns or now_ns)
            self._due_ns = now_ns + PERIOD_NS - (late_ns if late_ns < PERIOD_NS else 0)
        if state != self._sent or is_due:
            self._sent = state
            self._vehicle.outbox.send(state.heartbeat())
        else:
            for client in receivers:
                self._vehicle.outbox.send(state.heartbeat(), client)
        for client in receivers:
            self._again_ns.pop(client, None)
        self._again_ns |= dict.fromkeys(newcomers, now_ns + AGAIN_NS)
        self._greeted |= newcomers

    def _messages(self, now_ns: int) -> Sequence[MavMessage]:
        return (self._state(now_ns).heartbeat(),)

    def _state(self, now_ns: int) -> ardupilot.MavState:
        """Return the state; after the last status, that one for a second: it may be delayed."""
        vehicle = self._vehicle
        if vehicle.snapshot.is_live:
            self._live_ns = now_ns
        elif self._sent is not None and now_ns < self._live_ns + SILENT_NS:
            return self._sent
        number = vehicle.modes.number
        return ardupilot.state_of(vehicle.snapshot, number, was_armed=vehicle.is_armed)

    def forget(self, client: int) -> None:
        """Drop what is kept for a client that has gone."""
        self._greeted.discard(client)
        self._again_ns.pop(client, None)


class RobotTexts(MavService):
    """Joins the pieces of the robot's texts and sends each under a number of this vehicle."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._assembler = StatustextAssembler()

    def due(self, now_ns: int) -> None:
        """Forward the texts that have arrived."""
        for piece in self._vehicle.port.new_texts():
            words = self._assembler.receive(piece)
            if words:
                severity = min(max(piece.severity, Severity.EMERGENCY), Severity.DEBUG)
                self._vehicle.outbox.text(Severity(severity), words)


SILENT: Final = f"{NO_TELEMETRY}: commands are refused, but stops are sent"


def lost_words(snapshot: Snapshot) -> str:
    """Return that the robot has stopped without its operator; empty if it has not."""
    status, lease = snapshot.status, snapshot.lease
    if status is None or lease is None or status.vehicle_reason != Reason.OPERATOR_LOST:
        return ""
    driver = printable(lease.driver) or "its operator"
    what = "goal ABORTED" if status.goal_reason == Reason.OPERATOR_LOST else "drive ended"
    who = f"{driver}, or its gateway," if driver.startswith(GATEWAY_NAME) else driver
    return f"{what}: {who} fell silent; arm again to go on"


class SilenceTexts(MavService):
    """Says why nothing is live any more, and to a client that comes back why its drive ended."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._heard_ns: int | None = None
        self._told: set[int] = set()
        self._informed: set[int] = set()

    def due(self, now_ns: int) -> None:
        """Send a text if the telemetry has ended or is back, or if a client is new."""
        vehicle = self._vehicle
        if vehicle.snapshot.lease is not None and vehicle.snapshot.is_live:
            for client in vehicle.clients.keys() - self._informed:
                if words := lost_words(vehicle.snapshot):
                    vehicle.outbox.text(Severity.CRITICAL, words, client)
            self._informed = set(vehicle.clients)
        if self._heard_ns is None:
            self._heard_ns = now_ns
        if vehicle.snapshot.is_live:
            seconds = (now_ns - self._heard_ns) / NS_PER_S
            for client in self._told:
                words = f"telemetry arrives again, after {seconds:.0f} s"
                vehicle.outbox.text(Severity.NOTICE, words, client)
            self._heard_ns = now_ns
            self._told.clear()
        elif now_ns - self._heard_ns >= SILENT_NS:
            for client in vehicle.clients.keys() - self._told:
                vehicle.outbox.text(Severity.CRITICAL, SILENT, client)
                self._told.add(client)

    def forget(self, client: int) -> None:
        """Drop what is kept for a client that has disconnected."""
        self._told.discard(client)
        self._informed.discard(client)


EVERYONE: Final = 0


class ClockSync(MavService):
    """Answers with the time of the messages of this vehicle."""

    handles = (mavlink.MAVLINK_MSG_ID_TIMESYNC, mavlink.MAVLINK_MSG_ID_PING)

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Answer a request; note an answer to one of this vehicle."""
        answer = None
        if message.get_msgId() == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            if message.tc1 == 0:
                boot_ns = self._vehicle.boot_ns(now_ns)
                answer = TimeSync(boot_ns, message.ts1, sender.system, sender.component)
        elif message.target_system == EVERYONE == message.target_component:
            fields = (message.time_usec, message.seq, sender.system, sender.component)
            answer = mavlink.MAVLink_ping_message(*fields)
        elif message.target_system == self._vehicle.system:
            self._vehicle.control.answered(sender)
        if answer is not None:
            self._vehicle.outbox.send(answer, sender.client)
