"""A vehicle on a desk with its items, a robot process on a played bus, and a slow disk."""

from math import nan, radians
from typing import TypeVar, cast

from checks.harness.messages import make
from protocol.bus.services import ServiceRequest
from protocol.topics import COMMAND, DRIVE, SONAR, WHEELS, Service, Topic
from protocol.wire.codec import Encoder
from protocol.wire.enums import FRAME_LOCAL_FLU, AckResult, Command, MissionState, MissionType, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionVerdict,
    SonarScan,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, Outputs, Scan, Wheels
from robot.emergency_stop import emergency_stop
from robot.file_writer import Done, Job, do
from robot.process import CycleMeter, RobotProcess
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime.clock import ManualClock, Tick
from runtime.units import NS_PER_MS as MS
from runtime.units import PERIOD_NS
from tests.support.played_bus import PlayedBus

CLEAR = Scan((0,) * 8, (0,) * 8, 255, 0)
TICKS_PER_MRAD_S = 1e-3 * DEFAULTS.wheel_radius_m * DEFAULTS.period_s / DEFAULTS.m_per_tick


def quiet(stage: int) -> None:
    """Do not measure the time."""


class Desk:
    """Steps the vehicle every 50 ms with fresh sensor data and, if wanted, a live operator."""

    def __init__(self, store: Store | None = None) -> None:
        self.vehicle = RobotVehicle(DEFAULTS, store or Store(None))
        self.now_ns = 0
        self.request_id = 0
        self.operator = False
        self.left = self.right = 0.0

    def step(self, scan: Scan | None = CLEAR) -> Outputs:
        """Advance one tick with wheels that follow their command."""
        wheels = Wheels(round(self.left), round(self.right), 0, self.now_ns // MS)
        if self.operator:
            self.vehicle.lease.beat("", self.now_ns)
        age_ms = self.vehicle.operator_age_ms(self.now_ns)
        outputs = self.vehicle.step(Inputs(self.now_ns // MS, wheels, scan, age_ms), quiet)
        self.left += outputs.left_mrad_s * TICKS_PER_MRAD_S
        self.right += outputs.right_mrad_s * TICKS_PER_MRAD_S
        self.now_ns += 50 * MS
        return outputs

    def command(
        self, command: int, param1: float = 0.0, param2: float = 0.0, param3: float = 0.0
    ) -> int:
        self.request_id += 1
        request = CommandRequest(
            request_id=self.request_id,
            command=command,
            param1=param1,
            param2=param2,
            param3=param3,
        )
        answer = self.vehicle.receive(request, self.now_ns)
        assert isinstance(answer, CommandAck)
        return answer.result_param2

    def arm(self) -> int:
        self.step()
        return self.command(Command.COMPONENT_ARM_DISARM, 1)

    def goto(self, x_m: float, y_m: float, mode: int = Mode.AUTO) -> int:
        self.request_id += 1
        answer = self.vehicle.receive(goal(self.request_id, x_m, y_m, mode), self.now_ns)
        assert isinstance(answer, CommandAck)
        return answer.result_param2


def goal(request_id: int, x_m: float, y_m: float, mode: int = Mode.AUTO) -> GoalRequest:
    return GoalRequest(
        request_id=request_id,
        x_mm=round(x_m * 1000),
        y_mm=round(y_m * 1000),
        heading_urad=round(radians(90) * 1e6),
        position_tolerance_mm=50,
        heading_tolerance_urad=52_360,
        heading_free=0,
        mode=mode,
    )


def item(
    seq: int, x_m: float = 1.0, y_m: float = 0.0, hold_s: float = 0.0, **changes: float
) -> MissionItemInt:
    """Return a waypoint with tolerances of 5 cm and 5 degrees, any heading, and `changes`."""
    fields = {
        "seq": seq,
        "frame": FRAME_LOCAL_FLU,
        "command": Command.SIDESTEP_NAV_POSE,
        "param1": hold_s,
        "param2": 0.05,
        "param3": 5.0,
        "param4": nan,
        "x": round(x_m * 10_000),
        "y": round(y_m * 10_000),
        "z": 0.0,
    }
    return MissionItemInt(**{**fields, **changes})  # type: ignore[arg-type]


def corners(*places_m: tuple[float, float]) -> list[MissionItemInt]:
    return [
        item(
            seq,
            x_m,
            y_m,
            command=Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            param1=len(places_m),
            mission_type=MissionType.FENCE,
        )
        for seq, (x_m, y_m) in enumerate(places_m)
    ]


def circle(x_m: float, y_m: float, radius_m: float) -> list[MissionItemInt]:
    command = Command.NAV_FENCE_CIRCLE_INCLUSION
    return [item(0, x_m, y_m, radius_m, command=command, mission_type=MissionType.FENCE)]


def line(count: int, hold_s: float = 0.0) -> list[MissionItemInt]:
    """Stops straight ahead, 0.3 m apart."""
    return [item(seq, 0.3 * (seq + 1), 0.0, hold_s) for seq in range(count)]


def count_of(items: list[MissionItemInt]) -> MissionCount:
    return MissionCount(count=len(items), mission_type=items[0].mission_type)


def upload(desk: Desk, items: list[MissionItemInt], operator: str = "") -> MissionVerdict:
    """Run the whole transfer; return its last message."""
    answer: Message = desk.vehicle.receive(count_of(items), desk.now_ns, operator)
    for one in items:
        if isinstance(answer, MissionVerdict):
            return answer
        assert answer == MissionRequestInt(seq=one.seq, mission_type=one.mission_type)
        answer = desk.vehicle.receive(one, desk.now_ns, operator)
    assert isinstance(answer, MissionVerdict)
    return answer


def start(desk: Desk, first: int = 0) -> int:
    return desk.command(Command.MISSION_START, first)


def armed(store: Store | None = None) -> Desk:
    desk = Desk(store)
    desk.arm()
    return desk


def ready(count: int = 3, hold_s: float = 0.0) -> Desk:
    """Armed, with a mission straight ahead."""
    desk = armed()
    assert upload(desk, line(count, hold_s)).reason == Reason.NONE
    return desk


def state(desk: Desk) -> tuple[MissionState, int]:
    return desk.vehicle.mission.state, desk.vehicle.mission.current


def until(desk: Desk, wanted: MissionState, within_s: float = 20.0) -> float:
    """Step until the mission is in a state; how long that took."""
    for ticks in range(round(within_s * 20)):
        if desk.vehicle.mission.state == wanted:
            return ticks * 0.05
        desk.step()
    raise AssertionError(f"{state(desk)}: not {wanted.name} within {within_s} s")


def x_m(desk: Desk) -> float:
    return desk.vehicle.state.odometry.pose.x_m


def pause(desk: Desk, seconds: float = 0.0) -> None:
    assert desk.command(Command.DO_PAUSE_CONTINUE, 0) == Reason.NONE
    for _ in range(1 + round(20 * seconds)):
        desk.step()


def resume(desk: Desk) -> int:
    return desk.command(Command.DO_PAUSE_CONTINUE, 1)


def estop(desk: Desk) -> None:
    desk.command(Command.DO_FLIGHTTERMINATION)


class HeldWriter:
    """Writes nothing until `finish` is called."""

    def __init__(self) -> None:
        self.waiting: list[Job] = []
        self._done: list[Done] = []

    def submit(self, job: Job) -> None:
        self.waiting.append(job)

    def done(self) -> list[Done]:
        done, self._done = self._done, []
        return done

    def close(self, patience_s: float) -> None:
        """Mark the end of the loop."""
        if patience_s > 0.0:
            self.finish()

    def finish(self, error: OSError | None = None) -> None:
        """Let the jobs there are come to their end: written, or failed with this error."""
        for job in self.waiting:
            self._done.append(do(job) if error is None else Done(job, error))
        self.waiting = []


class Question(ServiceRequest):
    """A request as the bus would hand it on; what is answered is kept."""

    def __init__(self, message: Message | None, operator: str = "ada/1") -> None:
        self.message = message
        self.operator = operator
        self.answers: list[Message | bytes] = []

    def reply(self, answer: Message | bytes) -> bool:
        self.answers.append(answer)
        return True


M = TypeVar("M", bound=Message)
ADA, BOB = "ada/1", "bob/2"
GOOD_NS = 1_000 * MS


class Request(Question):
    """A request as the bus hands it over, which keeps what became of it."""

    def __init__(
        self,
        message: Message | None,
        operator: str = ADA,
        good_until_ns: int | None = None,
    ) -> None:
        super().__init__(message, operator)
        self.good_until_ns = good_until_ns
        self.dropped = False

    @property
    def payload(self) -> bytes:
        return b"" if self.message is None else Encoder(1, 1).encode(self.message)

    def drop(self) -> None:
        self.dropped = True

    @property
    def reasons(self) -> list[int]:
        """The reasons of the answers; 0 for an acceptance, which may have a note."""
        acks = (one for one in self.answers if isinstance(one, CommandAck))
        return [0 if one.result == AckResult.ACCEPTED else one.result_param2 for one in acks]


class Rig:
    """A process that runs one control period at a time, on a robot at rest in open space."""

    def __init__(self, store: Store | None = None, *, enforced: bool = False) -> None:
        self.clock = ManualClock(10**12)
        self.bus = PlayedBus(self.clock)
        self.vehicle = RobotVehicle(DEFAULTS, store or Store(None))
        self.senses = Senses(self.bus, lockstep=False, accept=self.vehicle.lease.allows)
        self.meter = CycleMeter(self.clock, period_ns=PERIOD_NS, enforced=enforced)
        self.process = RobotProcess(self.vehicle, self.bus, self.clock, self.senses, self.meter)
        self.nudges = 0
        self.ticks = 0

    def serve(self) -> "Rig":
        self.process.serve(self._nudge)
        return self

    def ready(self) -> "Rig":
        """Serving, and armed after a period with senses."""
        self.serve().cycle()
        self.vehicle.state.machine.vehicle = 2
        return self

    def next_tick(self) -> Tick:
        """Let a period pass, and the senses of the next one arrive."""
        self.clock.advance(PERIOD_NS)
        self.ticks += 1
        now_ns, seq = self.clock.now_ns(), self.ticks
        self.bus.say(
            WHEELS, WheelTicks(time_ns=now_ns, seq=seq, left=0, right=0, bumper=0, expired=0)
        )
        nothing = (0,) * 8
        self.bus.say(
            SONAR,
            make(SonarScan, time_ns=now_ns, seq=seq, range_mm=nothing, ping_age_us=nothing),
        )
        return Tick(seq, now_ns, 0, 0)

    def cycle(self) -> None:
        self.process.cycle(self.next_tick())

    def ask(
        self,
        message: Message | None,
        operator: str = ADA,
        *,
        good_for_ns: int | None = GOOD_NS,
        service: Service = COMMAND,
    ) -> Request:
        """Let a request arrive that counts for so long."""
        now_ns = self.clock.now_ns()
        good_until_ns = None if good_for_ns is None else now_ns + good_for_ns
        request = Request(message, operator, good_until_ns)
        self.bus.services[service.path](request)
        return request

    def sent(self, topic: Topic[M]) -> list[M]:
        return cast(list[M], self.bus.publishers["r1", topic.path].said)

    @property
    def command(self) -> WheelCommand:
        """The newest wheel command."""
        return self.sent(DRIVE)[-1]

    def _nudge(self) -> None:
        self.nudges += 1


BRAKE = (0, 0, 0)


def hold(request_id: int) -> CommandRequest:
    return make(CommandRequest, request_id=request_id, command=Command.DO_PAUSE_CONTINUE)


def speeds(command: WheelCommand) -> tuple[int, int, int]:
    return command.left_mrad_s, command.right_mrad_s, command.ttl_ms


def press(rig: Rig, request_id: int = 7, operator: str = ADA) -> None:
    """Let a stop arrive on its own topic."""
    rig.bus.press(operator, Encoder(1, 1).encode(emergency_stop(request_id)))


def ask_to_stop(rig: Rig, request_id: int = 7, operator: str = ADA) -> Request:
    """Let a stop arrive on its own service, which presses as well."""
    request = Request(emergency_stop(request_id), operator)
    press(rig, request_id, operator)
    rig.bus.take_stop(request)
    return request


def driving() -> Rig:
    rig = Rig().ready()
    rig.ask(goal(1, 3.0, 0.0))
    for _ in range(5):
        rig.cycle()
    assert speeds(rig.command)[0] > 0
    return rig


def clear(request_id: int, stop_id: int = 0) -> CommandRequest:
    """Return the release of the stop that was seen."""
    return make(
        CommandRequest,
        request_id=request_id,
        command=Command.SIDESTEP_CLEAR_EMERGENCY_STOP,
        stop_id=stop_id,
    )


def arm(request_id: int) -> CommandRequest:
    return CommandRequest(
        request_id=request_id, command=Command.COMPONENT_ARM_DISARM, param1=1.0, param2=0.0
    )


def lease(action: int) -> LeaseRequest:
    return LeaseRequest(request_id=1, action=action, name="")
