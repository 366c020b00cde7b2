"""Publish the robot's output: wheel command first, then odometry, status, decision and events."""

from typing import Final

from protocol.bus.bus import Bus
from protocol.bus.mailbox import MAX_STAMP_NS
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    CYCLE,
    DECISION,
    DRIVE,
    HEARTBEAT,
    INPUTS,
    LEASE,
    MCU,
    MISSION,
    ODOMETRY,
    STATUS,
    TEXT,
)
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.message import Message
from protocol.wire.messages import WheelCommand
from robot import telemetry
from robot.core.values import Outputs, now_ms_of
from robot.vehicle import Vehicle
from runtime.units import NS_PER_MS, UINT32

SIGN_OF_LIFE_NS: Final = 300 * NS_PER_MS
"""Longest time between two heartbeats on the clock of the bus. Simulated time may be slower."""


class Reports:
    """Publishers of one robot; `epoch` is the start time of its process (see WHEEL_COMMAND)."""

    def __init__(self, bus: Bus, epoch: int = 0) -> None:
        self._epoch = epoch
        self.drive = bus.publisher(DRIVE)
        self.heartbeat = bus.publisher(HEARTBEAT)
        self.odometry = bus.publisher(ODOMETRY)
        self.status = bus.publisher(STATUS)
        self.decision = bus.publisher(DECISION)
        self.cycle = bus.publisher(CYCLE)
        self.mcu = bus.publisher(MCU)
        self.inputs = bus.publisher(INPUTS)
        self.lease = bus.publisher(LEASE)
        self.mission = bus.publisher(MISSION)
        self.text = bus.publisher(TEXT)
        self.commanded = bus.publisher(COMMANDED)
        self.answered = bus.publisher(ANSWERED)
        self._now_ns = bus.now_ns
        self._beat_ns = 0
        self._commands = 0
        self.recorded = 0

    def command(self, stamp_ns: int, sense_seq: int, left_mrad_s: int, right_mrad_s: int) -> None:
        """Publish wheel speeds, in force until the next command or until they expire."""
        self._command(stamp_ns, sense_seq, left_mrad_s, right_mrad_s, MAX_WHEEL_TTL_MS)

    def brake(self, stamp_ns: int, sense_seq: int) -> None:
        """Publish a command with no time-to-live, which stops the wheels at once.

        It is sent whatever the stamp is, because a bad stamp may have ended the loop. The stamp is
        reduced to the range that the plant accepts.
        """
        self._command(stamp_ns % MAX_STAMP_NS, sense_seq, 0, 0, 0)

    def _command(
        self, stamp_ns: int, sense_seq: int, left_mrad_s: int, right_mrad_s: int, ttl_ms: int
    ) -> None:
        self.drive.put(
            WheelCommand(
                time_ns=stamp_ns,
                seq=self._commands,
                sense_seq=sense_seq & UINT32,
                epoch=self._epoch,
                left_mrad_s=left_mrad_s,
                right_mrad_s=right_mrad_s,
                ttl_ms=ttl_ms,
            )
        )
        self._commands = (self._commands + 1) & UINT32

    def tick(self, vehicle: Vehicle, outputs: Outputs, stamp_ns: int, now_ns: int) -> None:
        """Publish the pose, the state, the navigation decision, and the cost on a board."""
        self.odometry.put(telemetry.odometry(vehicle.state, stamp_ns))
        self.state(vehicle, stamp_ns, now_ns)
        self.decision.put(telemetry.decision(outputs, vehicle.zone_m, stamp_ns))
        board = vehicle.core.board_status(stamp_ns)
        if board is not None:
            self.mcu.put(board)

    def state(self, vehicle: Vehicle, stamp_ns: int, now_ns: int) -> None:
        """Publish vehicle, mode and goal."""
        commands, now_ms = vehicle.commands, now_ms_of(now_ns)
        status = telemetry.status(
            vehicle.state, commands.goal_id, stamp_ns, now_ms, commands.take_shown_stop()
        )
        self.status.put(status)

    def events(self, vehicle: Vehicle, stamp_ns: int, now_ns: int) -> None:
        """Publish what is independent of ticks: heartbeat, lease, mission and new texts."""
        self._beat(vehicle, now_ns)
        lease = vehicle.lease_status(stamp_ns, now_ns)
        if lease is not None:
            self.lease.put(lease)
        mission = vehicle.mission_status(stamp_ns, now_ns)
        if mission is not None:
            self.mission.put(mission)
        for text in vehicle.texts():
            self.text.put(text)

    def _beat(self, vehicle: Vehicle, now_ns: int) -> None:
        """Publish a due heartbeat; with a slow or paused simulated time, also in wall time."""
        beat, wall_ns = vehicle.heartbeat(now_ns), self._now_ns()
        if beat is None and wall_ns - self._beat_ns >= SIGN_OF_LIFE_NS:
            beat = telemetry.heartbeat(vehicle.state)
        if beat is not None:
            self._beat_ns = wall_ns
            self.heartbeat.put(beat)

    def record(self, request: Message, answer: Message) -> None:
        """Publish a request with its answer, for recordings, and count it."""
        if type(request) in COMMANDED.messages:
            self.recorded = (self.recorded + 1) & UINT32
            self.commanded.put(request)
            self.answered.put(answer)
