"""A robot port for tests, its telemetry, the messages of clients, and a whole gateway."""

import asyncio
from collections import deque
from collections.abc import Callable
from itertools import count
from math import radians
from typing import Any

from checks.harness.messages import make
from checks.harness.played_gateway import LOOP, PlayedEndpoint, PlayedGateway, PlayedWork
from gateways.mavlink.endpoints import Endpoint
from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import Face, MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.robot_port import Answered, Refusal, Snapshot, StopPress, permitted
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import SigningGuard
from gateways.mavlink.traffic_recorder import TrafficRecorder
from ground.client.outcomes import Accepted, Operation, Outcome, Refused
from ground.commands.fence import ShowFence
from ground.commands.mission import FetchMission
from ground.commands.param import ShowParameters
from ground.missions.mission import Home
from protocol.wire.enums import LeaseAction, MissionState, Mode, Vehicle
from protocol.wire.messages import (
    CycleReport,
    GatewayStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock

HEADING_RAD = radians(135.0)

READ = {"sonar_max_m": 3.0, "m_per_tick": 0.0002}
"""Parameters without which no ranges and distances are sent, as the gateway has read them."""


def odometry(**changes: float) -> PlanarOdometry:
    place = {"time_ns": 5, "x_m": 3.0, "y_m": 4.0, "heading_rad": HEADING_RAD}
    motion = {"speed_m_s": 0.2, "yaw_rate_rad_s": 0.5, "cov_xx_m2": 0.04, "cov_yy_m2": 0.01}
    turn = {"cov_xh_m_rad": 0.001, "cov_yh_m_rad": 0.002, "cov_hh_rad2": 0.003}
    return make(PlanarOdometry, **(place | motion | turn | changes))


def status(**changes: Any) -> NavigatorStatus:
    rest = {"time_ns": 5, "vehicle": Vehicle.STANDBY, "mode": Mode.HOLD}
    return make(NavigatorStatus, **(rest | changes))


def scan(valid: int = 0xFF, **echoes_mm: int) -> SonarScan:
    """Return a scan; `s3=500` is an echo of sonar 3."""
    range_mm, echo = [0] * 8, 0
    for name, here_mm in echoes_mm.items():
        range_mm[int(name[1:])] = here_mm
        echo |= 1 << int(name[1:])
    return make(SonarScan, time_ns=5, seq=1, range_mm=tuple(range_mm), valid=valid, echo=echo)


def wheels(left: int = 0, right: int = 0) -> WheelTicks:
    return make(WheelTicks, time_ns=5, seq=1, left=left, right=right)


def cycle(**changes: Any) -> CycleReport:
    rest = {"time_ns": 5, "tick": 1, "budget_us": 20_000, "stage_us": (100, 200, 300, 400, 0)}
    return make(CycleReport, **(rest | changes))


def everything() -> dict[str, Any]:
    """Return what `FakePort.telemetry` takes: all streams are fresh."""
    return {
        "status": status(),
        "odometry": odometry(),
        "scan": scan(s3=500, s7=1200),
        "wheels": wheels(5000, 10_000),
        "cycle": cycle(),
    }


IDENTITY = "gateway/5"
ORIGIN = Home(latitude_deg=47.3769, longitude_deg=8.5417)
CLIENT = Sender(client=1, system=255, component=190)
OTHER = Sender(client=2, system=254, component=190)


class FakePort:
    """Stores operations until `answer` ends the oldest; grants the lease unless `holder` is set."""

    name = "r1"
    identity = IDENTITY
    accepted = Answered(Accepted(1))

    def __init__(self) -> None:
        self.telemetry: dict[str, Any] = {}
        self.waiting: deque[tuple[Operation[Any], Callable[[Answered], None]]] = deque()
        self.performed: list[Any] = []
        self.names: list[str] = []
        """Of the clients that have asked for them."""
        self.refusals: list[Refusal] = []
        """What the port would ask at their turns."""
        self.leases: list[tuple[LeaseAction, str]] = []
        self.holder = ""
        self.stops: list[Callable[[Answered], None]] = []
        self.heartbeats = 0
        self.texts: list[Statustext] = []
        self.driven: list[tuple[float, float]] = []
        self.settle: Callable[[], object] = lambda: None
        """Runs what waits for an answer."""

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return the telemetry that the test has set."""
        return Snapshot(now_ns, **self.telemetry)

    def need_wheels(self, now_ns: int) -> None:
        """Do nothing: the test sets the telemetry."""

    def new_texts(self) -> list[Statustext]:
        """Return the texts that the test has set, once."""
        taken, self.texts = self.texts, []
        return taken

    async def perform(
        self, operation: Operation[Any], name: str = "", refusal: Refusal = permitted
    ) -> Answered:
        """Keep the operation for `answer`."""
        end: asyncio.Future[Answered] = asyncio.get_running_loop().create_future()
        self.performed.append(operation)
        self.names.append(name)
        self.refusals.append(refusal)
        self.waiting.append((operation, end.set_result))
        return await end

    def answer(self, outcome: Outcome | None = None, error: str = "") -> None:
        """End the oldest operation, by default with the robot's acceptance."""
        _, done = self.waiting.popleft()
        done(Answered(None, error) if error else Answered(outcome or Accepted(1)))
        self.settle()

    def refuse(self, reason: Reason) -> None:
        """End the oldest operation with a refusal."""
        self.answer(Refused(reason, 1))

    async def change_lease(self, action: LeaseAction, name: str) -> Answered:
        """Grant the lease unless another operator holds it."""
        self.leases.append((action, name))
        is_refused = bool(self.holder) and action is LeaseAction.TAKE
        return Answered(Refused(Reason.LEASE_HELD, 1, self.holder) if is_refused else Accepted(1))

    def stop(self) -> StopPress:
        """Keep the stop; its id is 101, that of the next one 102."""
        end: asyncio.Future[Answered] = asyncio.get_running_loop().create_future()
        self.stops.append(end.set_result)
        return StopPress(100 + len(self.stops), end)

    def heartbeat(self) -> None:
        """Count the heartbeat."""
        self.heartbeats += 1

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Keep the speeds."""
        self.driven.append((speed_m_s, yaw_rate_rad_s))


class Bench:
    """A face with some services, on a fake port; the test moves the time."""

    def __init__(self, *services: Callable[[MavVehicle], MavService], system: int = 1) -> None:
        self.port = FakePort()
        self.now_ns = 0
        self.vehicle = MavVehicle(system, self.port, ORIGIN, self.now_ns)
        self.vehicle.parameters |= READ
        self._work = PlayedWork(self.vehicle)
        self.settle = self.port.settle = self._work.settle
        self.face = Face(self.vehicle, [service(self.vehicle) for service in services])

    def send(self, message: MavMessage, sender: Sender = CLIENT) -> list[MavMessage]:
        """Give a message to the face; return what it sends at once."""
        self.receive(message, sender)
        return self.sent()

    def receive(self, message: MavMessage, sender: Sender = CLIENT) -> None:
        """Give a message to the face."""
        self._work.within(self.face.receive, message, sender, self.now_ns)
        self.settle()

    def perform(
        self, sender: Sender, operation: Operation[Any], answers: list[Answered] | None = None
    ) -> None:
        """Let a client perform an operation; add its end to `answers`."""

        async def performed() -> None:
            answered = await self.vehicle.control.perform(sender, operation)
            if answers is not None:
                answers.append(answered)

        self._work.within(self.vehicle.start, performed())
        self.settle()

    def take_control(self, sender: Sender) -> None:
        """Give control to a client."""
        LOOP.run(self.vehicle.control.ensure(sender))

    def due(self) -> None:
        """Let the face do what is due."""
        self._work.within(self.face.due, self.now_ns)
        self.settle()

    def sent(self, client: int | None = None) -> list[MavMessage]:
        """Return the messages that wait in the outbox, for everyone or this client."""
        self.settle()
        taken = self.vehicle.outbox.take()
        return [one.message for one in taken if client is None or one.client in (None, client)]

    def after(self, seconds: float) -> list[MavMessage]:
        """Let time pass in rounds of 20 ms; return what is sent meanwhile."""
        found: list[MavMessage] = []
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.now_ns += 20_000_000
            self.due()
            found += self.sent()
        return found


SYSTEM, COMPONENT = 1, 1
SEQUENCE = count(1)


def numbered(message: MavMessage, sequence: int | None = None) -> MavMessage:
    """Return a message with the next frame number of its client, or a given one."""
    message._header.seq = (next(SEQUENCE) if sequence is None else sequence) & 0xFF
    return message


def command(number: int, *params: float, confirmation: int = 0) -> MavMessage:
    """Return a COMMAND_LONG; parameters that are not given are 0."""
    values = (*params, *(0.0,) * (7 - len(params)))
    return numbered(
        mavlink.MAVLink_command_long_message(SYSTEM, COMPONENT, number, confirmation, *values)
    )


def command_int(
    number: int,
    *params: float,
    x: int = 0,
    y: int = 0,
    z: float = 0.0,
    frame: int = mavlink.MAV_FRAME_GLOBAL,
) -> MavMessage:
    """Return a COMMAND_INT."""
    values = (*params, *(0.0,) * (4 - len(params)))
    return numbered(
        mavlink.MAVLink_command_int_message(
            SYSTEM, COMPONENT, frame, number, 0, 0, *values, x, y, z
        )
    )


def mission_status(state: MissionState, current: int = 0, items: int = 3) -> MissionStatus:
    """Return the status of a mission."""
    return make(MissionStatus, mission_id=1, count=items, current=current, state=state)


def acks(messages: list[MavMessage]) -> list[tuple[int, int]]:
    """Return command and result of each COMMAND_ACK."""
    return [(m.command, m.result) for m in messages if m.get_type() == "COMMAND_ACK"]


def words(messages: list[MavMessage]) -> str:
    """Return the texts of all STATUSTEXTs, pieces joined."""
    texts = (m for m in messages if m.get_type() == "STATUSTEXT")
    return "".join(m.text.decode() if isinstance(m.text, bytes) else m.text for m in texts)


SPEEDS = 0xDC7
"""A type_mask that ignores all but the velocity."""
PLACE = 0xDF8
"""A type_mask that ignores all but the position."""


def local_target(
    frame: int = 1,
    mask: int = SPEEDS,
    x: float = 0.0,
    y: float = 0.0,
    vx: float = 0.0,
    vy: float = 0.0,
    yaw: float = 0.0,
    yaw_rate: float = 0.0,
) -> MavMessage:
    """Return a SET_POSITION_TARGET_LOCAL_NED."""
    return numbered(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, SYSTEM, COMPONENT, frame, mask, x, y, 0, vx, vy, 0, 0, 0, 0, yaw, yaw_rate
        )
    )


def global_target(lat: int, lon: int, frame: int = 6, mask: int = PLACE) -> MavMessage:
    """Return a SET_POSITION_TARGET_GLOBAL_INT."""
    return numbered(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, SYSTEM, COMPONENT, frame, mask, lat, lon, 0, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )


def attitude(
    thrust: float = 0.0, rate: float = 0.0, mask: int = 0, q: tuple[float, ...] = (1, 0, 0, 0)
) -> MavMessage:
    """Return a SET_ATTITUDE_TARGET."""
    return numbered(
        mavlink.MAVLink_set_attitude_target_message(
            0, SYSTEM, COMPONENT, mask, list(q), 0, 0, rate, thrust
        )
    )


def manual_control(z: int = 0, y: int = 0, x: int = 0, r: int = 0, target: int = 1) -> MavMessage:
    """Return a MANUAL_CONTROL."""
    return numbered(mavlink.MAVLink_manual_control_message(target, x, y, z, r, 0))


def rc_override(*channels: int, upper: int = 0) -> MavMessage:
    """Return an RC_CHANNELS_OVERRIDE; channels that are not given are left."""
    lower = (*channels, *(0xFFFF,) * (8 - len(channels)))
    return numbered(
        mavlink.MAVLink_rc_channels_override_message(SYSTEM, COMPONENT, *lower, *(upper,) * 10)
    )


LIMITS = {"v_max_m_s": 0.8, "yaw_max_rad_s": 2.0}


def driving_bench(mode: Mode = Mode.HOLD, vehicle: Vehicle = Vehicle.ACTIVE) -> Bench:
    """Return a bench whose robot publishes everything, at (3, 4), looking east."""
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.vehicle.parameters |= LIMITS
    show(bench, mode, vehicle=vehicle)
    return bench


def show(
    bench: Bench,
    mode: Mode = Mode.HOLD,
    mission: MissionState = MissionState.NONE,
    vehicle: Vehicle = Vehicle.ACTIVE,
) -> None:
    """Let the robot publish a state, and a round pass."""
    bench.port.telemetry |= everything() | {
        "status": status(vehicle=vehicle, mode=mode),
        "mission": mission_status(mission),
        "odometry": odometry(heading_rad=0.0),
    }
    bench.after(0.02)


def performed(bench: Bench) -> list[Any]:
    """Return the operations since the last call."""
    done = list(bench.port.performed)
    bench.port.performed.clear()
    return done


def accept_all(bench: Bench) -> None:
    """Let the robot accept all that it is asked."""
    while bench.port.waiting:
        bench.port.answer()


class SilentPort(FakePort):
    """A robot that ends requests only when the test says so."""

    @property
    def is_busy(self) -> bool:
        """Whether a request has not ended: never, as the test ends them."""
        return False

    def report(self, status: GatewayStatus) -> None:
        """Publish nothing."""


class CommandedPort(SilentPort):
    """A robot that never answers what is only read, so that the rest stands alone."""

    async def perform(
        self, operation: Operation[Any], name: str = "", refusal: Refusal = permitted
    ) -> Answered:
        """Keep the operation unless it only reads."""
        if isinstance(operation, (ShowParameters, FetchMission, ShowFence)):
            await asyncio.get_running_loop().create_future()
        return await super().perform(operation, name, refusal)


class WholeGateway(PlayedGateway):
    """One robot behind one endpoint, which the test plays unless a `real` one is given."""

    def __init__(
        self,
        port: SilentPort | None = None,
        recorder: TrafficRecorder | None = None,
        guard: SigningGuard | None = None,
        real: Endpoint | None = None,
    ) -> None:
        self.endpoint, self.port = PlayedEndpoint(), port or SilentPort()
        self.face = face_of(MavVehicle(1, self.port, ORIGIN, 0), None, guard)
        self._encoder = mavlink.MAVLink(None, 255, 190)
        endpoint = self.endpoint if real is None else real
        super().__init__(endpoint, [self.face], [self.port], ManualClock(1), recorder, guard)
        self.port.settle = self.advance

    def send(
        self, message: MavMessage, peer: str = "a", system: int = 255, *, is_mavlink1: bool = False
    ) -> None:
        self._encoder.srcSystem = system
        self.endpoint.deliver(peer, message.pack(self._encoder, force_mavlink1=is_mavlink1))
        self._encoder.seq = (self._encoder.seq + 1) & 0xFF

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 50)):
            self.advance(20_000_000)

    def sent_to(self, peer: str, kind: str) -> list[MavMessage]:
        """Return the messages of a kind that a peer has got."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        data = b"".join(frame for other, frame in self.endpoint.sent if other == peer)
        return [one for one in parser.parse_buffer(data) or () if one.get_type() == kind]
