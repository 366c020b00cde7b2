"""A ground station that speaks MAVLink, with what it is told; it may come back from a new port."""

from struct import unpack_from
from typing import Any, Final, NamedTuple

from checks.simulation.contradictions.journal import Deed, Journal, Shown
from checks.simulation.contradictions.programs import Arguments, Program
from checks.simulation.events import Argument
from checks.simulation.hosts.gateway_side import GatewaySide
from checks.simulation.hosts.mavlink_clients import ACTIONS, SimulatedClient
from checks.simulation.hosts.network import SimulatedNetwork
from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.scheduler import Host, Scheduler
from gateways.mavlink.mavlink_dialect import mavlink

TEXT_START: Final = mavlink.MAVLINK_MSG_ID_STATUSTEXT.to_bytes(3, "little")
ACK_START: Final = mavlink.MAVLINK_MSG_ID_COMMAND_ACK.to_bytes(3, "little")
TEXT_BYTES: Final = 50


class Ack(NamedTuple):
    """An acknowledgement that a station has received for a command under way."""

    number: int
    params: tuple[float, ...]
    result: int
    since_ns: int
    """When the command was sent."""


class Client(SimulatedClient):
    """The client of the simulation, of which commands and answers are noted."""

    def __init__(
        self, station: "MavlinkStation", network: SimulatedNetwork, gateway: GatewaySide
    ) -> None:
        super().__init__(station.scheduler, network, gateway, station.name, RequestHistory())
        self.host, self._station = station.host, station
        self._text = ""
        self._sent: list[tuple[int, tuple[float, ...], int]] = []

    def _put(self, data: bytes, peer: str, kind: str = "", *, is_loopback: bool = True) -> None:
        """Send from the port of now."""
        super()._put(data, self._station.peer, kind, is_loopback=is_loopback)

    def _command(self, kind: str, number: int, *params: float) -> bool:
        """Send a command, and note it while it is under way."""
        one = number, params, self._scheduler.now_ns
        self._sent.append(one)
        try:
            return super()._command(kind, number, *params)
        finally:
            self._sent.remove(one)

    def receive(self, data: bytes) -> None:
        """Receive a frame: say an acknowledgement or a text."""
        super().receive(data)
        body = data[10:-2]
        if data[7:10] == ACK_START:
            number, result = unpack_from("<HB", body.ljust(3, b"\0"))
            of_it = [one for one in self._sent if one[0] == number]
            if len(of_it) == 1:  # of two alike it is not known which one is meant
                (_, params, since_ns) = of_it[0]
                self._station.say(Ack(number, params, result, since_ns))
        elif data[7:10] == TEXT_START:
            self._receive_text(body.ljust(TEXT_BYTES + 4, b"\0"))

    def _receive_text(self, body: bytes) -> None:
        """Say a text when its last piece has arrived: the one that is not full."""
        text, has_more = body[1 : 1 + TEXT_BYTES], body[TEXT_BYTES] and any(body[TEXT_BYTES + 1 :])
        self._text += text.partition(b"\0")[0].decode(errors="replace")
        if not has_more:
            self._station.say(Shown("text", self._text))
            self._text = ""


class MavlinkStation(Program):
    """A station; `restart` ends it and starts it again with the same ids, at a new port."""

    def __init__(
        self,
        scheduler: Scheduler,
        name: str,
        journal: Journal,
        network: SimulatedNetwork,
        gateway: GatewaySide,
    ) -> None:
        super().__init__(scheduler, name, journal)
        self._network, self._gateway = network, gateway
        self._client: Client | None = None

    @property
    def peer(self) -> str:
        """The port from which it sends now."""
        return f"{self.name}:{self.starts}"

    def start(self) -> None:
        """Start the station."""
        if not self.host.alive:
            self.new_host()
            self._client = Client(self, self._network, self._gateway)
            self._client.start()

    def do(self, verb: str, arguments: Arguments) -> None:
        """Do what a person asks."""
        if verb == "restart":
            self.kill()
            self.start()
        elif self._client is not None and self.host.alive:
            deed = self.journal.begin(self.name, verb, arguments)
            self.host.spawn(lambda: self._act(deed, arguments))

    def _act(self, deed: Deed, arguments: tuple[Argument, ...]) -> None:
        ACTIONS[deed.verb](self._client, *arguments)
        deed.ended_ns = self.scheduler.now_ns

    def receive(self, data: bytes) -> None:
        """Receive a frame of the gateway."""
        if self._client is not None:
            self._client.receive(data)

    def say(self, value: Any) -> None:
        """Say what the station is told."""
        self.journal.say(self.name, value)

    def errors(self) -> list[Host]:
        """Return its host."""
        return [self.host]
