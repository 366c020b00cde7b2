"""MAVLink in the simulation: the real gateway without sockets, and clients that command by frames.

A client repeats a command until it is acknowledged, like a ground station, and an emergency stop
for ever. MAVLink's acknowledgements name no request: one of an earlier stop, or of a clear, looks
like that of the newest stop. So it counts only for a stop that follows none of them.
"""

from collections.abc import Callable
from math import nan
from random import Random
from struct import unpack_from
from typing import Any, Final

from checks.harness.played_gateway import PlayedEndpoint
from checks.simulation.hosts.bus import SimulatedNetwork
from checks.simulation.hosts.operators import OperatorRequest, RequestHistory, SimulatedOperator
from checks.simulation.hosts.virtual_time import (
    Argument,
    Host,
    Scheduler,
    SimulatedClock,
    SimulatedLoop,
    SimulatedTime,
    current_task,
)
from checks.simulation.invariants.commanding import ANSWER
from checks.simulation.invariants.limits import CLIENT_REPEAT_NS
from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.coordinates import place_at
from gateways.mavlink.gateway import Gateway
from gateways.mavlink.gateway_verb import GatewaySettings
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, MavMessage, mavlink
from gateways.mavlink.services import face_of
from ground.client.robot_link import RobotLink
from protocol.bus.bus import open_bus
from protocol.topics import Role
from protocol.wire.enums import Mode
from runtime.units import NS_PER_MS, NS_PER_S

GATEWAY: Final = "gateway"
SYSTEM: Final = 1
ORIGIN: Final = GatewaySettings().home


