"""A robot process on a played bus, and a disk whose pace a test sets."""

from typing import TypeVar, cast

from checks.harness.messages import make
from protocol.bus.services import ServiceRequest
from protocol.topics import COMMAND, DRIVE, SONAR, WHEELS, Service, Topic
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    LeaseRequest,
    SonarScan,
    WheelCommand,
    WheelTicks,
)
from robot.core.parameters import DEFAULTS
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
from tests.support.robot.vehicles import goal


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
        return [one.result_param2 for one in self.answers if isinstance(one, CommandAck)]


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
