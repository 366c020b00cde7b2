"""The robot without clock and sockets: core, operators, missions and texts."""

from math import degrees, nan
from typing import Final, TypeAlias

import msgspec

from protocol.wire.enums import Command, Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    Heartbeat,
    LeaseRequest,
    LeaseStatus,
    MissionStatus,
    MissionVerdict,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Statustext,
    Teleop,
)
from robot import telemetry
from robot.commands import Commands, TeleopInput, ack, acknowledge, kind_of, needs_no_lease
from robot.core import modes, reasons, states
from robot.core.brain import StageHook
from robot.core.parameters import Params
from robot.core.safety import failsafe
from robot.core.state import State
from robot.core.values import Inputs, Outputs, Pose, Twist
from robot.emergency_stop import RESTORED, emergency_stop
from robot.file_writer import Ticket
from robot.hosting import ORIGIN, InProcessCore, NewCore
from robot.lease import Asker, Lease
from robot.mission import (
    FenceItems,
    MissionExecutor,
    MissionStore,
    TransferReply,
    TransferRequest,
    Transfers,
    restore_items,
)
from robot.own_navigator import cost_words, fault_in
from robot.parameter_service import ParameterService
from robot.storage import Store
from robot.telemetry import ChangeLog
from runtime.cli.terminal import printable
from runtime.units import NS_PER_MS

Answer: TypeAlias = CommandAck | ParamValue | TransferReply

MAX_TEXTS: Final = 100  # between two calls of `texts`
HEARTBEAT_NS: Final = 200_000_000
SLOW_NS: Final = 500_000_000