class DatagramEndpoint(PlayedEndpoint):
    """An endpoint whose peers are other hosts. They read no telemetry, so it is not sent."""

    text = "udpin:simulated"

    def __init__(self, send: Callable[[str, bytes], None]) -> None:
        super().__init__()
        self._send = send

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame that is no telemetry."""
        if not is_stream:
            self._send(peer, data)


class GatewaySide(SimulatedOperator):
    """The gateway's process, which can be killed and started like that of any other operator.

    `answer` carries a frame to a client; `arrived` is called with the source, the system and the
    kind of each frame of a client that has arrived.
    """

    endpoint: DatagramEndpoint | None = None
    answer: Callable[[Host, str, bytes], None]
    arrived: Callable[[int, str], None]

    def _main(self) -> None:
        bus = self.bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        clock = SimulatedClock()
        link = RobotLink(bus, self.common, clock)
        host = self.host
        endpoint = DatagramEndpoint(lambda peer, data: self.answer(host, peer, data))
        port = BusPort(link)
        vehicle = MavVehicle(SYSTEM, port, ORIGIN, clock.now_ns())
        vehicle.unix_offset_ns = SimulatedTime.time_ns() - clock.now_ns()
        gateway = Gateway([endpoint], [face_of(vehicle)], [port], clock)
        self.endpoint = endpoint
        SimulatedLoop().run(gateway.serve())

    def kill(self) -> None:
        """Kill the process, and what it has received with it."""
        super().kill()
        self.endpoint = None

    def deliver(
        self, peer: str, data: bytes, system: int, kind: str, is_loopback: bool = True
    ) -> None:
        """Receive a datagram of a client; before the endpoint is open, it is lost."""
        if self.endpoint is not None and self.endpoint.is_attached:
            if kind:
                self.arrived(system, kind)
            self.endpoint.is_loopback = is_loopback
            self.endpoint.deliver(peer, data)


CLIENTS: Final = {"client-255": 255, "client-254": 254}
BEAT_NS: Final = NS_PER_S
STEER_NS: Final = 100 * NS_PER_MS
POLL_NS: Final = 10 * NS_PER_MS
PATIENCE_NS: Final = 500 * NS_PER_MS
ATTEMPTS: Final = 3
ALIKE_NS: Final = 12 * NS_PER_S
"""Acknowledgements of what was sent this long ago have arrived: the network keeps a frame for some
seconds, and the gateway repeats a stop for 5 s."""

UNSURE_NS: Final = NS_PER_S
"""A stop whose acknowledgement may be that of another one is repeated for so long."""

ACCEPTED: Final[int] = mavlink.MAV_RESULT_ACCEPTED
FORCED_ARM: Final = 2989.0
FORCED_DISARM: Final = 21196.0
ONLY_SPEED: Final = 0xDC7
ONLY_PLACE: Final = 0xDF8
ACK_START: Final = bytes((mavlink.MAVLINK_MSG_ID_COMMAND_ACK, 0, 0))
PING_START: Final = bytes((mavlink.MAVLINK_MSG_ID_PING, 0, 0))


class SimulatedClient:
    """A ground station that speaks MAVLink over a link to the gateway."""

    def __init__(
        self,
        scheduler: Scheduler,
        network: SimulatedNetwork,
        gateway: GatewaySide,
        name: str,
        history: RequestHistory,
    ) -> None:
        self.name, self.system = name, CLIENTS[name]
        self.host = Host(scheduler, name)
        self._scheduler, self._network = scheduler, network
        self._gateway, self._history = gateway, history
        self._encoder = mavlink.MAVLink(None, self.system, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._acks: dict[int, int] = {}
        self._silent_until_ns = self._alike_until_ns = 0
        self._is_stopping = False

    def start(self) -> None:
        """Start to send heartbeats."""
        self.host.spawn(self._beat)

    def do(self, action: str, arguments: tuple[Argument, ...]) -> None:
        """Begin an action, whatever else is under way."""
        self.host.spawn(lambda: ACTIONS[action](self, *arguments))

    def receive(self, data: bytes) -> None:
        """Receive a frame of the gateway: keep the result of a command, and answer PING."""
        if data[7:10] == ACK_START:
            number, result = unpack_from("<HB", data[10:-2].ljust(3, b"\0"))
            self._acks[number] = result
        elif data[7:10] == PING_START:
            time_us, sequence, target = unpack_from("<QIB", data[10:-2].ljust(13, b"\0"))
            if target == 0:
                self._send(ANSWER, mavlink.MAVLink_ping_message(time_us, sequence, SYSTEM, 1))

    def _beat(self) -> None:
        while True:
            self._send("heartbeat", mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            self._sleep(BEAT_NS)

    def _sleep(self, for_ns: int) -> None:
        current_task().wait_until(self._scheduler.now_ns + for_ns)

    def _send(self, kind: str, message: MavMessage) -> None:
        data: bytes = message.pack(self._encoder)
        self._encoder.seq = (self._encoder.seq + 1) & 0xFF
        self._put(data, self.name, kind)

    def _put(self, data: bytes, peer: str, kind: str = "", *, is_loopback: bool = True) -> None:
        """Send a datagram; its `kind` is empty if it may do nothing."""
        if self._scheduler.now_ns >= self._silent_until_ns:
            gateway = self._gateway
            arguments = peer, data, self.system, kind, is_loopback
            self._network.send(self.host, gateway.host, "mavlink", gateway.deliver, *arguments)

    def _command(self, kind: str, number: int, *params: float) -> bool:
        """Send a command until it is acknowledged; return whether it was accepted."""
        self._acks.pop(number, None)
        for confirmation in range(ATTEMPTS):
            self._send(kind, command(number, *params, confirmation=confirmation))
            until_ns = self._scheduler.now_ns + PATIENCE_NS
            while number not in self._acks and self._scheduler.now_ns < until_ns:
                self._sleep(POLL_NS)
            if number in self._acks:
                return self._acks[number] == ACCEPTED
        return False

    # Actions.

    def arm(self) -> None:
        """Arm."""
        self._command("arm", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)

    def disarm(self, is_forced: int) -> None:
        """Disarm, perhaps by force; needs no control."""
        force = FORCED_DISARM if is_forced else 0.0
        self._command("disarm", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, force)

    def mode(self, name: str) -> None:
        """Choose a mode."""
        self._command("mode", mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(Mode[name]))

    def pause(self, goes_on: int) -> None:
        """Pause or continue."""
        kind = "continue" if goes_on else "pause"
        self._command(kind, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, float(goes_on))

    def control(self, takes: int) -> None:
        """Request control or release it."""
        self._command("control", REQUEST_OPERATOR_CONTROL, float(takes), 1.0)

    def clear(self, arms: int) -> None:
        """Clear the emergency stop, by itself or with a forced arming."""
        self._alike_until_ns = self._scheduler.now_ns + ALIKE_NS
        if arms:
            self._command("clear", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, FORCED_ARM)
        else:
            self._command("clear", mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0.0)

    def stop(self) -> None:
        """Press the emergency stop, also in silence, and repeat it until it is acknowledged."""
        self._silent_until_ns = 0
        if self._is_stopping:
            return
        self._is_stopping, number = True, mavlink.MAV_CMD_DO_FLIGHTTERMINATION
        began_ns = self._scheduler.now_ns
        is_sure = began_ns >= self._alike_until_ns
        asked = OperatorRequest(self.name, "stop", began_ns)
        self._history.begin(asked)
        self._acks.pop(number, None)
        while not self._is_stopped(is_sure, began_ns):
            self._alike_until_ns = self._scheduler.now_ns + ALIKE_NS
            self._send("stop", command(number, 1.0))
            until_ns = self._scheduler.now_ns + CLIENT_REPEAT_NS
            while self._scheduler.now_ns < until_ns and not self._is_stopped(is_sure, began_ns):
                self._sleep(POLL_NS)
        asked.ended_ns = self._scheduler.now_ns
        asked.answered = True if is_sure else None
        self._is_stopping = False

    def _is_stopped(self, is_sure: bool, began_ns: int) -> bool:
        if not is_sure:
            return self._scheduler.now_ns - began_ns >= UNSURE_NS
        return self._acks.get(mavlink.MAV_CMD_DO_FLIGHTTERMINATION) == ACCEPTED

    def drive(self, x_m: float, y_m: float) -> None:
        """Arm and drive to a place."""
        self.arm()
        self._send("goto", reposition(x_m, y_m))

    def target(self, x_m: float, y_m: float) -> None:
        """Choose GUIDED, arm, and send a place as a setpoint."""
        self.mode("GUIDED")
        self.arm()
        self._send("goto", setpoint(ONLY_PLACE, north_m=y_m, east_m=x_m))

    def steer(self, name: str, ahead: float, for_s: float) -> None:
        """Steer by hand in MANUAL, or by velocities in GUIDED."""
        self.mode(name)
        self.arm()
        until_ns = self._scheduler.now_ns + round(for_s * NS_PER_S)
        while self._scheduler.now_ns < until_ns:
            if name == "MANUAL":
                axes = 0, 200, round(1000 * ahead), 0, 0
                self._send("steer", mavlink.MAVLink_manual_control_message(SYSTEM, *axes))
            else:
                self._send("steer", setpoint(ONLY_SPEED, ahead_m_s=0.3 * ahead))
            self._sleep(STEER_NS)

    def flood(self, count: int) -> None:
        """Send many commands at once."""
        for number in range(count):  # each is different: the gateway does a repeated one once
            goes_on = 1.0, 0.0, float(number)
            self._send("continue", command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, *goes_on))

    def silence(self, for_s: float) -> None:
        """Send nothing for some time, but a stop."""
        self._silent_until_ns = self._scheduler.now_ns + round(for_s * NS_PER_S)

    # Hostile actions, which must have no effect.

    def forge(self, how: str, salt: int) -> None:
        """Send what must do nothing: noise, torn frames, another's ids, or from a strange host."""
        random = Random(salt)
        for _ in range(random.choice((1, 5, 20))):
            message = forgery(random)
            system = SYSTEM if how == "echo" else random.choice(tuple(CLIENTS.values()))
            component = 1 if how == "echo" else mavlink.MAV_COMP_ID_MISSIONPLANNER
            data = bytearray(message.pack(mavlink.MAVLink(None, system, component)))
            if how == "torn":
                at = random.randrange(10, len(data))
                data = data[:at] if random.random() < 0.5 else data
                data[-1] ^= 1 << random.randrange(8)
            elif how == "noise":
                data = bytearray(random.choice((b"", b"\xfd", b"\xfe\xff")))
                data += random.randbytes(random.choice((1, 40, 280)))
            is_strange = how == "stranger"
            peer = "stranger" if is_strange else self.name
            self._put(bytes(data), peer, is_loopback=not is_strange)
            self._sleep(random.choice((0, 20, 200)) * NS_PER_MS)


