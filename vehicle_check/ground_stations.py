"""Ground stations of the judge: frames with times, and requests with answers.

Several stations are peers of one endpoint of the vehicle.
"""

import random
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from runtime.units import NS_PER_MS, NS_PER_S
from vehicle_check.mavlink_frames import EXTRA, MavMessage, Signer, mavlink, number_of
from vehicle_check.networks import VehicleNetwork


class Losses:
    """Selects the frames to drop, by a seed."""

    def __init__(self, share: float, seed: int) -> None:
        self.share = share
        self._random = random.Random(seed)

    def drops(self) -> bool:
        """Return True for a frame to drop."""
        return self.share > 0 and self._random.random() < self.share


HEARTBEAT_NS: Final = NS_PER_S
STEP_NS: Final = 20 * NS_PER_MS
MAX_LOG: Final = 200_000
FIRST_SYSTEM: Final = 255
COMPONENT: Final = 190
TRIES_WITH_LOSS: Final = 12
GREET_S: Final = 2.5
GREET_WITH_LOSS_S: Final = 8.0
RETRY_S: Final = 0.4
"""How soon a request is repeated with loss; QGroundControl waits 0.25 to 0.5 s."""
Where: TypeAlias = Callable[[Any], bool]


class ReceivedMessage(NamedTuple):
    """A received frame; `is_lost` if the judge itself has dropped it."""

    at_ns: int
    name: str
    message: MavMessage
    system: int
    component: int
    sequence: int
    size: int
    is_signed: bool = False
    is_lost: bool = False
    raw: bytes = b""


class TimeSpentError(Exception):
    """The time of a row has been spent."""


class Elapsed(NamedTuple):
    """A time, and for how much of it the judge's own machine was busy with other things."""

    seconds: float
    held_up_s: float = 0.0


class Stopwatch:
    """Measures a time, and the load of the judge's own machine in it."""

    def __init__(self, network: VehicleNetwork) -> None:
        self._network = network
        self._began_ns, self._held_up_ns = network.now_ns(), network.held_up_ns

    @property
    def elapsed(self) -> Elapsed:
        """The time since the start of the stopwatch."""
        seconds = (self._network.now_ns() - self._began_ns) / NS_PER_S
        held_up_s = (self._network.held_up_ns - self._held_up_ns) / NS_PER_S
        return Elapsed(seconds, min(seconds, held_up_s))


class GroundStations:
    """All ground stations of the judge, which share one network and one time."""

    def __init__(self, network: VehicleNetwork, losses: Losses) -> None:
        self.network = network
        self.losses = losses
        self.clients: dict[int, GroundStation] = {}
        self.target = 0
        self.target_component = mavlink.MAV_COMP_ID_AUTOPILOT1
        self.systems: set[int] = set()
        self.acknowledged: Counter[int] = Counter()
        """How many COMMAND_ACK each system has sent to these ground stations."""
        self.heard_ns = 0
        """When a frame of the target arrived last."""
        self.forwarded_keys = 0
        self.signer: Signer | None = None
        self.deadline_ns: int | None = None
        """When `wait` raises TimeSpentError, once: what a row restores has its own time."""

    @property
    def now_ns(self) -> int:
        """The time."""
        return self.network.now_ns()

    @property
    def address(self) -> tuple[int, int]:
        """The system and component to which requests go."""
        return self.target, self.target_component

    @property
    def is_lossy(self) -> bool:
        """True if the judge drops frames itself."""
        return self.losses.share > 0

    @property
    def tries(self) -> int:
        """Number of attempts of a request before its answer counts as missing."""
        return TRIES_WITH_LOSS if self.is_lossy else 1

    def connect(self, system: int | None = None, *, beats: bool = True) -> "GroundStation":
        """Connect one more ground station, by default with a system id of its own."""
        peer = self.network.open()
        number = FIRST_SYSTEM - len(self.clients) if system is None else system
        client = GroundStation(self, peer, number, beats=beats)
        client.signer = self.signer
        self.clients[peer] = client
        return client

    def wait(self, seconds: float, until: Callable[[], bool] | None = None) -> bool:
        """Exchange frames for some time, or until a condition is met; return it."""
        end_ns = self.now_ns + round(seconds * NS_PER_S)
        while True:
            if until is not None and until():
                return True
            now_ns = self.now_ns
            if now_ns >= end_ns:
                return False
            if self.deadline_ns is not None and now_ns >= self.deadline_ns:
                self.deadline_ns = None
                raise TimeSpentError
            self.exchange(min(end_ns, now_ns + STEP_NS))

    def exchange(self, until_ns: int) -> None:
        """Send the heartbeats that are due; wait for frames, at most until a time."""
        now_ns = self.now_ns
        for client in list(self.clients.values()):
            client.beat(now_ns)
        for heard in self.network.receive(until_ns):
            for client in self._receivers(heard.peer):
                client.take(heard.data, heard.at_ns)

    def _receivers(self, peer: int) -> Sequence["GroundStation"]:
        """Return the stations that receive what has arrived; on a shared line all that are on."""
        if self.network.is_shared:
            return [client for client in self.clients.values() if client.beats]
        return [self.clients[peer]] if peer in self.clients else []

    def stopwatch(self) -> Stopwatch:
        """Return a stopwatch that starts now."""
        return Stopwatch(self.network)


