"""Define the ground station without a screen: poll it, then read the state of its robots."""

import asyncio
from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from time import time_ns
from typing import Any, Final

from ground.client.connection import Common
from ground.client.parameter import Parameter, parameters_in
from ground.client.presence import PresentProcesses, present_processes
from ground.client.status_line import knows_place
from ground.client.telemetry import Age, AgedMessage, Telemetry
from ground.map.scene import MapScene, MapTarget, RobotMark
from ground.station.bus_protocols import ReadableBus
from ground.station.fleet import Fleet, RosterEntry, name_key
from ground.station.history.decision_history import Moment
from ground.station.history.event_log import EventLog, LogLine
from ground.station.history.goal_progress import GoalProgress
from ground.station.history.time_series import MessageSeries, SeriesTable
from ground.station.link.loss import Loss
from ground.station.link.streams import StreamRow
from ground.station.robot.command_queue import REPLAYED, Begin, CommandQueue
from ground.station.robot.lease_state import UNKNOWN, LeaseView, lease_from
from ground.station.robot.robot_model import RobotModel
from ground.station.robot.robot_session import RobotSession
from ground.station.robot.robot_stop import StopRecord
from ground.station.scene import others_of, scene_of, without_place
from ground.station.world import WorldFacts, parse_world
from ground.text.wording import few
from protocol.bus.bus import Bus
from protocol.bus.network import MAX_ROBOTS, Network
from protocol.topics import (
    LEASE,
    ODOMETRY,
    PARAMETERS,
    STATUS,
    TRUTH,
    WORLD,
    Role,
    Topic,
    robot_name,
)
from protocol.wire.enums import Severity
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    LeaseStatus,
    NavigatorStatus,
    PlanarOdometry,
)
from runtime.cli.terminal import printable
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

Point = tuple[float, float]
PLACE_BY_HAND: Final = "pose set X Y DEG"
PLACE_FROM_TRUTH: Final = "pose truth"
STOPPED: Final = "an emergency stop came first"
MARK_NS: Final = 5 * NS_PER_MS
"""Time between two updates of the other robots on the map, for each of them."""
RESTARTED: Final = "other processes are started"
PROCESSES: Final = frozenset((Role.ROBOT.value, Role.PLANT.value))


class Station:
    """Everything an operator sees of one or several robots, with the operations to command them.

    No method waits: commands are carried out by the event loop that calls `poll`, and their results
    are in the log. All methods are called from one thread. With a bus that only receives (a played
    recording) the station only shows; after a jump back in the recording, create a new station.
    """

    answer: LogLine | None = None
    """The last line that the station itself added to the log, such as a command's outcome."""

    def __init__(
        self,
        bus: ReadableBus,
        robot: str,
        clock: Clock,
        world: WorldFacts | None = None,
        *,
        name: str = "operator",
        common: Common | None = None,
        begin: Begin = asyncio.create_task,
    ) -> None:
        """Create a station; `name` is shown to others while it holds a lease."""
        self.log = EventLog(began_s=time_ns() / NS_PER_S if isinstance(bus, Bus) else None)
        self._bus = bus
        self._clock = clock
        self._robot = robot
        self._given_world = world
        self._began_ns = self._now_ns = clock.now_ns()
        self._present = PresentProcesses(frozenset())
        common = common or Common(network=Network(), robot=robot)
        self._fleet = Fleet(bus, common, clock, begin, self._add_line, name)
        self._ended: frozenset[tuple[str, str]] = frozenset()
        self._marks: tuple[str, int, tuple[RobotMark, ...]] = "", 0, ()
        """Those of the other robots, and of which robot and when."""
        self.queue = CommandQueue(clock, begin, self.note, name, lambda: self._session)
        """The commands for the robot that is shown."""

        if isinstance(bus, Bus):
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
        self.queue.poll()
        for session in self._fleet.sessions.values():
            session.beat(now_ns)

    async def close(self) -> None:
        """Leave the leases, each by one request, and let the threads end.

        Another program of the same person keeps the lease that it uses.
        """
        sessions = self._fleet.sessions.values()
        await asyncio.gather(*(one.leave() for one in sessions if one.holding.is_used))
        self._fleet.close()

    @property
    def robot(self) -> str:
        """Name of the robot that is shown and commanded."""
        return self._robot

    def robots(self) -> list[str]:
        """Return the names of all robots that are present or were seen, r2 before r10."""
        names = {*self._fleet.models, *self._fleet.unwatched[:MAX_ROBOTS]}
        return sorted(names, key=name_key)

    # The state of the selected robot at the last poll.

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
        return self._fleet.roster(self._robot, self._now_ns, links=links)

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
        scene = without_place(scene) if self.place_remedy else scene
        return replace(scene, others=self._others())

    def _others(self) -> tuple[RobotMark, ...]:
        """Return the other robots on the map; many are updated less often than a few."""
        robot, since_ns, marks = self._marks
        if robot != self._robot or self._now_ns - since_ns >= MARK_NS * len(marks):
            models = [one for name, one in self._fleet.models.items() if name != self._robot]
            in_need = {entry.robot for entry in self.roster() if entry.needs_attention}
            marks = others_of(models, in_need, self._now_ns)
            self._marks = self._robot, self._now_ns, marks
        return marks

    # Selection and operation of robots.

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
        self.queue.cancel(RESTARTED)
        self.queue.last = ""
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
        self.queue.cancel(STOPPED)

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
        self.queue.cancel(STOPPED)
        for session in watched:
            session.stop.repeat()
        unknown = set(present_processes(self._bus.present()).robots()).difference(sessions)
        for robot in sorted(unknown)[:MAX_ROBOTS]:
            self._add(robot)
            sessions[robot].stop.press()
            sessions[robot].stop.repeat()
        names = few(sorted(sessions, key=name_key))
        self.note(f"E-STOP of all robots: {names}", Severity.WARNING)

    def reread(self) -> None:
        """Read state, parameters and lease again, as after a loss."""
        if self._session is not None:
            self._session.link_monitor.reread(self._clock.now_ns())
