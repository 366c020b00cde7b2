"""Benches whose robots keep missions and parameters, and clients that transfer them."""

import json
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from math import nan
from pathlib import Path
from random import Random
from struct import pack, unpack
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp

from checks.harness.messages import make
from gateways.mavlink.commands.command_protocol import CommandService
from gateways.mavlink.ftp_messages import HEADER, Opcode
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.services import missions_of, parameters_and_files
from gateways.mavlink.streams import StreamScheduler
from ground.client.missions import TransferOutcome
from ground.client.outcomes import Accepted, Outcome, Refused
from ground.client.parameter import parameters_in
from ground.commands.fence import ClearFence, FenceShown, SetFence, ShowFence
from ground.commands.mission import (
    AnnounceItems,
    ClearMission,
    FetchMission,
    JumpTo,
    MissionFetched,
    UploadMission,
)
from ground.commands.param import ParameterTable, ShowParameters
from ground.missions import qgroundcontrol
from ground.missions.mission import Fence, Mission, Step, Waypoint
from ground.missions.transfer import Verdict
from protocol.wire.enums import MissionState, MissionType, Mode, Vehicle
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.parameter_table import described, with_value
from tests.support.gateway.fake_port import CLIENT, ORIGIN, Bench, status

LIMITS = {MissionType.MISSION: 200, MissionType.FENCE: 16}
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
E7 = 10_000_000
HERE = (473769000, 85417000)
"""The origin of the bench."""


class MissionBench(Bench):
    """The robot answers what is about missions; `refusal` is its verdict on uploads instead."""

    def __init__(self) -> None:
        super().__init__()
        self.waypoints: tuple[Any, ...] = ()
        self.fence: Fence | None = None
        self.mission_id = 0
        self.current = 0
        self.state = MissionState.NONE
        self.mode = Mode.HOLD
        self.is_armed = True
        self.refusal: Verdict | None = None
        self.is_answering = True
        scheduler, missions = StreamScheduler(self.vehicle), missions_of(self.vehicle)
        commands = CommandService(self.vehicle, *missions.tables)
        self.face = Face(self.vehicle, (scheduler, *missions.services, commands))
        self.publish()

    def publish(self, **changes: Any) -> list[MavMessage]:
        """Publish the robot's mission status; return what is sent in the next round."""
        for name, value in changes.items():
            setattr(self, name, value)
        vehicle = Vehicle.ACTIVE if self.is_armed else Vehicle.STANDBY
        self.port.telemetry["status"] = status(vehicle=vehicle, mode=self.mode)
        self.port.telemetry["mission"] = make(
            MissionStatus,
            mission_id=self.mission_id if self.waypoints else 0,
            count=len(self.waypoints),
            current=self.current,
            state=self.state,
        )
        return super().after(0.02)

    def send(self, message: MavMessage, sender: Sender = CLIENT) -> list[MavMessage]:
        """Give a message to the face; return what it sends at once and when the robot answers."""
        return super().send(message, sender) + self.answer_all()

    def after(self, seconds: float) -> list[MavMessage]:
        """Let time pass; the robot answers."""
        found: list[MavMessage] = []
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            found += super().after(0.02) + self.answer_all()
        return found

    def answer_all(self) -> list[MavMessage]:
        """Answer the waiting requests that are about missions."""
        while self.is_answering and self.port.waiting:
            answer = self._answer(self.port.waiting[0][0])
            if answer is None:
                break
            self.port.answer(answer)
        return self.sent()

    def _answer(self, operation: Any) -> Outcome | None:
        match operation:
            case AnnounceItems(kind=kind, count=count) if count > LIMITS[kind]:
                verdict = Verdict(Reason.MISSION_TOO_LONG, LIMITS[kind] + 1)
                return TransferOutcome(verdict=verdict, done="")
            case UploadMission() | SetFence() | ClearMission() | ClearFence() if self.refusal:
                return TransferOutcome(verdict=self.refusal, done="")
            case UploadMission(mission=mission):
                return self._keep(mission.waypoints)
            case ClearMission():
                return self._keep(())
            case SetFence(fence=fence):
                self.fence = fence
            case ClearFence():
                self.fence = None
            case FetchMission() if self.waypoints:
                return MissionFetched(Mission(waypoints=self.waypoints))
            case FetchMission():
                return TransferOutcome(verdict=Verdict(Reason.NO_MISSION, None), done="")
            case ShowFence():
                return FenceShown(self.fence)
            case JumpTo(item=item) if item <= len(self.waypoints):
                self.current = item - 1
                return Accepted(1)
            case JumpTo():
                missing = Reason.MISSION_ITEM_BAD if self.waypoints else Reason.NO_MISSION
                return Refused(missing, 1)
            case AnnounceItems():
                pass
            case _:
                return None
        return TransferOutcome(verdict=Verdict(Reason.NONE, None), done="")

    def _keep(self, waypoints: tuple[Step, ...]) -> Outcome:
        self.waypoints, self.current = waypoints, 0
        self.mission_id += 1 if waypoints else 0
        self.state = MissionState.READY if waypoints else MissionState.NONE
        self.publish()
        return TransferOutcome(verdict=Verdict(Reason.NONE, None, self.mission_id), done="")


