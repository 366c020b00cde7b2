"""A bench whose robot keeps a mission and a fence, and a client that transfers them."""

import json
from collections.abc import Callable, Sequence
from math import nan
from random import Random
from struct import pack, unpack
from typing import Any

from gateways.mavlink.commands.command_protocol import CommandService
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.services import missions_of
from gateways.mavlink.streams import StreamScheduler
from ground.client.operations.fences import ClearFence, FenceShown, SetFence, ShowFence
from ground.client.operations.missions import (
    AnnounceItems,
    ClearMission,
    FetchMission,
    JumpTo,
    MissionFetched,
    TransferOutcome,
    UploadMission,
)
from ground.client.results import Accepted, Outcome, Refused
from ground.missions import qgroundcontrol
from ground.missions.mission import Fence, Mission, Waypoint
from ground.missions.transfer import Verdict
from protocol.wire.enums import MissionState, MissionType, Mode, Vehicle
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason
from tests.support.gateway.fake_port import CLIENT, ORIGIN, Bench
from tests.support.gateway.telemetry import status

LIMITS = {MissionType.MISSION: 200, MissionType.FENCE: 16}
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
E7 = 10_000_000
HERE = (473769000, 85417000)
"""The origin of the bench."""


class MissionBench(Bench):
    """The robot answers what is about missions; `refusal` is its verdict on uploads instead."""

    def __init__(self) -> None:
        super().__init__()
        self.waypoints: tuple[Waypoint, ...] = ()
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
        self.port.telemetry["mission"] = MissionStatus(
            time_ns=0,
            mission_id=self.mission_id if self.waypoints else 0,
            hold_left_ms=0,
            count=len(self.waypoints),
            current=self.current,
            state=self.state,
            reason=0,
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

    def _keep(self, waypoints: tuple[Waypoint, ...]) -> Outcome:
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
        *params, latitude_deg, longitude_deg, _ = [
            nan if value is None else single(value) if at < 4 else value
            for at, value in enumerate(item["params"])
        ]
        named: dict[str, Any] = {f"param{at}": value for at, value in enumerate(params, start=1)}
        place = {"x": round(latitude_deg * E7), "y": round(longitude_deg * E7)}
        found.append(item_int(seq, frame=item["frame"], **place, **named))
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