class RobotVehicle:
    """Sans-I/O: takes requests and sensor data, returns answers, wheel speeds and texts.

    Time is passed in. `configured` bounds the safety parameters; by default the initial parameters
    do. `totals` are the encoder counters at the start pose: a robot whose wheels have turned since
    does not know its place. `new_core` may return a core that runs elsewhere than in this process.
    """

    def __init__(
        self,
        params: Params,
        store: Store,
        start: Pose = ORIGIN,
        configured: Params | None = None,
        totals: tuple[int, int] = (0, 0),
        new_core: NewCore = InProcessCore,
    ) -> None:
        self.core = new_core(params, start, totals)
        self.state: State = self.core.state
        self.lease = Lease()
        self.teleop = TeleopInput()
        self.mission = MissionExecutor(self.core)
        self.commands = Commands(self.core, self.mission, self._is_there)
        self.parameters = ParameterService(self.core, store, configured or params)
        self._store = store
        self._mission_store = MissionStore(store.directory)
        fence = FenceItems(self.core)
        self._transfers = Transfers(self.mission, fence, self._mission_store)
        self._change_log = ChangeLog(self.state.machine, self.mission)
        self._texts = self._change_log.text(Severity.INFO, "started: disarmed, standing still")
        self._was_active = False
        self._heartbeats = ReportTimer(HEARTBEAT_NS)
        self._leases = ReportTimer(SLOW_NS)
        self._missions = ReportTimer(SLOW_NS)
        self._slipping = False
        self.restored: tuple[str, ...] = ()
        """Texts about the state restored from an earlier run."""

    @property
    def params(self) -> Params:
        """The parameters in force."""
        return self.core.params

    @property
    def zone_m(self) -> float:
        """Width of the avoidance zone of the navigator in use; NaN where it has none."""
        zones_m = {states.BUG: self.params.d_th_m, states.VGM: self.params.d_obs_m}
        return zones_m.get(self.state.machine.navigator, nan)

    def operator_age_ms(self, now_ns: int) -> int | None:
        """Return the age of the newest heartbeat of the operator; None before the first.

        In a drive that needs its operator this is the program that has the robot move, whoever else
        is there; else any that may command.
        """
        machine = self.state.machine
        driver = ""
        if machine.mode == states.MANUAL or (machine.mode == states.GUIDED and self._drives):
            driver = self.commands.driver if machine.vehicle == states.ACTIVE else ""
        return age_in_ms(self.lease.beaten_ns(driver), now_ns)

    def _is_there(self, operator: str, now_ms: int, within_ms: int | None) -> bool:
        """Return whether a program itself sends heartbeats; without a name it is any.

        It has sent one `within_ms`, and in any case within the time of the failsafe.
        """
        limit_ms = self.params.op_lost_ms
        age_ms = age_in_ms(self.lease.own_beat_ns(operator), now_ms * NS_PER_MS)
        limit_ms = limit_ms if within_ms is None else min(within_ms, limit_ms)
        return not operator or (age_ms is not None and age_ms <= limit_ms)

    @property
    def _drives(self) -> bool:
        """True while the robot drives to a goal, or waits at a stop of its mission."""
        machine = self.state.machine
        is_on_the_way = modes.goal_is_active(machine) or self.mission.active
        return is_on_the_way and machine.mode != states.HOLD

    def receive_teleop(self, teleop: Teleop, sent_ns: int, operator: str = "") -> None:
        """Take a teleop frame, sent at `sent_ns`, of a program that may command.

        That of another program than the one that began to drive by hand is ignored.
        """
        if self.commands.driver not in ("", operator):
            return
        ignored = self.teleop.receive(teleop, sent_ns)
        if ignored:
            self.announce(Severity.WARNING, ignored)
        if teleop.speed_mm_s or teleop.yaw_rate_mrad_s:
            self.lease.use(sent_ns)

    def receive(self, request: Message, now_ns: int, operator: str = "") -> Answer:
        """Act on a request and return the answer; a refusal contains its reason.

        `operator` is the sender's identity on the bus. The answer is final once `saving` has ended.
        """
        if isinstance(request, LeaseRequest):
            return self._lease(request, now_ns, operator)
        if not needs_no_lease(request):
            if not self.lease.allows(operator):
                return self.refused(request, reasons.LEASE_HELD)
            self.lease.use(now_ns)
        if isinstance(request, CommandRequest | GoalRequest):
            decided = self._decide_without_core(request)
            if decided is not None:
                return acknowledge(request, decided)
            before, driver = self.state.machine.vehicle, self.commands.driver
            done = self.commands.receive(request, now_ns // NS_PER_MS, operator)
            self._follow(request, done, before, driver)
            return done
        answer: Answer
        if isinstance(request, ParamSet):
            answer = self.parameters.set(request)
        elif isinstance(request, ParamRequestRead):
            answer = self.parameters.read(request)
        elif isinstance(request, TransferRequest):
            answer = self._transfers.receive(request, operator)
        else:
            answer = self.refused(request, reasons.UNKNOWN_COMMAND)
        ticket = self.saving(request, answer)
        return answer if ticket is None else once_saved(answer, ticket)

    def _decide_without_core(self, request: CommandRequest | GoalRequest) -> int | None:
        """Return the reason that answers a command which what is saved decides, or None.

        A stop is saved before the core acts on it, which may fail.
        """
        kind, kept = kind_of(request), self._store.stop
        if kind.is_clear and kept.was_cleared_by(request.request_id):
            return reasons.NEWER_STOP if self.stopped else reasons.OK
        if kind.is_arm and self._store.damaged and not self.stopped:
            return reasons.PARAMETERS_DAMAGED
        if kind.is_emergency_stop:
            kept.keep(stopped=True)
        return None

    def _follow(
        self, request: CommandRequest | GoalRequest, done: CommandAck, before: int, driver: str
    ) -> None:
        """Follow the effects of a command that found this vehicle state and this driver.

        When it arms, list the safety parameters changed from configuration.
        """
        if self.commands.driver != driver:
            self.teleop.clear()
        if kind_of(request).is_clear and before == states.EMERGENCY_STOP and not self.stopped:
            self._store.stop.clear(request.request_id)
        self.parameters.adopt_navigator()
        if done.command == Command.SIDESTEP_SET_POSE and done.result_param2 == reasons.OK:
            x_m, y_m, heading_rad = self.state.odometry.pose
            words = f"place set: {x_m:.2f} {y_m:.2f} m, {degrees(heading_rad):.0f} deg"
            self.announce(Severity.NOTICE, words)
        if done.command == Command.PREFLIGHT_REBOOT_SHUTDOWN and done.result_param2 == reasons.OK:
            self.announce(Severity.NOTICE, "restarting on request")
        has_armed = self.state.machine.vehicle == states.ACTIVE and before != states.ACTIVE
        changes = self.parameters.safety_changes() if has_armed else []
        if changes:
            words = f"armed with changed safety parameters: {', '.join(changes)}"
            self.announce(Severity.NOTICE, words)

    def saving(self, request: Message, answer: Answer) -> Ticket | None:
        """Return the write that must end before this answer may be sent, or None."""
        if isinstance(request, ParamSet) and isinstance(answer, ParamValue):
            return self._store.ticket
        if isinstance(answer, MissionVerdict) and answer.reason == reasons.OK:
            return self._mission_store.ticket(answer.mission_type)
        return None

    def collect_saved(self) -> None:
        """Collect the writes that have ended since the last call; report failed ones."""
        for file in self._store.directory.collect():
            self.parameters.forget_text()
            news: tuple[Severity, str] | None = None
            if self._store.stop.is_of(file):
                news = self._store.stop.news_of(file)
            elif file.error is not None:
                words = file.error.strerror or str(file.error)
                news = Severity.ERROR, f"{file.name} not saved: {words}"
            if news is not None:
                self.announce(*news)

    def retry_stop(self, now_ns: int) -> None:
        """Write the emergency stop again if that has failed; `now_ns` is the time of the wall."""
        self._store.stop.retry(now_ns)

    def finish_saving(self, patience_s: float) -> None:
        """Wait at most `patience_s` for pending writes; call it only after the loop has ended."""
        if self.stopped:  # a disk that was full may have room again
            self._store.stop.keep(stopped=True)
        self._store.directory.close(patience_s)
        self.collect_saved()

    @property
    def stopped(self) -> bool:
        """True while the emergency stop is latched."""
        return self.state.machine.vehicle == states.EMERGENCY_STOP

    @property
    def brakes(self) -> bool:
        """True while the motors brake: unless armed, and in MANUAL without speeds.

        Speeds whose time is up, or of a killed process that this one replaces, must not end in the
        motors' own ramp.
        """
        machine = self.state.machine
        if machine.vehicle != states.ACTIVE:
            return True
        return machine.mode == states.MANUAL and self.state.manual is None

    def restore(self) -> list[tuple[Message, Message]]:
        """Restore the saved stop, fence and mission; call it before the first request.

        Return the requests that restore the same elsewhere, with their answers.
        """
        exchanges, texts = restore_items(self._mission_store, self._transfers, self.core)
        replayed: list[tuple[Message, Message]] = list(exchanges)
        if self._store.stop.found():
            request = emergency_stop(0)
            self._store.stop.keep(stopped=True)
            replayed.insert(0, (request, self.commands.receive(request, 0)))
            texts.insert(0, (Severity.CRITICAL, RESTORED))
        for severity, text in texts:
            self.announce(severity, text)
        self.restored = tuple(text for _, text in texts)
        return replayed

    def step(self, inputs: Inputs, mark: StageHook, manual: Twist | None = None) -> Outputs:
        """Run one tick of mission and core; `manual` is the twist the operator commands.

        An exception of the core leaves the vehicle in FAILSAFE and is raised again.
        """
        self.mission.step(inputs.now_ms)
        try:
            outputs = self.core.step(inputs, mark, manual)
        except Exception:
            failsafe.trip(self.state.machine, reasons.CORE_EXCEPTION, inputs.now_ms)
            raise
        self._forget_driver()
        if fault := fault_in(outputs.decision):
            self.announce(Severity.ERROR, fault)
        slipping = self.state.slip.share > 0.0
        if slipping and not self._slipping:
            self.announce(Severity.WARNING, "wheel slip suspected: position less certain")
        self._slipping = slipping
        return outputs

    def _forget_driver(self) -> None:
        """Forget who had the robot move once it is no longer armed: the next drive is another.

        Name the program whose loss has stopped it.
        """
        is_active = self.state.machine.vehicle == states.ACTIVE
        if self._was_active and not is_active:
            if self.commands.driver and self.state.machine.vehicle_reason == reasons.OPERATOR_LOST:
                words = f"{self.commands.led_by.label} fell silent: its drive was stopped"
                self.announce(Severity.CRITICAL, words)
            if self.state.machine.vehicle_reason == reasons.BUDGET:
                self.announce(Severity.ERROR, cost_words())
            self.commands.led_by = Asker()
        self._was_active = is_active

    def stop(self, reason: int, now_ns: int) -> None:
        """Stop an active vehicle for a reason of the host; an earlier failsafe keeps its reason."""
        self.core.stop(reason, now_ns // NS_PER_MS)

    def lose_position(self, now_ns: int) -> None:
        """Stop, because restarted sensors count from another start and the position is lost."""
        self.announce(Severity.ERROR, "position lost: sensor stream restarted")
        self.core.lose_place()
        self.stop(reasons.TICKS_LOST, now_ns)

    def announce(self, severity: int, words: str) -> None:
        """Queue a text for the operators; drop the oldest ones beyond the limit."""
        self._texts = (self._texts + self._change_log.text(severity, words))[-MAX_TEXTS:]

    def texts(self) -> list[Statustext]:
        """Return the texts to publish now, oldest first."""
        self.collect_saved()
        texts = self._texts + self._change_log.since_last_time(self.commands.stoppers)
        self._texts = []
        return texts

    def heartbeat(self, now_ns: int) -> Heartbeat | None:
        """Return a heartbeat five times a second, and at once when vehicle or mode has changed."""
        machine = self.state.machine
        beat = (machine.vehicle, machine.mode, machine.vehicle_reason)
        return telemetry.heartbeat(self.state) if self._heartbeats.due(beat, now_ns) else None

    def lease_status(self, stamp_ns: int, now_ns: int) -> LeaseStatus | None:
        """Return the lease twice a second, and at once when its holder or the drive has changed."""
        if self._drives:
            self.lease.use(now_ns)
        for severity, words in self.lease.due(now_ns):
            self.announce(severity, words)
        drive = self.commands.drive_id, self.commands.begun_by.label
        due = self._leases.due((self.lease.holder, drive), now_ns + self.lease.stood_ns)
        return self.lease.status(stamp_ns, now_ns, *drive) if due else None

    def mission_status(self, stamp_ns: int, now_ns: int) -> MissionStatus | None:
        """Return the mission's status twice a second, and at once when it has changed."""
        mission = self.mission
        progress = (mission.number, len(mission.items), mission.current, mission.state)
        due = self._missions.due((progress, mission.reason, self.commands.stoppers), now_ns)
        return mission.status(stamp_ns, self.commands.stoppers) if due else None

    def _lease(self, request: LeaseRequest, now_ns: int, operator: str) -> CommandAck:
        before = self.lease.holder
        reason = self.lease.receive(request, operator, now_ns)
        holder, driver = self.lease.holder, self.commands.driver
        if (before and before.person) != (holder and holder.person):
            self.teleop.clear()
        if driver and not self.lease.allows(driver):  # who seizes the lease takes over the drive
            self.lease.inherit(operator, driver)
            self.commands.led_by = Asker(operator, printable(request.name))
        return ack(reason)

    def refused(self, request: Message, reason: int) -> Answer:
        """Return the refusal that answers a request of this type."""
        if isinstance(request, TransferRequest):
            return self._transfers.verdict(request.mission_type, reason)
        if isinstance(request, CommandRequest | GoalRequest):
            return acknowledge(request, reason)
        return ack(reason)


def age_in_ms(sent_ns: int | None, now_ns: int) -> int | None:
    """Return the age of what was sent, None if nothing was."""
    return None if sent_ns is None else max(0, now_ns - sent_ns) // NS_PER_MS


def once_saved(answer: Answer, ticket: Ticket) -> Answer:
    """Return the answer, or the refusal NOT_SAVED if its file could not be written."""
    return answer if ticket.error is None else not_saved(answer)


def not_saved(answer: Answer) -> Answer:
    """Return the refusal NOT_SAVED: the change is in force until the next restart."""
    if isinstance(answer, MissionVerdict):
        return msgspec.structs.replace(answer, reason=reasons.NOT_SAVED)
    return ack(reasons.NOT_SAVED)


class ReportTimer:
    """Decides when to publish a value: at once after a change, else every `period_ns`.

    A late call does not delay the following ones, so that the mean rate is kept.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._last: object = self
        self._due_ns = 0

    def due(self, value: object, now_ns: int) -> bool:
        """Return whether to publish `value` now, and note it if so."""
        if value == self._last and now_ns < self._due_ns:
            return False
        is_on_grid = value == self._last and now_ns < self._due_ns + self._period_ns
        self._last = value
        self._due_ns = (self._due_ns if is_on_grid else now_ns) + self._period_ns
        return True
