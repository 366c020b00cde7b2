"""Define a station that a test fills, and a command sink that only records commands."""

from collections.abc import Callable, Collection
from typing import Any

from ground.client.operations.session import Operation
from ground.client.parameter import Parameter
from ground.client.presence import PresentProcesses
from ground.client.results import Outcome
from ground.client.telemetry import Age, AgedMessage, Telemetry
from ground.console.app_commands import AppCommand
from ground.console.completion import Assistance, Candidate, assist
from ground.console.spelling import line_of
from ground.map.scene import MapScene, MapTarget
from ground.station.fleet import Attention, RosterEntry, by_attention
from ground.station.history.decision_history import Moment
from ground.station.history.event_log import EventLog, LogLine
from ground.station.history.goal_progress import GoalProgress
from ground.station.history.time_series import MessageSeries, SeriesTable
from ground.station.link.loss import Loss
from ground.station.link.streams import StreamRow
from ground.station.robot.background_requests import JobResult
from ground.station.robot.lease_state import LeaseView
from ground.station.robot.robot_stop import StopRecord
from ground.station.station import Station
from ground.station.world import WorldFacts
from protocol.topics import (
    CYCLE,
    DECISION,
    SONAR,
    STATUS,
    TOPICS,
    Role,
    Topic,
)
from protocol.wire.enums import Severity
from protocol.wire.messages import AvoidanceDecision, CycleReport
from runtime.clock import ManualClock
from tests.support.air import Air

MS = 1_000_000
S = 1_000 * MS
NOTHING = AgedMessage(None, None, Age.GONE)