def item_int(
    seq: int, north: int = 0, east: int = 0, command: int = 16, **fields: Any
) -> MavMessage:
    """Return a MISSION_ITEM_INT so many 1e-7 degrees from the origin; `x` and `y` are absolute."""
    values: dict[str, Any] = {"frame": 3, "current": 0, "autocontinue": 1, "z": 0.0}
    values |= dict.fromkeys(("param1", "param2", "param3", "param4"), 0.0) | fields
    values = {"mission_type": MISSION, "x": HERE[0] + north, "y": HERE[1] + east} | values
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, command=command, **values)


def as_float(message: MavMessage) -> MavMessage:
    """Return the MISSION_ITEM with the same content, its place rounded to 24 bits."""
    fields = message.to_dict() | {"x": single(message.x / E7), "y": single(message.y / E7)}
    del fields["mavpackettype"]
    return mavlink.MAVLink_mission_item_message(**fields)


def single(value: float) -> float:
    """Round to single precision, as MAVLink carries parameters."""
    rounded: float = unpack("<f", pack("<f", value))[0]
    return rounded


def planned(*waypoints: Waypoint, fence: Fence | None = None) -> dict[str, Any]:
    """Return a plan, with places in whole 1e-7 degrees as ground stations send them."""
    mission = Mission(waypoints=waypoints, fence=fence)
    plan: dict[str, Any] = json.loads(qgroundcontrol.plan_text(mission, ORIGIN))
    for item in plan["mission"]["items"]:
        item["params"][4:6] = [round(value, 7) for value in item["params"][4:6]]
    for shape in plan["geoFence"]["polygons"]:
        shape["polygon"] = [[round(value, 7) for value in one] for one in shape["polygon"]]
    return plan


def messages_of(plan: dict[str, Any]) -> list[MavMessage]:
    """Return the MISSION_ITEM_INTs that a ground station sends for a plan: home first."""
    found = [item_int(0)]
    for seq, item in enumerate(plan["mission"]["items"], start=1):
        *params, latitude_deg, longitude_deg, up_m = [
            nan if value is None else single(value) if at < 4 else value
            for at, value in enumerate(item["params"])
        ]
        named: dict[str, Any] = {f"param{at}": value for at, value in enumerate(params, start=1)}
        named |= {"x": round(latitude_deg * E7), "y": round(longitude_deg * E7), "z": single(up_m)}
        named |= {"command": item["command"], "frame": item["frame"]}
        found.append(item_int(seq, **named))
    return found


