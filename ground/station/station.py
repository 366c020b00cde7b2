"""The ground station without its screen: it is polled, and then everything can be looked at."""

from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from typing import Final

from ground.client.parameter import parameters_in
from ground.client.presence import present_processes
from ground.station.bus_protocols import LiveBus, ReadableBus
from ground.station.history.event_log import Line, Log
from ground.station.robot.background_requests import Job, RequestThread, RequestWorker
from ground.station.robot.command_queue import CommandQueue
from ground.station.robot.robot_model import RobotModel
from ground.station.robot.robot_session import RobotSession
from ground.station.view import StationView
from ground.station.world import WorldFacts, world_in
from protocol.topics import PARAMETERS, WORLD, robot_name
from protocol.wire.enums import LeaseAction, Severity
from runtime.cli.terminal import printable
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

CLOSING_S: Final = 2.0
REPLAYED: Final = "this is a replay: nothing can be commanded"


class Station(StationView):
    """All that one operator sees of one or several robots, and the way to command them.

    Nothing here waits: questions go out in threads of their own, and what comes of them is in the
    log after a later `poll`. Every method is called from one thread, that of who shows it.
    A bus that only hears (a played log) makes a station that only looks; its time goes on, and who
    turns the log back makes another one.
    """

    def __init__(
        self,
        bus: ReadableBus,
        robot: str,
        clock: Clock,
        world: WorldFacts | None = None,
        *,
        name: str = "operator",
        lanes: Callable[[str], RequestWorker] = RequestThread,
    ) -> None:
        """`name` is what others are shown while this station holds a lease."""
        super().__init__(robot, clock.now_ns(), world)
        self.log = Log()
        self._bus = bus
        self._speaks = bus if isinstance(bus, LiveBus) else None
        self._clock = clock
        self._lanes = lanes
        self._lane = lanes("requests")
        self._commanding = CommandQueue(bus, clock, self._lane, self.note, name)
        if self._speaks is not None:
            self._speaks.watch(lambda _who, _came: None)
        self.select(robot)

    # The round.

    def poll(self) -> None:
        """Look at everything once, and beat while the lease is ours; at most 20 times a second.

        The operator's heart beats here and nowhere else: an app that hangs is no operator.
        """
        self._now_ns = now_ns = self._clock.now_ns()
        present = tuple(self._bus.present())
        self._crew = present_processes(present)
        for robot, watched in self._watched.items():
            again = watched.poll(now_ns, present)
            if robot in self._operated:
                self._operated[robot].poll(now_ns, again)
        self._commanding.poll(now_ns)
        for operated in self._operated.values():
            operated.beat(now_ns)

    def close(self) -> None:
        """Release the lease and end the threads, within 2 s; call it in a thread."""
        deadline_s = monotonic() + CLOSING_S
        self._lane.close(deadline_s - CLOSING_S / 2)
        for robot, operated in self._operated.items():
            if operated.tenure.ours:
                self._commanding.last_release(robot, operated.tenure)
            operated.close(deadline_s)

    # Which robot.

    @property
    def robot(self) -> str:
        """The robot that is shown and commanded."""
        return self._robot

    def robots(self) -> list[str]:
        """All that are there or were chosen, by name."""
        return sorted({*self._watched, *self._crew.robots()})

    def select(self, robot: str) -> None:
        """Show and command another; UserError when it cannot be a name.

        A lease that is held is kept, and its heart beaten, until it is released.
        """
        self._robot = robot_name(robot)
        if robot in self._watched:
            return
        own = "" if self._speaks is None else self._speaks.zid
        watched = RobotModel(self._bus, robot, self._clock.now_ns(), self._tell, own)
        self._watched[robot] = watched
        if self._speaks is None:
            self._read_recorded(watched)
        else:
            self._operated[robot] = RobotSession(
                self._speaks, watched, self._clock, self._lanes, self._tell
            )

    def _read_recorded(self, watched: RobotModel) -> None:
        """A recording is asked at once: it answers from memory, or has nothing to say."""
        for service in (PARAMETERS, WORLD):
            with suppress(RemoteError):
                answer = self._bus.ask(service, robot=watched.robot)
                if not isinstance(answer, bytes):
                    continue
                if service is PARAMETERS:
                    watched.parameters.read(tuple(parameters_in(answer)))
                elif self._given_world is None:
                    self._given_world = world_in(answer)

    # What can be done.

    def note(self, text: str, severity: int = Severity.INFO) -> None:
        """A line of the ground's own in the log."""
        self._tell("ground", text, severity)

    def _tell(self, source: str, text: str, severity: int) -> None:
        time_s = (self._clock.now_ns() - self._began_ns) / NS_PER_S
        self.log.add(Line(time_s, severity, source, printable(text)))

    def refusal(self, *, moves: bool = True) -> str:
        """Why a request may not be made now; empty when it may. `moves`: it can move something."""
        if self._own is None:
            return REPLAYED
        return self._own.refusal() if moves else ""

    def submit(self, words: str, job: Job, *, moves: bool = True) -> bool:
        """Have a request done off this thread; False, with the reason in the log, when it may not.

        Only one is under way at a time. One that `moves` takes the lease first. What comes of it is
        a line in the log.
        """
        why = self.refusal(moves=moves)
        if why or self._own is None:
            self.note(f"refused: {words}: {why}", Severity.WARNING)
            return False
        return self._commanding.submit(words, self._robot, self._own.tenure, job, moves=moves)

    @property
    def busy(self) -> str:
        """The words of the request under way."""
        return self._commanding.busy

    @property
    def last_command(self) -> str:
        """What was last asked and what came of it."""
        return self._commanding.last

    def estop(self) -> None:
        """Stop the robot: repeated until its status shows it, or given up loudly after 30 s.

        It has a thread to itself, needs no lease and is refused by nothing.
        """
        if self._own is None:
            self.note(REPLAYED, Severity.WARNING)
        else:
            self._own.estop()

    @property
    def stopping(self) -> str:
        """How it stands with an e-stop that is not acknowledged yet; empty when there is none."""
        return "" if self._own is None else self._own.stopping

    def take_lease(self, *, seize: bool = False) -> None:
        """Become the robot's operator; `seize` takes it from another, loudly."""
        self._lease_action(LeaseAction.SEIZE if seize else LeaseAction.TAKE)

    def release_lease(self) -> None:
        self._lease_action(LeaseAction.RELEASE)

    def _lease_action(self, action: LeaseAction) -> None:
        if self._own is None:
            self.note(REPLAYED, Severity.WARNING)
        else:
            self._commanding.lease(self._robot, self._own.tenure, action)

    def reread(self) -> None:
        """Read state, parameters and lease again, as after a loss."""
        if self._own is not None:
            self._own.vigil.reread(self._clock.now_ns())
