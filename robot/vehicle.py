"""All that is onboard but the clock and the sockets: core, operators, missions, what to tell."""

from math import nan
from typing import Final, TypeAlias

import msgspec

from protocol.wire.enums import Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    LeaseRequest,
    LeaseStatus,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Statustext,
    Teleop,
)
from robot import telemetry
from robot.change_log import ChangeLog
from robot.commands import Commands, ack, acknowledge
from robot.core import brain, reasons, states
from robot.core.brain import StageHook
from robot.core.parameters import Params
from robot.core.safety import failsafe
from robot.core.state import State
from robot.core.values import Inputs, Outputs, Pose, Twist
from robot.lease import Lease, needs_no_lease
from robot.mission.fence_items import FenceItems
from robot.mission.mission import Mission
from robot.mission.persistence import MissionStore
from robot.mission.restore import Exchange, restored
from robot.mission.transfer import Reply, Transfers
from robot.parameters.service import NO_COMMAND, ParameterService
from robot.storage.files import Store
from robot.storage.writer import Ticket
from robot.teleop import TeleopInput
from runtime.units import NS_PER_MS

Answer: TypeAlias = CommandAck | ParamValue | Reply
Transfer: Final = (
    MissionCount,
    MissionItemInt,
    MissionRequestList,
    MissionRequestInt,
    MissionClearAll,
)

MAX_TEXTS: Final = 100  # from one look to the next
HEARTBEAT_NS: Final = 200_000_000
SLOW_NS: Final = 500_000_000
ORIGIN: Final = Pose(0.0, 0.0, 0.0)