def line_of(count: int) -> list[MavMessage]:
    """Return home, and waypoints in a line to the north-east, 11 m apart at most."""
    return [item_int(0), *(item_int(seq, seq * 1000, seq * 500) for seq in range(1, count + 1))]


class Uploader:
    """Answers requests for items until it gets its acknowledgement, like MAVSDK.

    Each frame in either direction is lost with the probability `loss`.
    """

    def __init__(
        self,
        bench: MissionBench,
        items: Sequence[MavMessage],
        sender: Sender = CLIENT,
        loss: float = 0.0,
        seed: int = 1,
        form: Callable[[MavMessage], MavMessage] = lambda message: message,
    ) -> None:
        self.acks: list[MavMessage] = []
        self.requested: list[int] = []
        self.all: list[MavMessage] = []
        self._bench = bench
        self._items = [form(item) for item in items]
        self._kind = items[0].mission_type if items else MISSION
        self._sender = sender
        self._loss = loss
        self._random = Random(seed)

    def run(self, seconds: float = 0.0) -> "Uploader":
        """Announce the items, answer requests, and repeat what is lost."""
        self.announce()
        elapsed = 0.0
        while elapsed < seconds and not self.acks:
            elapsed += 0.5
            self._take(self._bench.after(0.5))
            if not self.requested:
                self.announce()
            elif self.requested[-1] == len(self._items) - 1:
                self._give(self._items[-1])
        return self

    def announce(self) -> None:
        self._give(MissionCount(1, 1, len(self._items), self._kind))

    def _give(self, message: MavMessage) -> None:
        if self._random.random() >= self._loss:
            self._take(self._bench.send(message, self._sender))

    def _take(self, messages: list[MavMessage]) -> None:
        for message in messages:
            if self._random.random() < self._loss:
                continue
            self.all.append(message)
            if message.get_type() == "MISSION_REQUEST":
                self.requested.append(message.seq)
                self._give(self._items[message.seq])
            elif message.get_type() == "MISSION_ACK":
                self.acks.append(message)

    @property
    def results(self) -> list[int]:
        """The results of all acknowledgements."""
        return [ack.type for ack in self.acks]


def upload(bench: MissionBench, items: Sequence[MavMessage], **options: Any) -> Uploader:
    """Upload items without loss."""
    return Uploader(bench, items, **options).run()


def of_type(messages: list[MavMessage], name: str) -> list[Any]:
    """Return the messages of one type."""
    return [one for one in messages if one.get_type() == name]


def robot_table(**values: float) -> ParameterTable:
    """Return what the robot's list contains if some values differ from their defaults."""
    params = DEFAULTS
    for name, value in values.items():
        params = with_value(params, name, value)
    return ParameterTable(tuple(parameters_in(json.dumps(described(params)))))


class ParameterBench(Bench):
    """A bench with parameters, files and logs; the robot answers each request for the list."""

    def __init__(self, recordings: Path | None = None) -> None:
        super().__init__()
        self.values: dict[str, float] = {}
        self.is_answering = True
        self.face = Face(self.vehicle, parameters_and_files(self.vehicle, recordings))

    def send(self, message: MavMessage, sender: Sender = CLIENT) -> list[MavMessage]:
        """Give a message to the face; return what it sends at once and when the robot answers."""
        found = super().send(message, sender)
        return found + self.answer_lists()

    def answer_lists(self) -> list[MavMessage]:
        """Answer the waiting requests for the list."""
        while self.is_answering and self.port.waiting and self._asks_for_list():
            self.port.answer(robot_table(**self.values))
        return self.sent()

    def after(self, seconds: float) -> list[MavMessage]:
        """Let time pass; the robot answers requests for the list."""
        found: list[MavMessage] = []
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            found += super().after(0.02)
            found += self.answer_lists()
        return found

    def _asks_for_list(self) -> bool:
        operation, _ = self.port.waiting[0]
        return isinstance(operation, ShowParameters)


EPOCH_S = 1_000_000.0
ROUND_S = 0.02


