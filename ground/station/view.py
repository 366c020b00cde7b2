"""Everything of the shown robot that can be looked at, as it was at the last poll."""

from typing import Any

from ground.client.parameter import Parameter
from ground.client.presence import PresentProcesses
from ground.client.telemetry import Age, AgedMessage, Telemetry
from ground.map import Scene, Shape, Target
from ground.station.history.decision_history import Moment
from ground.station.history.time_series import History
from ground.station.link.loss import Loss
from ground.station.link.streams import StreamRow
from ground.station.robot.lease_state import UNKNOWN, Lease, lease_in
from ground.station.robot.robot_model import RobotModel
from ground.station.robot.robot_session import RobotSession
from ground.station.scene import scene_of
from ground.station.world import WorldFacts
from protocol.topics import LEASE, MISSION, Role, Topic
from protocol.wire.messages import AvoidanceDecision, CycleReport, LeaseStatus, MissionStatus
from runtime.units import NS_PER_S

Point = tuple[float, float]


class StationView:
    """Of one robot at a time; which one is the station's to choose."""

    def __init__(self, robot: str, now_ns: int, world: WorldFacts | None) -> None:
        self._robot = robot
        self._given_world = world
        self._began_ns = self._now_ns = now_ns
        self._crew = PresentProcesses(frozenset())
        self._watched: dict[str, RobotModel] = {}
        self._operated: dict[str, RobotSession] = {}

    @property
    def _shown(self) -> RobotModel:
        return self._watched[self._robot]

    @property
    def _own(self) -> RobotSession | None:
        return self._operated.get(self._robot)

    # What is seen. Ages are taken at the last poll.

    @property
    def live(self) -> bool:
        """False over a played log: nothing can be commanded."""
        return bool(self._operated)

    @property
    def now_ns(self) -> int:
        """When the last poll was, by the station's clock."""
        return self._now_ns

    @property
    def time_s(self) -> float:
        """The same, since the station began."""
        return (self._now_ns - self._began_ns) / NS_PER_S

    @property
    def telemetry(self) -> Telemetry:
        return self._shown.telemetry

    def seen(self, topic: Topic[Any]) -> AgedMessage:
        """The newest message with its age: show it, dim it, or show `--` and the age."""
        return self.telemetry.seen(topic, self._now_ns)

    @property
    def crew(self) -> PresentProcesses:
        return self._crew

    def streams(self) -> list[StreamRow]:
        return self._shown.streams.rows(self.telemetry, self._now_ns)

    def restarts(self, role: Role) -> int:
        """How often the robot or its plant has been restarted under our eyes."""
        return self._shown.restarts[role].count if role in self._shown.restarts else 0

    @property
    def restarted(self) -> str:
        """A restart that is news, and its cause as far as it is known; empty when there is none."""
        return self._shown.again.words(self._now_ns)

    @property
    def restart_cause(self) -> str:
        """What the robot last told of how the one before it ended; empty when it told nothing."""
        return self._shown.again.cause

    @property
    def round_trip_ms(self) -> float | None:
        """Of a small question to the robot's loop, asked each second; None: not answered."""
        took_ns = None if self._own is None else self._own.vigil.round_trip_ns
        return None if took_ns is None else took_ns / 1e6

    @property
    def link_percent(self) -> float | None:
        """Frames of the robot that arrived in the last seconds, of those it sent."""
        return self._shown.streams.percent(self._now_ns)

    def loss(self) -> Loss | None:
        return None if self._own is None else self._own.vigil.loss()

    @property
    def ready(self) -> bool:
        """False after a loss until state, parameters and lease were read again."""
        return self._own is not None and self._own.vigil.contact.ready

    @property
    def waiting_for(self) -> str:
        """What is still to be read before `ready`, in words; empty when nothing is."""
        return "" if self._own is None else self._own.vigil.waiting_for

    @property
    def lease(self) -> Lease:
        """Who commands the robot, as long as that has been heard lately."""
        seen = self.seen(LEASE)
        if not isinstance(seen.message, LeaseStatus) or seen.age is Age.GONE:
            return UNKNOWN
        if self._own is not None:
            return self._own.tenure.lease
        return lease_in(seen.message, seen.age_ns or 0, own="")

    @property
    def mission(self) -> MissionStatus | None:
        """How far the mission is; None when that is too old to be shown."""
        return self.telemetry.live(MISSION, self._now_ns)

    @property
    def mission_items(self) -> tuple[Target, ...]:
        """The robot's mission, as downloaded or as uploaded in our hearing."""
        return self._shown.charts.mission

    @property
    def fence(self) -> Shape | None:
        return self._shown.charts.fence

    @property
    def parameters(self) -> tuple[Parameter, ...] | None:
        """All of them, or None: never a part. Keys as in the robot's own list."""
        return self._shown.parameters.rows

    @property
    def parameters_words(self) -> str:
        """How many there are; or that they are missing, how often they were asked for, and why."""
        if self._own is not None:
            return self._own.parameters_words
        return "a log without a list" if self.parameters is None else f"{len(self.parameters)}"

    @property
    def world(self) -> WorldFacts | None:
        """What the plant says; before that, what the station was given."""
        told = None if self._own is None else self._own.vigil.world
        return told or self._given_world

    @property
    def history(self) -> History:
        return self._shown.figures.history

    @property
    def dearest_cycle(self) -> CycleReport | None:
        """Of the last second; how old the newest one is, is told by `seen`."""
        return self._shown.figures.dearest.cycle

    @property
    def trail(self) -> tuple[Point, ...]:
        return self._shown.figures.trail.points()

    def moment(self, time_ns: int | None = None) -> Moment | None:
        """What was decided at an instant of the station's clock (now, unless given) and around."""
        return self._shown.moments.at(self._now_ns if time_ns is None else time_ns)

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        """What was decided after an instant of the station's clock, and when; the oldest first."""
        return self._shown.moments.decisions(after_ns)

    def scene(self) -> Scene:
        """Everything the map shows; without ghosts and cursor, which are not the robot's."""
        return scene_of(
            self._shown,
            self.world,
            self._now_ns,
            lost=self.loss() is not None and not self.lease.others,
            others=[one for name, one in self._watched.items() if name != self._robot],
        )
