"""Run a ground station without a screen: poll it, then read its state."""

from collections.abc import Callable, Collection
from contextlib import suppress
from time import monotonic, time_ns
from typing import Final

from ground.client.parameter import parameters_in
from ground.client.presence import present_processes
from ground.station.bus_protocols import LiveBus, ReadableBus
from ground.station.fleet import Fleet
from ground.station.history.event_log import EventLog, LogLine
from ground.station.robot.background_requests import Job, RequestThread, RequestWorker
from ground.station.robot.command_queue import CommandQueue
from ground.station.robot.robot_model import RobotModel
from ground.station.roster import name_key
from ground.station.view import StationView
from ground.station.world import WorldFacts, parse_world
from protocol.bus.network import MAX_ROBOTS
from protocol.topics import PARAMETERS, WORLD, Role, robot_name
from protocol.wire.enums import LeaseAction, Severity
from runtime.cli.terminal import printable
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

CLOSING_S: Final = 2.0
REPLAYED: Final = "a replay accepts no commands"
STOPPED: Final = "an emergency stop came first"
RESTARTED: Final = "other processes are started"
PROCESSES: Final = frozenset((Role.ROBOT.value, Role.PLANT.value))


class Station(StationView):
    """Everything an operator sees of one or several robots, with the operations to command them.

    No method waits: requests run in threads, and their results are in the log after a later `poll`.
    All methods are called from one thread. With a bus that only receives (a played recording) the
    station only shows; after a jump back in the recording, create a new station.
    """

    def __init__(
        self,
        bus: ReadableBus,
        robot: str,
        clock: Clock,
        world: WorldFacts | None = None,
        *,
        name: str = "operator",
        workers: Callable[[str], RequestWorker] = RequestThread,
    ) -> None:
        """Create a station; `name` is shown to others while it holds a lease."""
        self.log = EventLog(began_s=time_ns() / NS_PER_S if isinstance(bus, LiveBus) else None)
        fleet = Fleet(bus, clock, workers, self._add_line)
        super().__init__(robot, clock.now_ns(), world, fleet)
        self._bus = bus
        self._clock = clock
        self._ended: frozenset[tuple[str, str]] = frozenset()
        self._worker = workers("requests")
        self._commanding = CommandQueue(bus, clock, self._worker, self.note, name)
        if isinstance(bus, LiveBus):
            bus.watch(lambda _who, _came: None)
        self.select(robot)

    def poll(self) -> None:
        """Process everything once, and send heartbeats while the lease is held.

        Call it at most 20 times a second. Heartbeats are sent here only: an app that hangs stops
        being the operator.
        """
        self._now_ns = now_ns = self._clock.now_ns()
        present = tuple(
            token for token in self._bus.present() if (token.role, token.zid) not in self._ended
        )
        self._present = present_processes(present)
        self._watch(now_ns)
        self._fleet.poll(present, self._robot, now_ns)
        self._commanding.poll(now_ns)
        for session in self._fleet.sessions.values():
            session.beat(now_ns)

    def close(self) -> None:
        """Give the lease back and end the threads, within 2 s; call it in a thread."""
        deadline_s = monotonic() + CLOSING_S
        self._worker.close(deadline_s - CLOSING_S / 2)
        for robot, session in self._fleet.sessions.items():
            if session.holding.is_used:
                self._commanding.leave(robot, session.holding)
        self._fleet.close(deadline_s)

    @property
    def robot(self) -> str:
        """Name of the robot that is shown and commanded."""
        return self._robot

    def robots(self) -> list[str]:
        """Return the names of all robots that are present or were seen, r2 before r10."""
        names = {*self._fleet.models, *self._fleet.unwatched[:MAX_ROBOTS]}
        return sorted(names, key=name_key)

    def _watch(self, now_ns: int) -> None:
        """Watch robots that have appeared."""
        crowd = bool(self._fleet.unwatched)
        for robot in self._fleet.watch(self._present.robots(), now_ns):
            self._read_recorded(self._fleet.models[robot])
        if self._fleet.unwatched and not crowd:
            self.note(
                f"too many robots: {len(self._fleet.unwatched)} of them are not watched "
                f"(`select` shows one)",
                Severity.WARNING,
            )

    def select(self, robot: str) -> None:
        """Show and command another robot; UserError for a malformed name.

        A lease that is held is kept, with its heartbeat, until it is released.
        """
        before, self._robot = self._session, robot_name(robot)
        if robot not in self._fleet.models:
            self._add(robot)
        if before is not None:
            before.deselect()
        if self._session is not None:
            self._session.select()

    def set_pace(self, pace: float) -> None:
        """Judge the ages of all messages in simulated time: `pace` is that over wall time."""
        for model in self._fleet.models.values():
            model.telemetry.pace = pace

    def begin_again(self, ended: Collection[str] = ()) -> None:
        """Forget all that was received, because other processes are started now.

        Until they are received for the first time, nothing counts as lost. The robots and plants of
        `ended` have ended, though the bus may still show some of them for a moment.
        """
        self._ended = frozenset(
            (token.role, token.zid)
            for token in self._bus.present()
            if token.robot in ended and token.role in PROCESSES
        )
        self._commanding.cancel(RESTARTED)
        self._fleet.forget()
        self.select(self._robot)
        if self._session is not None:
            self._session.link_monitor.expect_start(self._clock.now_ns())

    def _add(self, robot: str) -> None:
        self._fleet.add(robot)
        self._read_recorded(self._fleet.models[robot])

    def _read_recorded(self, model: RobotModel) -> None:
        """Read parameters and world of a recording at once: it answers from memory."""
        if self.live:
            return
        with suppress(RemoteError):
            answer = self._bus.ask(WORLD, robot=model.robot)
            if isinstance(answer, bytes):
                world = parse_world(answer)
                model.plant_radius_m = world.radius_m
                self._given_world = self._given_world or world
        try:
            answer = self._bus.ask(PARAMETERS, robot=model.robot)
            if isinstance(answer, bytes):
                model.parameters.read(tuple(parameters_in(answer)))
        except RemoteError as error:
            words = f"{model.robot}: its limits and measures are unknown: {error}"
            self._add_line("ground", words, Severity.INFO)

    def note(self, text: str, severity: int = Severity.INFO) -> None:
        """Add a line of the ground station to the log."""
        self._add_line("ground", text, severity)
        self.answer = self.log.last(1)[0]

    def _add_line(self, source: str, text: str, severity: int) -> None:
        time_s = (self._clock.now_ns() - self._began_ns) / NS_PER_S
        self.log.add(LogLine(time_s, severity, source, printable(text)))

    def refusal(self, *, moves: bool = True) -> str:
        """Return why a request is rejected now; `moves`: it moves the robot. Empty if allowed."""
        if self._session is None:
            return REPLAYED
        return self._session.refusal() if moves else ""

    def submit(self, words: str, job: Job, *, moves: bool = True) -> bool:
        """Run a request in a thread; return False with the reason in the log if it is rejected.

        One request is pending at a time, and a few can wait. A request that `moves` the robot
        takes the lease first. The result is a line in the log.
        """
        why, session = self.refusal(moves=moves), self._session
        if why or session is None:
            self.note(f"refused: {words}: {why}", Severity.WARNING)
            return False
        refusal = session.refusal if moves else None
        return self._commanding.submit(words, self._robot, session.holding, job, refusal)

    @property
    def busy(self) -> str:
        """Words of the pending request."""
        return self._commanding.busy

    @property
    def last_command(self) -> str:
        """The last request and its result."""
        return self._commanding.last

    def estop(self, robot: str = "") -> None:
        """Stop a robot, by default the selected one.

        The stop is repeated until its status confirms it, or until an alarm after 30 s. It has its
        own thread, needs no lease, and is never rejected.
        """
        robot = robot_name(robot or self._robot)
        if not self.live:
            self.note(REPLAYED, Severity.WARNING)
            return
        if robot not in self._fleet.models:
            self._add(robot)
        stop = self._fleet.sessions[robot].stop
        stop.press()
        stop.repeat()
        self._commanding.cancel(STOPPED)

    def estop_all(self) -> None:
        """Stop every robot that is present or was seen, each as with `estop`.

        All stops are sent before any acknowledgement is awaited, those of robots that are already
        watched before the bus is asked who else is there.
        """
        if not self.live:
            self.note(REPLAYED, Severity.WARNING)
            return
        sessions = self._fleet.sessions
        watched = list(sessions.values())
        for session in watched:
            session.stop.press()
        self._commanding.cancel(STOPPED)
        for session in watched:
            session.stop.repeat()
        unknown = set(present_processes(self._bus.present()).robots()).difference(sessions)
        for robot in sorted(unknown)[:MAX_ROBOTS]:
            self._add(robot)
            sessions[robot].stop.press()
            sessions[robot].stop.repeat()
        self.note(f"E-STOP of all robots: {' '.join(sorted(sessions))}", Severity.WARNING)

    def take_lease(self, *, seize: bool = False) -> None:
        """Become the robot's operator; `seize` takes the lease from another operator."""
        self._lease_action(LeaseAction.SEIZE if seize else LeaseAction.TAKE)

    def release_lease(self) -> None:
        """Release the lease."""
        self._lease_action(LeaseAction.RELEASE)

    def _lease_action(self, action: LeaseAction) -> None:
        if self._session is None:
            self.note(REPLAYED, Severity.WARNING)
        else:
            self._commanding.lease(self._robot, self._session.holding, action)

    def reread(self) -> None:
        """Read state, parameters and lease again, as after a loss."""
        if self._session is not None:
            self._session.link_monitor.reread(self._clock.now_ns())