class SimulatedLink:
    """The connection of a client to a bench; `loss` is the share of lost frames, each way."""

    def __init__(self, bench: ParameterBench, loss: float = 0.0, seed: int = 1) -> None:
        self.bench = bench
        self.source_system, self.source_component = CLIENT.system, CLIENT.component
        self.mav = self
        self._random = Random(seed)
        self._loss = loss
        self._looks = 0
        self._inbox: deque[MavMessage] = deque()

    def time(self) -> float:
        """Return the simulated time; each look at the clock takes a microsecond."""
        self._looks += 1
        return EPOCH_S + self.bench.now_ns / 1e9 + self._looks * 1e-6

    def send(self, message: MavMessage) -> None:
        """Send a message to the vehicle."""
        if self._random.random() >= self._loss:
            self._receive(self.bench.send(message))

    def file_transfer_protocol_send(
        self, network: int, system: int, component: int, payload: bytes
    ) -> None:
        """Send a request, as pymavlink's client does."""
        self.send(
            mavlink.MAVLink_file_transfer_protocol_message(
                network, system, component, list(payload)
            )
        )

    def recv_match(self, type: Any = None, blocking: bool = False, timeout: float = 0) -> Any:
        """Return the next message of these types, or None after the time."""
        types = [type] if isinstance(type, str) else type
        end_s = self.time() + timeout
        while True:
            while self._inbox:
                found = self._inbox.popleft()
                if types is None or found.get_type() in types:
                    return found
            if self.time() >= end_s:
                return None
            self._receive(self.bench.after(ROUND_S))

    def _receive(self, messages: Iterable[MavMessage]) -> None:
        self._inbox.extend(one for one in messages if self._random.random() >= self._loss)


def client_on(
    link: SimulatedLink, monkeypatch: pytest.MonkeyPatch, block: int = 80
) -> mavftp.MAVFTP:
    """Return pymavlink's client, which lives in the bench's time."""
    monkeypatch.setattr(mavftp, "time", SimpleNamespace(time=link.time, sleep=lambda _: None))
    client = mavftp.MAVFTP(link, 1, 1)
    client.ftp_settings.burst_read_size = block
    return client


class Reply:
    """The parts of a reply."""

    def __init__(self, message: MavMessage) -> None:
        payload = bytes(message.payload)
        self.target = (message.target_system, message.target_component)
        head = HEADER.unpack_from(payload)
        self.sequence, self.session, self.opcode, size, self.request, last, self.offset = head
        self.is_last = bool(last)
        self.data = payload[HEADER.size : HEADER.size + size]


def asked(
    opcode: int,
    data: bytes = b"",
    *,
    session: int = 0,
    offset: int = 0,
    size: int | None = None,
    sequence: int = 0,
) -> MavMessage:
    """Return a request."""
    length = len(data) if size is None else size
    head = HEADER.pack(sequence & 0xFFFF, session, opcode, length, 0, 0, offset)
    payload = list((head + data).ljust(251, b"\0"))
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)


def replies(bench: ParameterBench, message: MavMessage, sender: Sender = CLIENT) -> list[Reply]:
    """Send a request; return the replies of the next half second."""
    return replies_in(bench.send(message, sender) + bench.after(0.5))


def replies_in(messages: Iterable[MavMessage]) -> list[Reply]:
    """Return the replies among messages."""
    return [Reply(one) for one in of_type(list(messages), "FILE_TRANSFER_PROTOCOL")]


def failure(found: list[Reply]) -> int:
    """Return the reason in the only reply, which is a NAK."""
    (reply,) = found
    assert reply.opcode == Opcode.NAK
    assert len(reply.data) == 1
    return reply.data[0]


def got(client: Any, path: str) -> bytes:
    """Return a file as the client reads it."""
    contents: list[bytes] = []
    client.cmd_get([path], callback=lambda file: contents.append(file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=60)
    return contents[0]
