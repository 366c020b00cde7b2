"""Publish the robot's output: wheel command first, then odometry, status, decision and events.

An answer is withheld until the files that it depends on are written.
"""

from typing import Any, Final, NamedTuple, TypeVar

from protocol.bus.bus import Bus
from protocol.bus.mailbox import MAX_STAMP_NS
from protocol.bus.publisher import Publisher
from protocol.bus.services import ServiceRequest, refusal
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
    SUMMARIES,
    SUMMARY_HZ,
    TEXT,
    Topic,
)
from protocol.wire.enums import INPUT_SCAN, INPUT_WHEELS, AckResult, Severity
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, NavigatorStatus, TickInputs, WheelCommand
from robot import telemetry
from robot.core import reasons
from robot.core.values import Outputs, now_ms_of
from robot.file_writer import StateFile, Ticket
from robot.vehicle import Answer, RobotVehicle, not_saved, once_saved
from runtime.units import NS_PER_MS, NS_PER_S, UINT32

M = TypeVar("M", bound=Message)

SIGN_OF_LIFE_NS: Final = 300 * NS_PER_MS
"""Longest time between two heartbeats on the clock of the bus. Simulated time may be slower."""
SENSES: Final = INPUT_SCAN | INPUT_WHEELS
SUMMARY_NS: Final = round(NS_PER_S / SUMMARY_HZ)


class Together:
    """Sends what is put within a block at its end, in a row; outside of it, at once.

    The bus sends in a thread of its own, which then wakes up once instead of for each frame, and
    has them leave in one packet.
    """

    def __init__(self) -> None:
        self._frames: list[tuple[Publisher[Any], bytes]] = []
        self._is_open = False

    def put(self, publisher: Publisher[M], message: M) -> None:
        """Encode a message, and send it or let it wait for the end of the block."""
        if self._is_open:
            self._frames.append((publisher, publisher.frame(message)))
        else:
            publisher.put(message)

    def __enter__(self) -> None:
        self._is_open = True

    def __exit__(self, *_: object) -> None:
        frames, self._frames, self._is_open = self._frames, [], False
        for publisher, frame in frames:
            publisher.put_frame(frame)


class Summary:
    """Repeats state, pose and inputs for stations that watch many robots.

    It is paced by the clock of the bus, and so it is a sign of life in simulated time, too.
    """

    def __init__(self, bus: Bus, together: Together) -> None:
        self._publishers = {path: bus.publisher(topic) for path, topic in SUMMARIES.items()}
        self._together = together
        self._now_ns = bus.now_ns
        self._status: NavigatorStatus | None = None
        self._state: tuple[int, ...] = ()
        self._sent_ns = 0
        self.wants_inputs = False
        """True until the inputs of the summary are known, too."""
        self._were_missing = False

    def take(self, status: NavigatorStatus) -> None:
        """Keep the newest status."""
        self._status = status

    def publish(self, vehicle: RobotVehicle, stamp_ns: int) -> None:
        """Publish status and pose if half a second has gone by, or the state has changed."""
        status, now_ns = self._status, self._now_ns()
        if status is None:
            return
        state = status.vehicle, status.mode, status.goal, status.goal_id, status.stop_id
        if state == self._state and now_ns - self._sent_ns < SUMMARY_NS:
            return
        self._state, self._sent_ns, self.wants_inputs = state, now_ns, True
        self.put(STATUS, status)
        self.put(ODOMETRY, telemetry.odometry(vehicle.state, stamp_ns))

    def take_inputs(self, inputs: TickInputs) -> None:
        """Publish the inputs while some are missing, and once when they are back."""
        self.wants_inputs = False
        are_missing = inputs.flags & SENSES != SENSES
        if are_missing or self._were_missing:
            self.put(INPUTS, inputs)
        self._were_missing = are_missing

    def put(self, topic: Topic[M], message: M) -> None:
        """Publish a message in the summary of its topic."""
        self._together.put(self._publishers[topic.path], message)


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
        self.together = Together()
        self._summary = Summary(bus, self.together)
        self._now_ns = bus.now_ns
        self._beat_ns = 0
        self._commands = 0
        self.recorded = 0

    def brake(self, stamp_ns: int, sense_seq: int) -> None:
        """Publish a command with no time-to-live, which stops the wheels at once.

        It is sent whatever the stamp is, because a bad stamp may have ended the loop. The stamp is
        reduced to the range that the plant accepts.
        """
        self.command(stamp_ns % MAX_STAMP_NS, sense_seq, 0, 0, ttl_ms=0)

    def command(
        self,
        stamp_ns: int,
        sense_seq: int,
        left_mrad_s: int,
        right_mrad_s: int,
        ttl_ms: int = MAX_WHEEL_TTL_MS,
    ) -> None:
        """Publish wheel speeds, in force until the next command or until they expire."""
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

    def tick(self, vehicle: RobotVehicle, outputs: Outputs, stamp_ns: int, now_ns: int) -> None:
        """Publish the pose, the state, the navigation decision, and the cost on a board.

        What no process reads is not even made, but for the state, which notes the stops it shows.
        """
        if self.odometry.matched:
            self.together.put(self.odometry, telemetry.odometry(vehicle.state, stamp_ns))
        self.state(vehicle, stamp_ns, now_ns)
        if self.decision.matched:
            self.together.put(self.decision, telemetry.decision(outputs, vehicle.zone_m, stamp_ns))
        board = vehicle.core.board_status(stamp_ns)
        if board is not None:
            self.together.put(self.mcu, board)

    def state(self, vehicle: RobotVehicle, stamp_ns: int, now_ns: int) -> None:
        """Publish vehicle, mode and goal."""
        commands, now_ms = vehicle.commands, now_ms_of(now_ns)
        status = telemetry.status(
            vehicle.state,
            commands.goal_id,
            stamp_ns,
            now_ms,
            commands.take_shown_stop(),
            commands.stoppers,
        )
        self.together.put(self.status, status)
        self._summary.take(status)

    @property
    def wants_inputs(self) -> bool:
        """True if any process reads the inputs of this tick."""
        return self._summary.wants_inputs or self.inputs.matched

    def put_inputs(self, message: TickInputs) -> None:
        """Publish everything that determined a tick."""
        if self.inputs.matched:
            self.together.put(self.inputs, message)
        if self._summary.wants_inputs:
            self._summary.take_inputs(message)

    def events(self, vehicle: RobotVehicle, stamp_ns: int, now_ns: int) -> None:
        """Publish what is independent of ticks: heartbeat, summary, lease, mission, new texts."""
        self._beat(vehicle, now_ns)
        self._summary.publish(vehicle, stamp_ns)
        lease = vehicle.lease_status(stamp_ns, now_ns)
        if lease is not None:
            self.together.put(self.lease, lease)
        mission = vehicle.mission_status(stamp_ns, now_ns)
        if mission is not None:
            self.together.put(self.mission, mission)
        for text in vehicle.texts():
            self.together.put(self.text, text)

    def _beat(self, vehicle: RobotVehicle, now_ns: int) -> None:
        """Publish a due heartbeat; with a slow or paused simulated time, also in wall time."""
        beat, wall_ns = vehicle.heartbeat(now_ns), self._now_ns()
        if beat is None and wall_ns - self._beat_ns >= SIGN_OF_LIFE_NS:
            beat = telemetry.heartbeat(vehicle.state)
        if beat is not None:
            self._beat_ns = wall_ns
            self.together.put(self.heartbeat, beat)

    def record(self, request: Message, answer: Message) -> None:
        """Publish a request with its answer, for recordings, and count it."""
        if type(request) in COMMANDED.messages:
            self.recorded = (self.recorded + 1) & UINT32
            self.commanded.put(request)
            self.answered.put(answer)


