"""Show the state of the selected robot at the last poll."""

from dataclasses import replace
from typing import Any, Final

from ground.client.parameter import Parameter
from ground.client.presence import PresentProcesses
from ground.client.status_line import knows_place
from ground.client.telemetry import Age, AgedMessage, Telemetry
from ground.map.scene import MapScene, MapTarget
from ground.station.fleet import Fleet
from ground.station.history.decision_history import Moment
from ground.station.history.event_log import LogLine
from ground.station.history.goal_progress import GoalProgress
from ground.station.history.message_series import MessageSeries
from ground.station.history.time_series import SeriesTable
from ground.station.link.loss import Loss
from ground.station.link.streams import StreamRow
from ground.station.robot.lease_state import UNKNOWN, LeaseView, lease_from
from ground.station.robot.robot_model import RobotModel
from ground.station.robot.robot_session import RobotSession
from ground.station.robot.robot_stop import StopRecord
from ground.station.roster import RosterEntry, roster_of
from ground.station.scene import others_of, scene_of, without_place
from ground.station.world import WorldFacts
from protocol.topics import LEASE, ODOMETRY, STATUS, TRUTH, Role, Topic
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    LeaseStatus,
    NavigatorStatus,
    PlanarOdometry,
)
from runtime.units import NS_PER_S

Point = tuple[float, float]
PLACE_BY_HAND: Final = "pose set X Y DEG"
PLACE_FROM_TRUTH: Final = "pose truth"