class GroundStation:
    """One ground station. Only frames of the target system are in `log`."""

    def __init__(self, station: GroundStations, peer: int, system: int, *, beats: bool) -> None:
        self.station = station
        self.system = system
        self.beats = beats
        self.log: list[ReceivedMessage] = []
        self.bytes = self.malformed = 0
        self.signer: Signer | None = None
        self._peer = peer
        self._encoder = mavlink.MAVLink(None, system, COMPONENT)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._beat_ns = 0

    def send(self, message: MavMessage) -> bool:
        """Send a message; False if the judge has dropped it."""
        return self.send_bytes(self.frame(message))

    def frame(self, message: MavMessage) -> bytes:
        """Return the next frame of this ground station."""
        data: bytes = message.pack(self._encoder)
        self._encoder.seq = (self._encoder.seq + 1) & 0xFF
        return data if self.signer is None else self.signer.signed(data)

    def send_surely(self, message: MavMessage) -> None:
        """Send a message that has no answer; with loss so often that one arrives."""
        for _ in range(self.station.tries):
            self.send(message)

    def send_bytes(self, data: bytes) -> bool:
        """Send bytes as they are; False if the judge has dropped them."""
        if self.station.losses.drops():
            return False
        self.station.network.send(self._peer, data)
        return True

    def beat(self, now_ns: int) -> None:
        """Send the heartbeat of a ground station if it is due."""
        if self.beats and now_ns - self._beat_ns >= HEARTBEAT_NS:
            self._beat_ns = now_ns
            self.send(heartbeat())

    def take(self, data: bytes, at_ns: int) -> None:
        """Decode received bytes into the log; count what is malformed."""
        self.bytes += len(data)
        try:
            found = self._parser.parse_buffer(data) or ()
        except Exception:  # the parser of pymavlink raises many kinds on hostile bytes
            self._parser = mavlink.MAVLink(None)
            self._parser.robust_parsing = True
            self.malformed += 1
            return
        for message in found:
            frame = frame_of(message, at_ns, is_lost=self.station.losses.drops())
            if frame is None:
                self.malformed += 1
                continue
            if frame.name == "HEARTBEAT" and frame.message.type != mavlink.MAV_TYPE_GCS:
                self.station.systems.add(frame.system)
            self.station.forwarded_keys += frame.name == "SETUP_SIGNING"
            self.station.acknowledged[frame.system] += frame.name == "COMMAND_ACK"
            if self.station.target in (0, frame.system):
                self.station.heard_ns = at_ns
                if len(self.log) < MAX_LOG:
                    self.log.append(frame)

    def greet(self) -> ReceivedMessage | None:
        """Wait for a heartbeat: the vehicle has heard of this ground station. None if it has not.

        With loss some heartbeats of the ground station may be dropped before.
        """
        return self.expect_sent(
            "HEARTBEAT", GREET_WITH_LOSS_S if self.station.is_lossy else GREET_S
        )

    def mark(self) -> int:
        """Return the present end of the log, for `since`."""
        return len(self.log)

    def sent(self, name: str, since: int = 0, where: Where | None = None) -> list[ReceivedMessage]:
        """Return the messages of a name that the vehicle has sent since a mark.

        Those that the judge has dropped are among them: what a vehicle sends without being asked
        is judged as it was sent.
        """
        return [
            one
            for one in self.log[since:]
            if one.name == name and (where is None or where(one.message))
        ]

    def heard(self, name: str, since: int = 0, where: Where | None = None) -> list[ReceivedMessage]:
        """Return the messages of a name that have reached this ground station since a mark."""
        return [one for one in self.sent(name, since, where) if not one.is_lost]

    def latest(self, name: str, where: Where | None = None) -> ReceivedMessage | None:
        """Return the newest message of a name that the vehicle has sent."""
        frames = (one for one in reversed(self.log) if one.name == name)
        return next((frame for frame in frames if where is None or where(frame.message)), None)

    def expect(
        self, name: str, within_s: float = 1.0, where: Where | None = None, since: int | None = None
    ) -> ReceivedMessage | None:
        """Wait for a message since a mark, by default from now on; None if it does not come."""
        return self._first(self.heard, name, within_s, where, since)

    def expect_sent(
        self, name: str, within_s: float = 1.0, where: Where | None = None, since: int | None = None
    ) -> ReceivedMessage | None:
        """Wait until the vehicle sends a message, which the judge may drop."""
        return self._first(self.sent, name, within_s, where, since)

    def _first(
        self,
        found_in: Callable[[str, int, Where | None], list[ReceivedMessage]],
        name: str,
        within_s: float,
        where: Where | None,
        since: int | None,
    ) -> ReceivedMessage | None:
        position = self.mark() if since is None else since
        found: list[ReceivedMessage] = []

        def is_there() -> bool:
            nonlocal position
            found.extend(found_in(name, position, where))
            position = len(self.log)
            return bool(found)

        self.station.wait(within_s, is_there)
        return found[0] if found else None

    def ask(
        self, message: MavMessage, name: str, where: Where | None = None, within_s: float = 1.0
    ) -> ReceivedMessage | None:
        """Send a request and wait for the answer; with loss repeat it.

        A repeated COMMAND_LONG counts its `confirmation` up, so that it is carried out once.
        """
        return self.ask_for_any(message, (name,), where, within_s)

    def ask_for_any(
        self,
        message: MavMessage,
        names: Collection[str],
        where: Where | None = None,
        within_s: float = 1.0,
    ) -> ReceivedMessage | None:
        """Send a request that messages of several names may answer."""
        if self.station.is_lossy:
            within_s = min(within_s, RETRY_S)
        since = self.mark()

        def answers() -> list[ReceivedMessage]:
            return [
                one
                for one in self.log[since:]
                if one.name in names and not one.is_lost and (where is None or where(one.message))
            ]

        for _ in range(self.station.tries):
            self.send(message)
            if self.station.wait(within_s, lambda: bool(answers())):
                return answers()[0]
            if message.get_type() == "COMMAND_LONG":
                message.confirmation += 1
        return None

    def command(self, number: int, *params: float, within_s: float = 1.0) -> ReceivedMessage | None:
        """Send COMMAND_LONG and wait for its acknowledgement."""
        return self.ask(
            self.command_long(number, *params),
            "COMMAND_ACK",
            lambda ack: ack.command == number,
            within_s,
        )

    def command_long(self, number: int, *params: float, confirmation: int = 0) -> MavMessage:
        """Return COMMAND_LONG for the target; parameters that are not given are 0."""
        filled = (*params, *[0.0] * 7)[:7]
        target = self.station.address
        return mavlink.MAVLink_command_long_message(*target, number, confirmation, *filled)

    def result_of(self, number: int, *params: float, within_s: float = 1.0) -> int | None:
        """Return the result of a command; None without an acknowledgement."""
        ack = self.command(number, *params, within_s=within_s)
        return None if ack is None else int(ack.message.result)

    def request(self, number: int, name: str, *params: float) -> ReceivedMessage | None:
        """Ask for a message by command 512, as QGroundControl and MAVSDK do."""
        asked = self.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, number, *params)
        return self.ask(asked, name)