MAX_WITHHELD: Final = 64
INTERIM_NS: Final = 300_000_000
"""After this time the answer is IN_PROGRESS: in force, being saved, repeat the request."""

SLOW_NS: Final = 3_000_000_000
"""Warn about a write that takes longer: the disk may hang."""

SLOW: Final = f"not saved for {SLOW_NS // NS_PER_S} s: the disk is slow, or it hangs"

MAX_WAIT_NS: Final = 10_000_000_000
"""After this time the answer is that nothing has been saved."""

SAVING: Final = CommandAck(command=0, result=AckResult.IN_PROGRESS, result_param2=reasons.OK)


class WithheldReply(NamedTuple):
    """A request whose answer waits for a file."""

    incoming: ServiceRequest
    answer: Answer
    ticket: Ticket
    since_ns: int


class SavedReplies:
    """Sends replies as soon as the file they depend on is written, or has failed.

    Meanwhile the requested change is already in force.
    """

    def __init__(self, vehicle: RobotVehicle) -> None:
        self._vehicle = vehicle
        self._withheld: list[WithheldReply] = []
        self._stalled: dict[StateFile, tuple[int, int]] = {}
        """Files being written: the newest ended write, and the time of the last progress."""
        self._warned_slow = False

    def reply(
        self, incoming: ServiceRequest, request: Message, answer: Answer, now_ns: int
    ) -> None:
        """Answer a request now or when its file is written; refuse it beyond a limit."""
        ticket = self._vehicle.saving(request, answer)
        if ticket is None or not ticket.is_open:
            incoming.reply(answer)
        elif len(self._withheld) < MAX_WITHHELD:
            self._stalled.setdefault(ticket.file, (ticket.file.ended, now_ns))
            self._withheld.append(WithheldReply(incoming, answer, ticket, now_ns))
        else:
            incoming.reply(
                refusal(reasons.TOO_MANY_REQUESTS, result=AckResult.TEMPORARILY_REJECTED)
            )

    def settle(self, now_ns: int) -> None:
        """Send the answers whose files are written by now, or have taken too long."""
        self._vehicle.collect_saved()
        self._watch(now_ns)
        withheld, self._withheld = self._withheld, []
        for one in withheld:
            if not one.ticket.is_open:
                one.incoming.reply(once_saved(one.answer, one.ticket))
            elif self._stalled_ns(one.ticket.file, now_ns) > MAX_WAIT_NS:
                one.incoming.reply(not_saved(one.answer))
            elif now_ns - one.since_ns > INTERIM_NS:
                one.incoming.reply(SAVING)
            else:
                self._withheld.append(one)

    def _watch(self, now_ns: int) -> None:
        """Track the progress of each file; warn once if a file makes none."""
        for file, (ended, _) in tuple(self._stalled.items()):
            if not file.ticket.is_open:
                del self._stalled[file]
            elif file.ended != ended:
                self._stalled[file] = file.ended, now_ns
        is_slow = any(self._stalled_ns(file, now_ns) > SLOW_NS for file in self._stalled)
        if is_slow and not self._warned_slow:
            self._vehicle.announce(Severity.WARNING, SLOW)
        self._warned_slow = is_slow

    def _stalled_ns(self, file: StateFile, now_ns: int) -> int:
        return now_ns - self._stalled[file][1]