ACTIONS: Final[dict[str, Callable[..., None]]] = {
    "arm": SimulatedClient.arm,
    "disarm": SimulatedClient.disarm,
    "mode": SimulatedClient.mode,
    "pause": SimulatedClient.pause,
    "control": SimulatedClient.control,
    "clear": SimulatedClient.clear,
    "stop": SimulatedClient.stop,
    "drive": SimulatedClient.drive,
    "target": SimulatedClient.target,
    "steer": SimulatedClient.steer,
    "flood": SimulatedClient.flood,
    "silence": SimulatedClient.silence,
    "forge": SimulatedClient.forge,
}


def command(number: int, *params: float, confirmation: int = 0) -> MavMessage:
    """Return a COMMAND_LONG; parameters that are not given are 0."""
    values = (*params, *(0.0,) * (7 - len(params)))
    return mavlink.MAVLink_command_long_message(SYSTEM, 1, number, confirmation, *values)


def reposition(x_m: float, y_m: float) -> MavMessage:
    """Return a DO_REPOSITION that changes the mode."""
    place: Any = place_at(ORIGIN, x_m, y_m)
    number, frame = mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_GLOBAL
    return mavlink.MAVLink_command_int_message(
        SYSTEM, 1, frame, number, 0, 0, -1.0, 1.0, 0.0, nan, *place, 0.0
    )


def setpoint(
    mask: int, north_m: float = 0.0, east_m: float = 0.0, ahead_m_s: float = 0.0
) -> MavMessage:
    """Return a SET_POSITION_TARGET_LOCAL_NED: a place in the world, or a speed of the body."""
    frame = mavlink.MAV_FRAME_BODY_NED if mask == ONLY_SPEED else mavlink.MAV_FRAME_LOCAL_NED
    values = north_m, east_m, 0.0, ahead_m_s, *(0.0,) * 7
    return mavlink.MAVLink_set_position_target_local_ned_message(0, SYSTEM, 1, frame, mask, *values)


def forgery(random: Random) -> MavMessage:
    """Draw a message that would have an effect if it were taken."""
    return random.choice(
        (
            command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, FORCED_ARM),
            command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
            command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0.0),
            command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(Mode.MANUAL)),
            command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1.0),
            command(REQUEST_OPERATOR_CONTROL, 1.0, 1.0),
            reposition(32.0, 30.0),
            setpoint(ONLY_SPEED, ahead_m_s=0.3),
            mavlink.MAVLink_manual_control_message(SYSTEM, 0, 0, 1000, 0, 0),
        )
    )
