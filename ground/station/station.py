"""The ground station without its screen: it is polled, and then everything can be looked at."""

from typing import Any, Final

from ground.presence import Crew
from ground.station.hears import Hears
from ground.station.history import History
from ground.station.lease import Lease
from ground.station.log import Log
from ground.station.loss import Loss
from ground.station.moments import Moment
from ground.station.requests import Job
from ground.station.streams import StreamRow
from ground.station.world import WorldFacts
from ground.telemetry import Seen, Telemetry
from protocol.clock import Clock
from protocol.enums import Severity
from protocol.message import Message
from protocol.topics import Role, Topic

Point = tuple[float, float]
Row = dict[str, object]
CLOSING_S: Final = 2.0


class Station:
    """All that one operator sees of one or several robots, and the way to command them.

    Nothing here waits: questions go out in threads of their own, and what comes of them is in the
    log after a later `poll`. Every method is called from one thread, that of who shows it.
    A bus that only hears (a played log) makes a station that only looks.
    """

    def __init__(
        self,
        bus: Hears,
        robot: str,
        clock: Clock,
        world: WorldFacts | None = None,
        *,
        name: str = "operator",
    ) -> None:
        """`name` is what others are shown while this station holds a lease."""
        raise NotImplementedError

    # The round.

    def poll(self) -> None:
        """Look at everything once, and beat while the lease is ours; at most 20 times a second.

        The operator's heart beats here and nowhere else: an app that hangs is no operator.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Release the lease and end the threads, within 2 s; call it in a thread."""
        raise NotImplementedError

    # Which robot.

    @property
    def robot(self) -> str:
        """The robot that is shown and commanded."""
        raise NotImplementedError

    def robots(self) -> list[str]:
        """All that are there or were chosen, by name."""
        raise NotImplementedError

    def select(self, robot: str) -> None:
        """Show and command another; UserError when it cannot be a name. A lease that is held is
        kept, and its heart beaten, until it is released."""
        raise NotImplementedError

    # What is seen. Ages are taken at the last poll.

    @property
    def live(self) -> bool:
        """False over a played log: nothing can be commanded."""
        raise NotImplementedError

    @property
    def now_ns(self) -> int:
        """When the last poll was, by the station's clock."""
        raise NotImplementedError

    @property
    def time_s(self) -> float:
        """The same, since the station began."""
        raise NotImplementedError

    @property
    def telemetry(self) -> Telemetry:
        raise NotImplementedError

    def seen(self, topic: Topic[Any]) -> Seen:
        """The newest message with its age: show it, dim it, or show `--` and the age."""
        raise NotImplementedError

    @property
    def crew(self) -> Crew:
        raise NotImplementedError

    def streams(self) -> list[StreamRow]:
        raise NotImplementedError

    def restarts(self, role: Role) -> int:
        """How often the robot or its plant has been restarted under our eyes."""
        raise NotImplementedError

    @property
    def round_trip_ms(self) -> float | None:
        """Of a small question to the robot's loop, asked each second; None: not answered."""
        raise NotImplementedError

    @property
    def link_percent(self) -> float | None:
        """Frames of the robot that arrived in the last seconds, of those it sent."""
        raise NotImplementedError

    def loss(self) -> Loss | None:
        raise NotImplementedError

    @property
    def ready(self) -> bool:
        """False after a loss until state, parameters and lease were read again."""
        raise NotImplementedError

    @property
    def waiting_for(self) -> str:
        """What is still to be read before `ready`, in words; empty when nothing is."""
        raise NotImplementedError

    @property
    def lease(self) -> Lease:
        raise NotImplementedError

    @property
    def mission(self) -> Message | None:
        """The robot's MissionStatus; None when it is too old to be shown."""
        raise NotImplementedError

    @property
    def parameters(self) -> tuple[Row, ...] | None:
        """All of them, or None: never a part. Keys as in the robot's own list."""
        raise NotImplementedError

    @property
    def parameters_words(self) -> str:
        """How it stands with them: `41`, or `41 missing: asked 2 times, no answer`."""
        raise NotImplementedError

    @property
    def world(self) -> WorldFacts | None:
        raise NotImplementedError

    @property
    def history(self) -> History:
        raise NotImplementedError

    @property
    def trail(self) -> tuple[Point, ...]:
        raise NotImplementedError

    @property
    def seen_points(self) -> tuple[Point, ...]:
        """Where sonars had echoes, thinned on a grid."""
        raise NotImplementedError

    @property
    def hit(self) -> tuple[Point, ...]:
        """Where it began to go round an obstacle on the way to this goal."""
        raise NotImplementedError

    @property
    def leave(self) -> tuple[Point, ...]:
        """Where it took up its way to the goal again."""
        raise NotImplementedError

    @property
    def log(self) -> Log:
        raise NotImplementedError

    def note(self, text: str, severity: Severity = Severity.INFO) -> None:
        """A line of the ground's own in the log."""
        raise NotImplementedError

    def moment(self, time_ns: int | None = None) -> Moment | None:
        """What was decided at an instant of the station's clock (now, unless given) and around."""
        raise NotImplementedError

    def scene(self) -> Any:
        """Everything the map shows, as a `ground.map.Scene`."""
        raise NotImplementedError

    # What can be done.

    def refusal(self, *, moves: bool = True) -> str:
        """Why a request may not be made now; empty when it may. `moves`: it can move something."""
        raise NotImplementedError

    def submit(self, words: str, job: Job, *, moves: bool = True) -> bool:
        """Have a request done off this thread; False, with the reason in the log, when it may not.

        Only one is under way at a time. One that `moves` takes the lease first. What comes of it is
        a line in the log.
        """
        raise NotImplementedError

    @property
    def busy(self) -> str:
        """The words of the request under way."""
        raise NotImplementedError

    @property
    def last_command(self) -> str:
        """What was last asked and what came of it."""
        raise NotImplementedError

    def estop(self) -> None:
        """Stop the robot: asked again and again until it says yes, or given up loudly after 30 s.

        It has a thread to itself, needs no lease and is refused by nothing.
        """
        raise NotImplementedError

    @property
    def stopping(self) -> str:
        """How it stands with an e-stop that is not acknowledged yet; empty when there is none."""
        raise NotImplementedError

    def take_lease(self, *, seize: bool = False) -> None:
        """Become the robot's operator; `seize` takes it from another, loudly."""
        raise NotImplementedError

    def release_lease(self) -> None:
        raise NotImplementedError

    def reread(self) -> None:
        """Read state, parameters and lease again, as after a loss."""
        raise NotImplementedError
