"""A station that a test fills, and a taker of command lines that only remembers them."""

from collections.abc import Callable
from math import radians
from typing import Any

from ground.map import Outline, Robot, Scene, Target
from ground.presence import Crew
from ground.station import (
    History,
    Lease,
    Log,
    Loss,
    Moment,
    Outcome,
    Station,
    StreamRow,
    WorldFacts,
)
from ground.station.log import Line
from ground.telemetry import Age, Seen, Telemetry
from protocol.clock import ManualClock
from protocol.codec import Encoder
from protocol.enums import Branch, GoalState, Mode, Navigator, Severity, Vehicle
from protocol.mailbox import Mailbox, Sample
from protocol.message import Message
from protocol.messages import (
    AvoidanceDecision,
    CycleReport,
    Heartbeat,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from protocol.topics import (
    CYCLE,
    DECISION,
    ENCODING,
    HEARTBEAT,
    ODOMETRY,
    SONAR,
    STATUS,
    TOPICS,
    Role,
    Topic,
)

MS = 1_000_000
S = 1_000 * MS


class Air:
    """Mailboxes that a test fills."""

    def __init__(self) -> None:
        self.boxes: dict[str, Mailbox[Any]] = {}
        self._encoder = Encoder(1, 1)

    def mailbox(
        self,
        topic: Topic[Any],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
    ) -> Mailbox[Any]:
        return self.boxes.setdefault(topic.path, Mailbox(topic, notify))

    def put(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        self.boxes[topic.path].store(Sample(ENCODING, self._encoder.encode(message)), at_ns)


class FakeStation(Station):
    """Everything is an attribute; requests are done at once and kept in `asked`."""

    def __init__(self, clock: ManualClock | None = None) -> None:
        self.clock = clock or ManualClock(100 * S)
        self._began_ns = self.clock.now_ns()
        self.air = Air()
        self._telemetry = Telemetry(self.air, "r1", TOPICS)
        self._figures, self.log = History(), Log()
        self.polls = 0
        self.stops = 0
        self.asked: list[str] = []
        self.world_now: WorldFacts | None = None
        self.scene_now = Scene()
        self.decisions_now: list[tuple[int, AvoidanceDecision]] = []
        self.loss_now: Loss | None = None
        self.ready_now, self.waiting_now = True, ""
        self.lease_now = Lease()
        self.parameters_now: tuple[dict[str, object], ...] | None = ()
        self.streams_now: list[StreamRow] = []
        self.items_now: tuple[Target, ...] = ()
        self.robots_now = ["r1"]
        self.robot_now = "r1"
        self.stopping_now = ""
        self.last_now = ""
        self.live_now = True
        self.closed = False

    def poll(self) -> None:
        self.polls += 1

    def close(self) -> None:
        self.closed = True

    @property
    def robot(self) -> str:
        return self.robot_now

    def robots(self) -> list[str]:
        return self.robots_now

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

    def seen(self, topic: Topic[Any]) -> Seen:
        return self._telemetry.seen(topic, self.now_ns)

    @property
    def crew(self) -> Crew:
        return Crew(frozenset({("r1", "robot"), ("r1", "plant"), ("r1", "ground")}))

    def streams(self) -> list[StreamRow]:
        return self.streams_now

    def restarts(self, role: Role) -> int:
        return 0

    @property
    def round_trip_ms(self) -> float | None:
        return 12.0

    @property
    def link_percent(self) -> float | None:
        return 100.0

    def loss(self) -> Loss | None:
        return self.loss_now

    @property
    def ready(self) -> bool:
        return self.ready_now

    @property
    def waiting_for(self) -> str:
        return self.waiting_now

    @property
    def lease(self) -> Lease:
        return self.lease_now

    @property
    def mission(self) -> MissionStatus | None:
        return None

    @property
    def mission_items(self) -> tuple[Target, ...]:
        return self.items_now

    @property
    def parameters(self) -> tuple[dict[str, object], ...] | None:
        return self.parameters_now

    @property
    def parameters_words(self) -> str:
        return "41" if self.parameters_now is not None else "41 missing: asked 2 times, no answer"

    @property
    def world(self) -> WorldFacts | None:
        return self.world_now

    @property
    def history(self) -> History:
        return self._figures

    def note(self, text: str, severity: int = Severity.INFO) -> None:
        self.log.add(Line(self.time_s, severity, "ground", text))

    def moment(self, time_ns: int | None = None) -> Moment | None:
        return None

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        return [pair for pair in self.decisions_now if pair[0] > after_ns]

    def scene(self) -> Scene:
        return self.scene_now

    def refusal(self, *, moves: bool = True) -> str:
        return "" if self.ready_now or not moves else "nothing is heard of r1"

    def submit(self, words: str, job: Callable[[], Outcome], *, moves: bool = True) -> bool:
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

    def estop(self) -> None:
        self.stops += 1

    @property
    def stopping(self) -> str:
        return self.stopping_now

    def take_lease(self, *, seize: bool = False) -> None:
        self.lease_now = Lease(held=True, ours=True)

    def release_lease(self) -> None:
        self.lease_now = Lease()

    def reread(self) -> None:
        self.asked.append("reread")


class FakeOrders:
    """Remembers what was given."""

    def __init__(self) -> None:
        self.given: list[str] = []
        self.steered: list[tuple[float, float]] = []
        self.hand = False
        self.last = ""

    def give(self, line: str) -> None:
        if not line:
            return
        self.given.append(line)
        self.last = f"sidestep {line}"

    def is_local(self, line: str) -> bool:
        return line.split()[0] in ("theme", "help", "screen")

    def complete(self, text: str) -> list[str]:
        words = ("goal ", "hold", "help")
        return [word for word in words if text and word.startswith(text)]

    def take_hand(self) -> bool:
        self.hand = True
        return True

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        self.steered.append((speed_m_s, yaw_rate_rad_s))

    def drop_hand(self) -> None:
        self.hand = False

    def recall(self, text: str, step: int) -> str:
        return self.given[-1] if self.given and step < 0 else ""


def driving(station: FakeStation, at_s: float = 0.0) -> FakeStation:
    """A robot on its way round an obstacle, heard of at `at_s` after the beginning."""
    now_ns = station.clock.now_ns() + round(at_s * S)
    for topic, message in drive_messages(now_ns).items():
        station.air.put(topic, message, now_ns)
    station.world_now = WorldFacts(
        "demo", (10.0, 8.0), (), (), (0.8, 1.0, 0.0), Target(9.0, 7.0, 0.0), 0.12, "{}"
    )
    station.scene_now = scene()
    station.parameters_now = (
        {"name": "guard_stop_m", "value": 0.10, "default": 0.10, "unit": "m"},
        {"name": "sonar_max_m", "value": 3.0, "default": 3.0, "unit": "m"},
    )
    station.streams_now = [
        StreamRow(topic, topic.rate_hz, 30 * MS, Age.LIVE, 178, 0, 0.0, 0, "")
        for topic in (HEARTBEAT, STATUS, ODOMETRY, SONAR, CYCLE)
    ]
    return station


def drive_messages(now_ns: int) -> dict[Topic[Any], Message]:
    return {
        HEARTBEAT: Heartbeat(type=10, autopilot=0, base_mode=0, custom_mode=0, system_status=4),
        STATUS: status(now_ns),
        ODOMETRY: PlanarOdometry(
            time_ns=now_ns, x_m=4.12, y_m=2.84, heading_rad=radians(30), speed_m_s=0.31,
            yaw_rate_rad_s=0.1, cov_xx_m2=1e-3, cov_xy_m2=2e-4, cov_xh_m_rad=0.0,
            cov_yy_m2=2e-3, cov_yh_m_rad=0.0, cov_hh_rad2=1e-3,
        ),
        DECISION: AvoidanceDecision(
            time_ns=now_ns, nearest_bearing_rad=radians(79), nearest_range_m=0.23, zone_m=0.30,
            goal_bearing_rad=radians(10), rotation_rad=radians(64), virtual_x_m=5.1,
            virtual_y_m=2.2, speed_m_s=0.25, yaw_rate_rad_s=-0.4, branch=Branch.PASS_RIGHT,
            guard=0,
        ),
        CYCLE: CycleReport(
            time_ns=now_ns, tick=178, missed=0, overruns=0, rejected=0, late_us=40,
            sense_age_us=9000, budget_us=2500, stage_us=(80, 12, 140, 9, 171),
        ),
        SONAR: SonarScan(
            time_ns=now_ns, seq=178, range_mm=(3000, 1800, 2030, 2120, 1370, 460, 230, 80),
            ping_age_us=(0,) * 8, valid=0b1111_1101, echo=0b1111_1110,
        ),
    }  # fmt: skip


def status(
    now_ns: int, goal: int = GoalState.AVOIDING, vehicle: int = Vehicle.ACTIVE
) -> NavigatorStatus:
    return NavigatorStatus(
        time_ns=now_ns,
        goal_started_ns=now_ns - 8_900 * MS,
        goal_ended_ns=0,
        goal_id=7,
        goal_x_m=9.0,
        goal_y_m=7.0,
        goal_heading_rad=0.0,
        goal_distance_m=6.42,
        vehicle=vehicle,
        mode=Mode.GUIDED,
        goal=goal,
        vehicle_reason=0,
        goal_reason=0,
        navigator=Navigator.VGM,
        side=1,
    )


def scene() -> Scene:
    box = ((5.0, 3.5), (6.2, 3.5), (6.2, 5.2), (5.0, 5.2))
    trail = tuple((0.8 + 0.11 * k, 1.0 + 0.06 * k + 0.0004 * k * k) for k in range(31))
    return Scene(
        size_m=(10.0, 8.0),
        obstacles=(Outline(((0, 0), (10, 0), (10, 8), (0, 8))), Outline(box)),
        trail=trail,
        robot=Robot(4.12, 2.84, radians(30)),
        covariance=(0.01, 0.002, 0.02),
        ranges_m=(3.0, 1.8, 2.03, 2.12, 1.37, 0.46, 0.23, None),
        zone_m=0.3,
        goal=Target(9.0, 7.0, 0.0),
        virtual_goal=(5.4, 2.6),
        hits=((3.4, 2.3),),
    )