def heartbeat() -> MavMessage:
    """Return the heartbeat of a ground station."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def frame_of(message: MavMessage, at_ns: int, *, is_lost: bool = False) -> ReceivedMessage | None:
    """Return what pymavlink has decoded as a frame of the log; None if it is malformed."""
    raw = bytes(message.get_msgbuf() or b"")
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_BAD_DATA or len(raw) < 8:
        return None
    is_first = raw[0] == mavlink.PROTOCOL_MARKER_V1
    number, is_signed = number_of(raw), not is_first and bool(raw[2] & 1)
    sequence, system, component = raw[2:5] if is_first else raw[4:7]
    name = message.get_type()
    if number in EXTRA and not is_first:
        name, message = EXTRA[number].name, EXTRA[number].decode(raw)
        if message is None:
            return None
    return ReceivedMessage(
        at_ns, name, message, system, component, sequence, len(raw), is_signed, is_lost, raw
    )


RESULTS: Final = (
    "ACCEPTED", "TEMPORARILY_REJECTED", "DENIED", "UNSUPPORTED", "FAILED", "IN_PROGRESS",
    "CANCELLED", "COMMAND_LONG_ONLY", "COMMAND_INT_ONLY", "UNSUPPORTED_MAV_FRAME", "NOT_IN_CONTROL",
)  # fmt: skip


def result_name(result: int | None) -> str:
    """Return the name of MAV_RESULT; "no ACK" for None."""
    if result is None:
        return "no ACK"
    return RESULTS[result] if 0 <= result < len(RESULTS) else f"result {result}"