class Vehicle:
    """Sans-I/O: requests and senses in, answers, wheel speeds and texts out; time is passed in.

    `configured` bounds the safety parameters; without it those that it begins with do.
    """

    def __init__(
        self,
        params: Params,
        store: Store,
        start: Pose = ORIGIN,
        configured: Params | None = None,
    ) -> None:
        self.state = State(params)
        self.state.odometry.pose = start
        self.lease = Lease()
        self.teleop = TeleopInput()
        self.mission = Mission(self.state.machine)
        self.commands = Commands(self.state, self.mission)
        self.parameters = ParameterService(params, store, self.state.machine, configured or params)
        self._store = store
        self._mission_store = MissionStore(store.directory)
        fence = FenceItems(self.state)
        self._transfers = Transfers(self.mission, fence, self._mission_store)
        self._change_log = ChangeLog(self.state.machine, self.mission)
        self._texts = self._change_log.text(Severity.INFO, "started: disarmed, standing still")
        self._operator_ns: int | None = None
        self._heartbeats = ReportTimer(HEARTBEAT_NS)
        self._leases = ReportTimer(SLOW_NS)
        self._missions = ReportTimer(SLOW_NS)
        self._slipping = False
        self.restored: tuple[str, ...] = ()
        """What there was to announce of what an earlier run had kept."""

    @property
    def params(self) -> Params:
        return self.parameters.params

    @property
    def zone_m(self) -> float:
        """Width of the avoidance zone of the navigator in use; NaN where it has none."""
        zones_m = {states.BUG: self.params.d_th_m, states.VGM: self.params.d_obs_m}
        return zones_m.get(self.state.machine.navigator, nan)

    def receive_heartbeat(self, sent_ns: int) -> None:
        """Take a heartbeat of an operator who may command: the operator was there at `sent_ns`."""
        newest_ns = self._operator_ns
        self._operator_ns = sent_ns if newest_ns is None else max(newest_ns, sent_ns)
        self.lease.refresh(sent_ns)

    def operator_age_ms(self, now_ns: int) -> int | None:
        newest_ns = self._operator_ns
        return None if newest_ns is None else max(0, now_ns - newest_ns) // NS_PER_MS

    def receive_teleop(self, teleop: Teleop, sent_ns: int) -> None:
        """Take a frame of an operator who may command, sent at `sent_ns`."""
        ignored = self.teleop.receive(teleop, sent_ns)
        if ignored:
            self.announce(Severity.WARNING, ignored)

    def receive(self, request: Message, now_ns: int, operator: str = "") -> Answer:
        """Act on a request and answer it; a refusal comes with its reason.

        `operator` is who asks, as the bus knows it. The answer counts once `saving` has ended.
        """
        answer = self._act(request, now_ns, operator)
        ticket = self.saving(request, answer)
        return answer if ticket is None else once_saved(answer, ticket)

    def _act(self, request: Message, now_ns: int, operator: str) -> Answer:
        if isinstance(request, LeaseRequest):
            return self._lease(request, now_ns, operator)
        if not needs_no_lease(request) and not self.lease.allows(operator):
            return self.refused(request, reasons.LEASE_HELD)
        if isinstance(request, ParamSet):
            return self.parameters.set(request)
        if isinstance(request, ParamRequestRead):
            return self.parameters.read(request)
        if isinstance(request, CommandRequest | GoalRequest):
            return self._command(request, now_ns, operator)
        if isinstance(request, Transfer):
            return self._transfers.receive(request, operator)
        return self.refused(request, reasons.UNKNOWN_COMMAND)

    def saving(self, request: Message, answer: Answer) -> Ticket | None:
        """Return what has to be on the disk before a request may get this answer."""
        if isinstance(request, ParamSet) and isinstance(answer, ParamValue):
            return self._store.ticket
        if isinstance(answer, MissionVerdict) and answer.reason == reasons.OK:
            return self._mission_store.ticket(answer.mission_type)
        return None

    def collect_saved(self) -> None:
        """Collect the writes that have ended since the last call; report those that failed."""
        for file in self._store.directory.collect():
            self.parameters.forget_text()
            if file.error is not None:
                words = file.error.strerror or str(file.error)
                self.announce(Severity.ERROR, f"{file.name} not saved: {words}")

    def finish_saving(self, patience_s: float) -> None:
        """Wait for what is being written, no longer than this; only once the loop has ended."""
        self._store.directory.close(patience_s)
        self.collect_saved()

    @property
    def stopped(self) -> bool:
        """Whether the emergency stop is latched."""
        return self.state.machine.vehicle == states.EMERGENCY_STOP

    @property
    def brakes(self) -> bool:
        """Return whether the motors brake: in a failsafe or an emergency stop."""
        return self.state.machine.vehicle in (states.FAILSAFE, states.EMERGENCY_STOP)

    def restore(self) -> list[Exchange]:
        """Before anybody asks anything: have the fence and the mission again that were kept."""
        done = restored(self._mission_store, self._transfers, self.state)
        for severity, words in done.words:
            self.announce(severity, words)
        self.restored = tuple(words for _, words in done.words)
        return done.exchange

    def step(self, inputs: Inputs, mark: StageHook, manual: Twist | None = None) -> Outputs:
        """One tick of mission and core; `manual`: how an operator steers.

        An exception leaves the vehicle in FAILSAFE and goes on upwards.
        """
        self.mission.step(inputs.now_ms)
        self.state.manual = manual
        try:
            _, outputs = brain.step(self.state, inputs, self.params, mark)
        except Exception:
            failsafe.trip(self.state.machine, reasons.CORE_EXCEPTION, inputs.now_ms)
            raise
        slipping = self.state.slip.share > 0.0
        if slipping and not self._slipping:
            self.announce(Severity.WARNING, "wheels seem to slip: place less sure")
        self._slipping = slipping
        return outputs

    def report(self, reason: int) -> None:
        """A failsafe reason that only the host can see; the next step acts on it."""
        self.state.reported = reason

    def stop(self, reason: int, now_ns: int) -> None:
        """For what the host knows: no goal survives it; a failsafe that is on keeps its reason."""
        if self.state.machine.vehicle == states.ACTIVE:
            failsafe.trip(self.state.machine, reason, now_ns // NS_PER_MS)

    def lose_position(self, now_ns: int) -> None:
        """Its senses have begun anew: whatever they count from now on, the way was not driven."""
        self.announce(Severity.ERROR, "senses began anew: the place is not known any more")
        self.stop(reasons.TICKS_LOST, now_ns)

    def announce(self, severity: int, words: str) -> None:
        self._texts = (self._texts + self._change_log.text(severity, words))[-MAX_TEXTS:]

    def texts(self) -> list[Statustext]:
        """What is to be told now, oldest first."""
        self.collect_saved()
        texts = self._texts + self._change_log.since_last_time()
        self._texts = []
        return texts

    def heartbeat(self, now_ns: int) -> Heartbeat | None:
        """Due five times a second, and at once when vehicle or mode has changed."""
        machine = self.state.machine
        beat = (machine.vehicle, machine.mode, machine.vehicle_reason)
        return telemetry.heartbeat(self.state) if self._heartbeats.due(beat, now_ns) else None

    def lease_status(self, stamp_ns: int, now_ns: int) -> LeaseStatus | None:
        """Due twice a second, and at once when the holder has changed."""
        for severity, words in self.lease.due(now_ns):
            self.announce(severity, words)
        due = self._leases.due(self.lease.holder, now_ns)
        return self.lease.status(stamp_ns, now_ns) if due else None

    def mission_status(self, stamp_ns: int, now_ns: int) -> MissionStatus | None:
        """Due twice a second, and at once when the mission has changed or gone on."""
        mission = self.mission
        progress = (mission.number, len(mission.items), mission.current, mission.state)
        due = self._missions.due((progress, mission.reason), now_ns)
        return mission.status(stamp_ns) if due else None

    def _command(
        self, request: CommandRequest | GoalRequest, now_ns: int, operator: str
    ) -> CommandAck:
        """Act on a command; arming lists the safety parameters that are not as configured."""
        machine = self.state.machine
        was_armed = machine.vehicle == states.ACTIVE
        answer = self.commands.receive(request, now_ns // NS_PER_MS, operator)
        if machine.vehicle == states.ACTIVE and not was_armed:
            changes = self.parameters.safety_changes()
            if changes:
                self.announce(
                    Severity.NOTICE, f"armed, other than configured: {', '.join(changes)}"
                )
        return answer

    def _lease(self, request: LeaseRequest, now_ns: int, operator: str) -> CommandAck:
        holder = self.lease.holder
        reason = self.lease.receive(request, operator, now_ns)
        if self.lease.holder != holder:
            self.teleop.clear()
        return ack(NO_COMMAND, reason)

    def refused(self, request: Message, reason: int) -> Answer:
        """Return the answer that refuses a request of this kind."""
        if isinstance(request, Transfer):
            return self._transfers.verdict(request.mission_type, reason)
        if isinstance(request, CommandRequest | GoalRequest):
            return acknowledge(request, reason)
        return ack(NO_COMMAND, reason)


def once_saved(answer: Answer, ticket: Ticket) -> Answer:
    """Return the answer, or the refusal NOT_SAVED where what it vouches for is not on the disk."""
    return answer if ticket.error is None else not_saved(answer)


def not_saved(answer: Answer) -> Answer:
    """Return the answer NOT_SAVED: in force until the next restart."""
    if isinstance(answer, MissionVerdict):
        return msgspec.structs.replace(answer, reason=reasons.NOT_SAVED)
    return ack(NO_COMMAND, reasons.NOT_SAVED)


class ReportTimer:
    """Decides when to report a value again: at once when it has changed, else every `period_ns`."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._last: object = self
        self._due_ns = 0

    def due(self, what: object, now_ns: int) -> bool:
        if what == self._last and now_ns < self._due_ns:
            return False
        self._last = what
        self._due_ns = now_ns + self._period_ns
        return True
