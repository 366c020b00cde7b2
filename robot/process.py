"""The robot process: one control cycle per tick, its cost measured, and requests in between."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from queue import SimpleQueue
from typing import Final

from protocol.bus.bus import Bus, DuplicateWatch
from protocol.bus.services import ServiceRequest, refusal
from protocol.topic import person_of
from protocol.topics import COMMAND, LEASE_SERVICE, MISSION_SERVICE, PARAMETER, PARAMETERS
from protocol.wire.codec import Encoder
from protocol.wire.enums import INPUT_BUDGET, INPUT_NAME_TAKEN, AckResult, Command, Severity
from protocol.wire.messages import CommandRequest, CycleReport, Teleop
from robot import telemetry
from robot.commands import READ_ONLY, ack, kind_of, operator_twist
from robot.core import reasons
from robot.core.brain import READ, STAGES, TICK_US
from robot.core.values import Inputs, Outputs
from robot.emergency_stop import StopLatch, emergency_stop
from robot.reports import Reports, SavedReplies
from robot.senses import Senses
from robot.telemetry import CoreInputs
from robot.vehicle import RobotVehicle
from runtime.clock import Clock, Tick
from runtime.errors import LocalError
from runtime.lockstep import LockstepLoop
from runtime.units import NS_PER_S, UINT32

OVERRUNS_IN_A_ROW: Final = 3
LAST_STAGE: Final = len(STAGES) - 1


class CycleMeter:
    """CPU time per stage of the current tick.

    In lockstep (`enforced` false) simulated time pauses during a cycle. Nothing is late then, and
    no verdict depends on the load of the machine.
    """

    def __init__(self, clock: Clock, *, period_ns: int, enforced: bool) -> None:
        self._clock = clock
        self._period_ns = period_ns
        self._enforced = enforced
        self._stage_us = [0] * len(STAGES)
        self._marked_ns = self._begun_ns = 0
        self._last_ns: int | None = None
        self._stalled = False
        self._in_a_row = 0
        self._tick = Tick(0, 0, 0, 0)
        self.overruns = 0

    def begin(self, tick: Tick) -> None:
        """Start measuring a tick."""
        self._tick = tick
        now_ns = self._clock.now_ns()
        self._stalled = self._last_ns is not None and now_ns - self._last_ns > 2 * self._period_ns
        self._last_ns = now_ns
        self._begun_ns = self._marked_ns = self._clock.cpu_ns()

    def mark(self, stage: int) -> None:
        """Note that a stage has just ended."""
        now_ns = self._clock.cpu_ns()
        self._stage_us[stage] = (now_ns - self._marked_ns) // 1000
        self._marked_ns = now_ns

    def end(self) -> None:
        """End the cycle and compare its cost with the budget."""
        self.mark(LAST_STAGE)
        over = (self._marked_ns - self._begun_ns) // 1000 > TICK_US
        self.overruns += over
        self._in_a_row = self._in_a_row + 1 if over else 0

    @property
    def violated(self) -> bool:
        """True after three overruns in a row, or for a tick more than one period late.

        A process that was suspended resumes with a fresh frame. Only the time since the previous
        tick shows that it is late.
        """
        late = self._stalled or self._tick.late_ns > self._period_ns
        return self._enforced and (late or self._in_a_row >= OVERRUNS_IN_A_ROW)

    def report(self, time_ns: int, *, sense_age_us: int, rejected: int) -> CycleReport:
        """Return the report of this tick.

        Its last stage is still running, so that of the previous tick is reported. The tick number
        wraps; other values are limited to 32 bits.
        """
        return CycleReport(
            time_ns=time_ns,
            tick=self._tick.index & UINT32,
            missed=min(self._tick.missed, UINT32),
            overruns=min(self.overruns, UINT32),
            rejected=min(rejected, UINT32),
            late_us=min(max(0, self._tick.late_ns) // 1000, UINT32),
            sense_age_us=min(sense_age_us, UINT32),
            budget_us=TICK_US,
            stage_us=tuple([min(spent_us, 65_535) for spent_us in self._stage_us]),
        )


SERVICES: Final = (COMMAND, PARAMETER, PARAMETERS, LEASE_SERVICE, MISSION_SERVICE)
SHOWN_NS: Final = NS_PER_S
"""Between two states of a stopped robot while its time stands."""

STANDS_NS: Final = NS_PER_S
"""Simulated time that does not move for so long stands."""

MAX_WAITING: Final = 64
MAX_ANSWERED: Final = 6
"""Requests of one queue per control period: 120 a second, more than any person sends."""

MAX_HALTED: Final = 12
"""The same for requests to stop of all persons without the lease, who are answered in turn."""

MAX_PERSONS: Final = 64
"""Persons who have a queue of their own; more who wait at the same time share one."""

MAX_VALIDITY_NS: Final = 60_000_000_000
"""Longest time to a deadline; a later one belongs to another clock, which must be synchronised."""

SAVING_S: Final = 3.0
"""Longest wait for the disk at the end, shorter than the time a container has to stop."""

STOPPED: Final = ack(reasons.OK, Command.DO_FLIGHTTERMINATION)


class PersonQueue(SimpleQueue[ServiceRequest]):
    """The requests of one person; `turn` is the number of the last answer, or of its begin."""

    def __init__(self, turn: int) -> None:
        self.turn = turn


class HaltingQueues:
    """Requests that only stop the robot, by persons, who are answered in turn.

    A thread of the bus adds persons and forgets those who wait for nothing; the loop only takes.
    """

    def __init__(self) -> None:
        self._turns = count()
        self._shared = PersonQueue(next(self._turns))
        # By person; replaced as a whole, so that the loop needs no lock.
        self._of: dict[str, PersonQueue] = {}

    def of(self, person: str) -> PersonQueue:
        """Return the queue of a person; a new one comes after all others."""
        known = self._of
        if person not in known:
            known = {one: queue for one, queue in known.items() if not queue.empty()}
            if len(known) >= MAX_PERSONS:
                return self._shared
            self._of = known = known | {person: PersonQueue(next(self._turns))}
        return known[person]

    def take(self, most: int) -> Iterator[ServiceRequest]:
        """Yield at most so many requests, the next one of whoever has waited for longest."""
        for _ in range(most):
            waiting = [queue for queue in self if not queue.empty()]
            if not waiting:
                return
            queue = min(waiting, key=lambda one: one.turn)
            queue.turn = next(self._turns)
            yield queue.get_nowait()

    def __iter__(self) -> Iterator[PersonQueue]:
        return iter((*self._of.values(), self._shared))


class RobotProcess:
    """Connects a vehicle to a bus and a clock.

    All work is done in one thread at a time; the threads of the bus only enqueue, except that in
    lockstep the thread that receives the plant's clock runs the cycles. An emergency stop has its
    own path: a thread of the bus sets a latch, which the loop reads before anything else. `restart`
    ends the loop when an operator asks for a restart; a supervisor then starts the process again.
    """

    def __init__(
        self,
        vehicle: RobotVehicle,
        bus: Bus,
        clock: Clock,
        senses: Senses,
        meter: CycleMeter,
        epoch: int = 0,
        restart: Callable[[], None] | None = None,
    ) -> None:
        self.vehicle = vehicle
        self._stopping = False
        self.end = restart or self.stop
        """Ends the loop; returns at once, from any thread and from a signal handler."""
        self._bus = bus
        self._clock = clock
        self._senses = senses
        self._meter = meter
        self.reports = Reports(bus, epoch)
        self._duplicates = DuplicateWatch(bus)
        self._requests: SimpleQueue[ServiceRequest] = SimpleQueue()
        self._unprivileged: SimpleQueue[ServiceRequest] = SimpleQueue()
        self._halting = HaltingQueues()
        self._stop = StopLatch(vehicle.lease.is_holder, vehicle.commands.is_stopped_by)
        self._is_unseen = False
        """True in a control period that shows a new stop, which nobody can have seen yet."""
        self._saved = SavedReplies(vehicle)
        self._stop_requests: deque[ServiceRequest] = deque()
        self._notes: deque[str] = deque(maxlen=MAX_ANSWERED)
        self._shown_ns = 0
        self._stands = -1, 0, 0
        """The robot's clock, and the own times since when it shows this, and of the last look."""
        self._nudge: Callable[[], None] = lambda: None
        self._encoder = Encoder(0, 0)

    def press(self, operator: str, request_id: int) -> int:
        """Set the latch for a stop that did not come by the bus; thread-safe.

        Return the number of the press for `has_stopped`.
        """
        self._stop.press(operator, self._encoder.encode(emergency_stop(request_id)))
        takes = self._stop.takes  # read after the press: the next reading of the latch finds it
        self._nudge()
        return takes

    def has_stopped(self, press: int) -> bool:
        """Return whether the loop has read a press and the stop is latched; thread-safe."""
        return self._stop.takes > press and self.vehicle.stopped

    def note(self, words: str) -> None:
        """Let the loop announce a warning; thread-safe. In a flood the newest are kept."""
        self._notes.append(words)

    def serve(self, nudge: Callable[[], None] = lambda: None) -> None:
        """Restore saved state, record it as if requested, and start to accept requests.

        `nudge` is called from the bus for each request. Requests beyond a limit are refused.
        Operators without the lease have a separate queue, and each of them one for what only stops
        the robot, which waits at most for one request of each other person. An emergency stop is
        never queued.
        """
        self._nudge = nudge
        for request, answer in self.vehicle.restore():
            self.reports.record(request, answer)
        self._bus.serve_stop(self._latch, self._wait_for_stop)
        self._bus.serve_clock()
        for service in SERVICES:
            self._bus.serve(service, self.take)

    def _latch(self, operator: str, frame: bytes) -> None:
        self._stop.press(operator, frame)
        self._nudge()

    def _wait_for_stop(self, incoming: ServiceRequest) -> None:
        """Let the loop answer a stop request, unless too many wait."""
        if len(self._stop_requests) >= MAX_WAITING:
            incoming.drop()
        else:
            self._stop_requests.append(incoming)
        self._nudge()

    def take(self, incoming: ServiceRequest) -> None:
        """Enqueue a request; thread-safe, the handler of all services."""
        if kind_of(incoming.message).is_emergency_stop:
            self._stop.press(incoming.operator, incoming.payload)
            self._wait_for_stop(incoming)  # last: the loop drops requests without a stop
            return
        queue = self._queue_for(incoming)
        if queue.qsize() >= MAX_WAITING:
            incoming.reply(
                refusal(reasons.TOO_MANY_REQUESTS, result=AckResult.TEMPORARILY_REJECTED)
            )
            return
        queue.put(incoming)
        self._nudge()

    def _queue_for(self, incoming: ServiceRequest) -> SimpleQueue[ServiceRequest]:
        if self.vehicle.lease.allows(incoming.operator):
            return self._requests  # also what only stops: it must not overtake what came before
        if not kind_of(incoming.message).only_stops:
            return self._unprivileged
        return self._halting.of(person_of(incoming.operator))

    def stop(self) -> None:
        """End after the tick under way; may be called from a signal handler."""
        self._stopping = True

    def run(self, grid: Iterable[Tick]) -> None:
        """Run until stopped. At any end, brake the wheels and end the goal.

        Call `finish` afterwards.
        """
        with self._braked_at_the_end():
            for tick in grid:
                self.cycle(tick)
                if self._stopping:
                    break

    def run_lockstep(self, loop: LockstepLoop) -> None:
        """Run the cycles of a loop until it is stopped; otherwise as `run`."""
        with self._braked_at_the_end():
            loop.run(self.cycle)

    @contextmanager
    def _braked_at_the_end(self) -> Iterator[None]:
        reason = reasons.SHUT_DOWN
        try:
            yield
        except Exception as error:
            reason = reasons.CORE_EXCEPTION
            self.vehicle.announce(
                Severity.CRITICAL, f"the control core failed: {summary_of(error)}"
            )
            raise
        finally:
            self._end(reason, self._clock.now_ns())

    def _end(self, reason: int, now_ns: int) -> None:
        """Brake first, so that a failure in the rest has no consequence."""
        senses, reports = self._senses, self.reports
        reports.brake(senses.stamp_ns, senses.sequence)
        self.vehicle.stop(reason, now_ns)
        with suppress(LocalError):
            reports.state(self.vehicle, senses.stamp_ns, now_ns)
            reports.events(self.vehicle, senses.stamp_ns, now_ns)

    def finish(self) -> None:
        """Wait for the disk after the loop has ended, then send the withheld answers."""
        self.vehicle.finish_saving(SAVING_S)
        self._saved.settle(self._clock.now_ns())

    def cycle(self, tick: Tick) -> None:
        """Run one control period: read, decide, write, measure.

        Work on which the wheel command does not depend comes after it.
        """
        self._meter.begin(tick)
        self._take_stop()
        self._answer()
        now_ns = self._clock.now_ns()
        inputs = self._senses.read(tick, now_ns, self.vehicle)
        self._meter.mark(READ)
        reported = self._report()
        teleop = self.vehicle.teleop.newest(now_ns)
        outputs = self.vehicle.step(inputs, self._meter.mark, operator_twist(teleop))
        self._command(outputs)
        with self.reports.together:
            self._write(outputs, tick, now_ns)
            self._publish_inputs(inputs, teleop, tick.index, reported)
        self._saved.settle(self._clock.now_ns())
        self.vehicle.retry_stop(self._bus.now_ns())
        self._bus.keep_serving()
        self._meter.end()

    def idle(self) -> None:
        """Take stops, answer requests and publish events between two ticks.

        A stop is acknowledged, and named to whoever clears it, by the state, which must not wait
        for simulated time.
        """
        now_ns, stamp_ns, wall_ns = self._clock.now_ns(), self._senses.stamp_ns, self._bus.now_ns()
        self._note_standing(now_ns, wall_ns)
        is_due = self.vehicle.stopped and wall_ns - self._shown_ns >= SHOWN_NS
        if self._take_stop() or is_due:
            self._shown_ns = wall_ns
            self.reports.state(self.vehicle, stamp_ns, now_ns)
        self._saved.settle(now_ns)
        self.vehicle.retry_stop(wall_ns)
        self._answer()
        self.reports.events(self.vehicle, stamp_ns, now_ns)

    def _note_standing(self, now_ns: int, wall_ns: int) -> None:
        """Let the time of the lease pass while simulated time stands: persons come and go."""
        stands_at_ns, since_ns, looked_ns = self._stands
        if now_ns != stands_at_ns:
            since_ns = looked_ns = wall_ns
        elif wall_ns - since_ns >= STANDS_NS:
            self.vehicle.lease.stood_ns += wall_ns - looked_ns
            self._senses.receive_heartbeats(self.vehicle, now_ns)
            looked_ns = wall_ns
        self._stands = now_ns, since_ns, looked_ns

    def _command(self, outputs: Outputs) -> None:
        """Publish the wheel command.

        Unless the robot is armed, and in MANUAL without speeds, the motors are short-circuited,
        which stops four times as fast as a ramp.
        """
        senses, reports = self._senses, self.reports
        stamp_ns = senses.stamp_ns
        if self.vehicle.brakes:
            reports.brake(stamp_ns, senses.sequence)
        else:
            reports.command(stamp_ns, senses.sequence, outputs.left_mrad_s, outputs.right_mrad_s)

    def _write(self, outputs: Outputs, tick: Tick, now_ns: int) -> None:
        """Publish the telemetry of a tick."""
        reports, stamp_ns = self.reports, self._senses.stamp_ns
        sent_us = max(0, self._clock.now_ns() - tick.due_ns) // 1000
        reports.tick(self.vehicle, outputs, stamp_ns, now_ns)
        if reports.cycle.matched:
            rejected = sum(self._bus.rejected.values())
            age_us = self._senses.ping_age_us + sent_us
            report = self._meter.report(stamp_ns, sense_age_us=age_us, rejected=rejected)
            reports.together.put(reports.cycle, report)
        reports.events(self.vehicle, stamp_ns, now_ns)

    def _report(self) -> int:
        """Report to the core what only the host can detect; return it as flags of TICK_INPUTS."""
        reported = 0
        if self._meter.violated:
            self.vehicle.core.report(reasons.BUDGET)
            reported |= INPUT_BUDGET
        if self._duplicates:
            self.vehicle.core.report(reasons.NAME_TAKEN)
            reported |= INPUT_NAME_TAKEN
        return reported

    def _publish_inputs(
        self, inputs: Inputs, teleop: Teleop | None, tick: int, reported: int
    ) -> None:
        """Publish everything that determined this tick, so that it can be re-executed."""
        senses = self._senses
        if not self.reports.wants_inputs:
            return
        given = CoreInputs(
            senses.wheels_seq, senses.scan_seq, senses.scan_age_ms, self.reports.recorded, reported
        )
        message = telemetry.tick_inputs(inputs, given, teleop, tick, senses.stamp_ns)
        self.reports.put_inputs(message)

    def _answer(self) -> None:
        """Act on the requests of this control period and answer each."""
        for incoming in self._due():
            request = incoming.message
            if request is None:
                incoming.reply(self.vehicle.parameters.describe())
                continue
            is_read = isinstance(request, READ_ONLY)
            reason = reasons.OK if is_read else self._rejection(incoming)
            if reason != reasons.OK:
                incoming.reply(self.vehicle.refused(request, reason))
                continue
            now_ns = self._clock.now_ns()
            answer = self.vehicle.receive(request, now_ns, incoming.operator)
            self._saved.reply(incoming, request, answer, now_ns)
            self.reports.record(request, answer)
            if self.vehicle.commands.restarts:
                self.end()

    def _due(self) -> Iterator[ServiceRequest]:
        """Yield at most as many requests as fit into a control period."""
        yield from self._halting.take(MAX_HALTED)
        for queue in (self._requests, self._unprivileged):
            for _ in range(min(queue.qsize(), MAX_ANSWERED)):
                yield queue.get_nowait()

    def _take_stop(self) -> bool:
        """Act on the latched emergency stop and answer its requests; return whether it was set.

        A request read after its stop was acted on is acknowledged while that stop holds. Pending
        requests are counted before the latch is read, because the latch is set before its request
        is queued. A request that arrives in between waits for the next call.
        """
        waiting = len(self._stop_requests)
        request, vehicle = self._stop.take(), self.vehicle
        while self._notes:
            vehicle.announce(Severity.WARNING, self._notes.popleft())
        self._is_unseen = request is not None and not vehicle.commands.is_stopped_by(
            request.request_id
        )
        if request is not None:
            answer = vehicle.receive(request, self._clock.now_ns())
            if self._is_unseen or request.request_id != vehicle.commands.stop_id:
                self.reports.record(request, answer)  # the next status shows it
        for _ in range(waiting):
            incoming = self._stop_requests.popleft()
            if vehicle.stopped:
                incoming.reply(STOPPED)
            else:
                incoming.drop()
        return request is not None

    def _rejection(self, incoming: ServiceRequest) -> int:
        """Return why a request is refused: no operator, no deadline, or one that has passed.

        An emergency stop overtakes queued requests, and a request is repeated when its answer is
        lost. One that releases a stop is therefore refused unless it names the newest one, and in
        the period that shows a new stop: more may wait in the latch.
        """
        if not incoming.operator:
            return reasons.NO_IDENTITY
        until_ns = incoming.good_until_ns
        if until_ns is None or not 0 <= until_ns - self._bus.now_ns() <= MAX_VALIDITY_NS:
            return reasons.TOO_LATE
        request, vehicle = incoming.message, self.vehicle
        if isinstance(request, CommandRequest) and kind_of(request).is_clear:
            is_named = request.stop_id == vehicle.commands.stop_id
            if self._is_unseen or (vehicle.stopped and not is_named):
                return reasons.NEWER_STOP
        return reasons.OK


def summary_of(error: Exception) -> str:
    """Return the type of an error and the first line of its text."""
    return f"{type(error).__name__}: {error}".partition("\n")[0]