class StationView:
    """View of the selected robot; the station selects it.

    `answer` is the last line that the station itself added to the log, such as a command's outcome.
    """

    answer: LogLine | None = None

    def __init__(self, robot: str, now_ns: int, world: WorldFacts | None, fleet: Fleet) -> None:
        self._robot = robot
        self._given_world = world
        self._began_ns = self._now_ns = now_ns
        self._present = PresentProcesses(frozenset())
        self._fleet = fleet

    @property
    def _model(self) -> RobotModel:
        return self._fleet.models[self._robot]

    @property
    def _session(self) -> RobotSession | None:
        return self._fleet.sessions.get(self._robot)

    @property
    def live(self) -> bool:
        """True if the robot can be commanded; False for a played recording."""
        return bool(self._fleet.sessions)

    @property
    def now_ns(self) -> int:
        """Time of the last poll, by the station's clock."""
        return self._now_ns

    @property
    def time_s(self) -> float:
        """Time of the last poll since the start of the station, in s."""
        return (self._now_ns - self._began_ns) / NS_PER_S

    @property
    def telemetry(self) -> Telemetry:
        """Telemetry of the robot."""
        return self._model.telemetry

    def seen(self, topic: Topic[Any]) -> AgedMessage:
        """Return the newest message with its age, by which it is shown, dimmed or hidden."""
        return self.telemetry.seen(topic, self._now_ns)

    def stops_known(self, robot: str) -> tuple[int, ...]:
        """Return the emergency stop that a robot's status has named, and the last of this station.

        Another one may be pressed before they are released.
        """
        status, own = self.status_of(robot).message, self.last_stop(robot)
        seen = (status.stop_id,) if isinstance(status, NavigatorStatus) else ()
        return seen if own is None else (*seen, own.request_id)

    def all_stops_known(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Return the stops that are known of each robot."""
        return tuple((robot, self.stops_known(robot)) for robot in self._fleet.models)

    def status_of(self, robot: str) -> AgedMessage:
        """Return the newest status of any robot with its age."""
        model = self._fleet.models.get(robot)
        if model is None:
            return AgedMessage(None, None, Age.GONE)
        return model.telemetry.seen(STATUS, self._now_ns)

    @property
    def stopping(self) -> str:
        """State of an unacknowledged e-stop in words; empty without one."""
        return "" if self._session is None else self._session.stop.words

    def last_stop(self, robot: str) -> StopRecord | None:
        """Return the last e-stop that this station sent to a robot."""
        session = self._fleet.sessions.get(robot)
        return None if session is None else session.stop.record

    @property
    def present(self) -> PresentProcesses:
        """Processes that are present."""
        return self._present

    def roster(self, *, links: bool = False) -> list[RosterEntry]:
        """Return an entry for each watched robot, those that need attention first.

        With `links`, the share of delivered frames is computed, too.
        """
        return roster_of(self._fleet, self._robot, self._now_ns, links=links)

    def streams(self, robot: str = "") -> list[StreamRow]:
        """Return rate and loss of each topic of a robot, by default of the selected one."""
        model = self._fleet.models[robot or self._robot]
        return model.streams.rows(model.telemetry, self._now_ns)

    def restarts(self, role: Role) -> int:
        """Return how often the robot or its plant was restarted while watched."""
        return self._model.restarts[role].count if role in self._model.restarts else 0

    @property
    def restarted(self) -> str:
        """A recent restart with its cause if known; empty without one."""
        return self._model.restart_notice.words(self._now_ns)

    @property
    def restart_cause(self) -> str:
        """Cause of the robot's last restart, as it reported; empty without a report."""
        return self._model.restart_notice.cause

    @property
    def round_trip_ms(self) -> float | None:
        """Round trip of a request to the robot's loop, sent each second; None if unanswered."""
        took_ns = None if self._session is None else self._session.link_monitor.round_trip_ns
        return None if took_ns is None else took_ns / 1e6

    @property
    def link_percent(self) -> float | None:
        """Percentage of the robot's recent frames that arrived."""
        return self._model.streams.percent(self._now_ns)

    def loss(self) -> Loss | None:
        """Return the present loss, or None."""
        return None if self._session is None else self._session.link_monitor.loss()

    @property
    def ready(self) -> bool:
        """True if state, parameters and lease were read since the last loss."""
        return self._session is not None and self._session.link_monitor.contact.ready

    @property
    def waiting_for(self) -> str:
        """Items still to be read before `ready`, in words; empty when nothing is."""
        return "" if self._session is None else self._session.link_monitor.waiting_for

    @property
    def place_remedy(self) -> str:
        """The command that gives the robot its place; empty while it knows its place."""
        seen = self.seen(ODOMETRY)
        odometry = None if seen.age is Age.GONE else seen.message
        if not isinstance(odometry, PlanarOdometry) or knows_place(odometry):
            return ""
        is_simulated = self.seen(TRUTH).age is not Age.GONE
        return PLACE_FROM_TRUTH if is_simulated else PLACE_BY_HAND

    @property
    def lease(self) -> LeaseView:
        """The lease, if its status is recent."""
        seen = self.seen(LEASE)
        if not isinstance(seen.message, LeaseStatus) or seen.age is Age.GONE:
            return UNKNOWN
        if self._session is not None:
            return self._session.holding.lease
        return lease_from(seen.message, seen.age_ns or 0, own="")

    @property
    def mission_items(self) -> tuple[MapTarget, ...]:
        """The robot's mission, as downloaded or as uploaded by any operator."""
        return self._model.mission_items.mission

    @property
    def parameters(self) -> tuple[Parameter, ...] | None:
        """All parameters in the order of the robot's list, or None: never a part of them.

        Navigator and side are those of the newest status, which a command may have changed since.
        """
        rows, seen = self._model.parameters.rows, self.seen(STATUS)
        status = None if seen.age is Age.GONE else seen.message
        if rows is None or not isinstance(status, NavigatorStatus):
            return rows
        now = {"navigator": status.navigator, "side": status.side}
        if all(one.value == now.get(one.name, one.value) for one in rows):
            return rows
        return tuple(one.with_value(now.get(one.name, one.value)) for one in rows)

    def limit(self, name: str) -> float | None:
        """Return the robot's own value of a parameter, also during a loss; None while unknown."""
        return self._model.parameters.value(name)

    @property
    def parameters_words(self) -> str:
        """Number of parameters; or how often they were requested and why they are missing."""
        if self._session is not None:
            return self._session.parameters_words
        return "not in the recording" if self.parameters is None else f"{len(self.parameters)}"

    @property
    def world(self) -> WorldFacts | None:
        """World of the plant; before it is read, the world given to the station."""
        world = None if self._session is None else self._session.link_monitor.world
        return world or self._given_world

    @property
    def history(self) -> SeriesTable:
        """Series of values over time."""
        return self._model.figures.history

    @property
    def progress(self) -> GoalProgress:
        """Progress to the goal, and the time left at the present rate."""
        return self._model.figures.progress

    def last_drives(self) -> dict[str, str]:
        """Return outcome, time and distance of the last goal of each watched robot, in words."""
        models = sorted(self._fleet.models.items())
        return {robot: model.figures.last_drive.text() for robot, model in models}

    @property
    def fields(self) -> MessageSeries:
        """Series of the fields of messages that were chosen."""
        return self._model.figures.fields

    @property
    def worst_cycle(self) -> CycleReport | None:
        """Most expensive control cycle of the last second."""
        return self._model.figures.worst_cycle.cycle

    @property
    def silent_sonars(self) -> int:
        """A bit for each sonar, 1 if it gave no reading in one of the last scans."""
        return self._model.figures.sonar_gaps.silent

    def moment(self, time_ns: int | None = None) -> Moment | None:
        """Return the decision at an instant (default: now) with its context."""
        return self._model.decision_history.at(self._now_ns if time_ns is None else time_ns)

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        """Return the decisions after an instant of this clock with their times, oldest first."""
        return self._model.decision_history.decisions(after_ns)

    def scene(self) -> MapScene:
        """Return everything the map shows, except ghosts and cursor."""
        scene = scene_of(
            self._model,
            self.world,
            self._now_ns,
            lost=self.loss() is not None and not self.lease.others,
        )
        others = [one for name, one in self._fleet.models.items() if name != self._robot]
        scene = without_place(scene) if self.place_remedy else scene
        return replace(scene, others=others_of(others, self._now_ns))