class FakeStation(Station):
    """A station whose attributes are public; requests run at once and are kept in `asked`."""

    def __init__(self, clock: ManualClock | None = None) -> None:
        self.clock = clock or ManualClock(100 * S)
        self._began_ns = self.clock.now_ns()
        self.air = Air()
        self._telemetry = Telemetry(self.air, "r1", TOPICS)
        self._fields = MessageSeries(self._telemetry, self._began_ns)
        self._figures, self.log = SeriesTable(), EventLog()
        self.polls = 0
        self.begun_again = 0
        self.stops = 0
        self.stops_of_all = 0
        self.last_stop_now: StopRecord | None = None
        self.asked: list[str] = []
        self.world_now: WorldFacts | None = None
        self.scene_now = MapScene()
        self.decisions_now: list[tuple[int, AvoidanceDecision]] = []
        self.loss_now: Loss | None = None
        self.ready_now, self.waiting_now = True, ""
        self.lease_now = LeaseView()
        self.parameters_now: tuple[Parameter, ...] | None = ()
        self.streams_now: list[StreamRow] = []
        self.round_trip_now, self.percent_now = 12.0, 100.0
        self.progress_now = GoalProgress()
        self.items_now: tuple[MapTarget, ...] = ()
        self.robots_now = ["r1"]
        self.robot_now = "r1"
        self.roster_now: list[RosterEntry] = []
        self.stopping_now = ""
        self.restarts_now: dict[Role, int] = {}
        self.restarted_now = self.cause_now = ""
        self.last_now = ""
        self.live_now = True
        self.closed = False

    def set_pace(self, pace: float) -> None:
        self._telemetry.pace = pace

    def begin_again(self, ended: Collection[str] = ()) -> None:
        self.begun_again += 1

    def poll(self) -> None:
        self.polls += 1

    def close(self) -> None:
        self.closed = True

    @property
    def robot(self) -> str:
        return self.robot_now

    def robots(self) -> list[str]:
        return self.robots_now

    def roster(self, *, links: bool = False) -> list[RosterEntry]:
        """Return `roster_now`, and a quiet entry for each other robot of `robots_now`."""
        given = {entry.robot: entry for entry in self.roster_now}
        entries = [
            given.get(robot, RosterEntry(robot, False, Attention.NONE, "ready", NOTHING))
            for robot in self.robots_now
        ]
        return by_attention(
            entry._replace(is_selected=entry.robot == self.robot_now) for entry in entries
        )

    def select(self, robot: str) -> None:
        self.robot_now = robot

    @property
    def live(self) -> bool:
        return self.live_now

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns()

    @property
    def time_s(self) -> float:
        return (self.clock.now_ns() - self._began_ns) / S

    @property
    def telemetry(self) -> Telemetry:
        return self._telemetry

    def seen(self, topic: Topic[Any]) -> AgedMessage:
        return self._telemetry.seen(topic, self.now_ns)

    def status_of(self, robot: str) -> AgedMessage:
        return self.seen(STATUS)

    @property
    def present(self) -> PresentProcesses:
        return PresentProcesses(frozenset({("r1", "robot"), ("r1", "plant"), ("r1", "ground")}))

    def streams(self, robot: str = "") -> list[StreamRow]:
        """Return `streams_now` for the selected robot; the others have no streams."""
        return self.streams_now if robot in ("", self.robot_now) else []

    def restarts(self, role: Role) -> int:
        return self.restarts_now.get(role, 0)

    @property
    def restarted(self) -> str:
        return self.restarted_now

    @property
    def restart_cause(self) -> str:
        return self.cause_now

    @property
    def round_trip_ms(self) -> float | None:
        return self.round_trip_now

    @property
    def link_percent(self) -> float | None:
        return self.percent_now

    def loss(self) -> Loss | None:
        return self.loss_now

    @property
    def ready(self) -> bool:
        return self.ready_now

    @property
    def waiting_for(self) -> str:
        return self.waiting_now

    @property
    def lease(self) -> LeaseView:
        return self.lease_now

    @property
    def mission_items(self) -> tuple[MapTarget, ...]:
        return self.items_now

    @property
    def parameters(self) -> tuple[Parameter, ...] | None:
        return self.parameters_now

    def limit(self, name: str) -> float | None:
        values = {one.name: one.value for one in self.parameters_now or ()}
        return values.get(name)

    @property
    def parameters_words(self) -> str:
        return (
            "41" if self.parameters_now is not None else "41 missing: requested 2 times, no answer"
        )

    @property
    def world(self) -> WorldFacts | None:
        return self.world_now

    @property
    def worst_cycle(self) -> CycleReport | None:
        newest = self.telemetry.latest(CYCLE)
        return None if newest is None else newest[0]

    @property
    def silent_sonars(self) -> int:
        newest = self.telemetry.latest(SONAR)
        return 0 if newest is None else 0xFF & ~newest[0].valid

    @property
    def progress(self) -> GoalProgress:
        return self.progress_now

    @property
    def fields(self) -> MessageSeries:
        return self._fields

    @property
    def history(self) -> SeriesTable:
        return self._figures

    def note(self, text: str, severity: int = Severity.INFO) -> None:
        self.answer = LogLine(self.time_s, severity, "ground", text)
        self.log.add(self.answer)

    def moment(self, time_ns: int | None = None) -> Moment | None:
        heard, now_ns = self.telemetry, self.now_ns
        decision = heard.live(DECISION, now_ns)
        if decision is None:
            return None
        status, cycle = heard.live(STATUS, now_ns), heard.live(CYCLE, now_ns)
        return Moment(now_ns, decision, None, status, cycle)

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        return [pair for pair in self.decisions_now if pair[0] > after_ns]

    def scene(self) -> MapScene:
        return self.scene_now

    def refusal(self, *, moves: bool = True) -> str:
        return "" if self.ready_now or not moves else "no message from the robot for 2.0 s"

    def submit(self, words: str, job: Callable[[], JobResult], *, moves: bool = True) -> bool:
        self.asked.append(words)
        why = self.refusal(moves=moves)
        self.note(f"{words}: {why or job().text}")
        return not why

    @property
    def busy(self) -> str:
        return ""

    @property
    def last_command(self) -> str:
        return self.last_now

    def estop(self, robot: str = "") -> None:
        self.stops += 1

    def estop_all(self) -> None:
        self.stops_of_all += 1

    def last_stop(self, robot: str) -> StopRecord | None:
        return self.last_stop_now

    @property
    def stopping(self) -> str:
        return self.stopping_now

    def take_lease(self, *, seize: bool = False) -> None:
        self.lease_now = LeaseView(held=True, ours=True)

    def release_lease(self) -> None:
        self.lease_now = LeaseView()

    def reread(self) -> None:
        self.asked.append("reread")


class FakeCommandSink:
    """Records the commands that it was given."""

    def __init__(self) -> None:
        self.given: list[str] = []
        self.steered: list[tuple[float, float]] = []
        self.teleop = False
        self.last = ""
        self.draft_items: tuple[MapTarget, ...] = ()
        self.begun: list[bool] = []

    def begin_world(self, *, keeps_draft: bool) -> None:
        self.begun.append(keeps_draft)
        if not keeps_draft:
            self.draft_items = ()

    def run_line(self, line: str) -> None:
        if not line:
            return
        self.given.append(line)
        self.last = f"sidestep {line}"

    def perform(self, command: Operation[Outcome] | AppCommand) -> None:
        self.run_line(line_of(command))

    def is_local(self, line: str) -> bool:
        return line.split()[0] in ("theme", "help", "screen")

    def assist(self, text: str) -> Assistance:
        return assist(text) if text else Assistance()

    def search(self, words: str) -> Assistance:
        found = (line for line in reversed(self.given) if words in line)
        return Assistance(tuple(Candidate(line, line) for line in found))

    def begin_teleop(self) -> bool:
        self.teleop = True
        return True

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        self.steered.append((speed_m_s, yaw_rate_rad_s))

    def end_teleop(self) -> None:
        self.teleop = False

    def recall(self, text: str, step: int) -> str:
        return self.given[-1] if self.given and step < 0 else ""
