"""The lease and the missions of a robot that a test plays."""

from protocol.bus.bus import Bus
from protocol.bus.services import ServiceRequest
from protocol.topic import person_of
from protocol.topics import LEASE, LEASE_SERVICE, MISSION, MISSION_SERVICE
from protocol.wire.enums import AckResult, LeaseAction, MissionState, MissionType
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    LeaseRequest,
    LeaseStatus,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
)
from protocol.wire.reasons import Reason

NO_ITEM = 65_535


class PlayedDesk:
    """Grants the lease to the first person and accepts missions that `verdict` does not refuse.

    `held` is the identity and the name of the program that took the lease; `programs` are those of
    its person that have it. `drive` is the request_id of the newest drive, and who began it.
    `lost`: how many of the coming mission frames stay unanswered.
    """

    def __init__(self, bus: Bus) -> None:
        self.held: tuple[str, str] | None = None
        self.programs: set[str] = set()
        self.drive: tuple[int, str] = (0, "")
        self.actions: list[LeaseRequest] = []
        self.frames: list[Message] = []
        self.kept: dict[int, list[MissionItemInt]] = {kind: [] for kind in MissionType}
        self.verdict = (Reason.NONE, NO_ITEM)
        self.lost = 0
        self.status = MissionState.READY
        self._expected: dict[int, int] = {}
        self._incoming: dict[int, list[MissionItemInt]] = {}
        self._lease = bus.publisher(LEASE)
        self._mission = bus.publisher(MISSION)
        bus.serve(LEASE_SERVICE, self._judge)
        bus.serve(MISSION_SERVICE, self._transfer)

    def speak(self, time_ns: int) -> None:
        holder, name = self.held or ("", "")
        self._lease.put(
            LeaseStatus(
                time_ns=time_ns,
                lapses_ms=2500 if self.held else 0,
                held=int(self.held is not None),
                holder=holder,
                name=name,
                drive_id=self.drive[0],
                driver=self.drive[1],
            )
        )
        count = len(self.kept[MissionType.MISSION])
        self._mission.put(
            MissionStatus(
                time_ns=time_ns,
                mission_id=1 if count else 0,
                hold_left_ms=0,
                count=count,
                current=0,
                state=self.status if count else MissionState.NONE,
                reason=Reason.NONE,
            )
        )

    def _judge(self, asked: ServiceRequest) -> None:
        request = asked.message
        assert isinstance(request, LeaseRequest)
        if request not in self.actions:  # it is repeated when the reply is late
            self.actions.append(request)
        person = person_of(asked.operator)
        others = self.held is not None and person_of(self.held[0]) != person
        refused = others and request.action != LeaseAction.SEIZE
        if not refused:
            self._change(request, asked.operator)
        result = AckResult.DENIED if refused else AckResult.ACCEPTED
        reason = Reason.LEASE_HELD if refused else Reason.NONE
        asked.reply(CommandAck(command=0, result=result, result_param2=reason))

    def _change(self, request: LeaseRequest, operator: str) -> None:
        if request.action in (LeaseAction.TAKE, LeaseAction.SEIZE):
            others = self.held is not None and person_of(self.held[0]) != person_of(operator)
            self.programs = {operator} if others else self.programs | {operator}
            self.held = (operator, request.name)
            return
        self.programs.discard(operator)
        if request.action == LeaseAction.RELEASE or not self.programs:
            self.held, self.programs = None, set()

    def _transfer(self, asked: ServiceRequest) -> None:
        assert asked.message is not None
        self.frames.append(asked.message)
        if self.lost:
            self.lost -= 1
            asked.drop()
            return
        asked.reply(self._answer(asked.message))

    def _answer(self, frame: Message) -> Message:
        if isinstance(frame, MissionClearAll):
            self.kept[frame.mission_type] = []
            return self._verdict(frame.mission_type)
        if isinstance(frame, MissionRequestList):
            kept = self.kept[frame.mission_type]
            return MissionCount(count=len(kept), mission_type=frame.mission_type)
        if isinstance(frame, MissionRequestInt):
            return self.kept[frame.mission_type][frame.seq]
        assert isinstance(frame, MissionCount | MissionItemInt)
        return self._taken(frame)

    def _taken(self, frame: MissionCount | MissionItemInt) -> Message:
        kind = frame.mission_type
        if isinstance(frame, MissionCount):
            self._expected[kind], self._incoming[kind] = frame.count, []
        elif frame.seq == len(self._incoming[kind]):
            self._incoming[kind].append(frame)
        if len(self._incoming[kind]) < self._expected[kind]:
            return MissionRequestInt(seq=len(self._incoming[kind]), mission_type=kind)
        if self.verdict[0] is Reason.NONE:
            self.kept[kind] = self._incoming[kind]
        return self._verdict(kind)

    def _verdict(self, kind: int) -> MissionVerdict:
        reason, item = self.verdict
        return MissionVerdict(mission_id=1, item=item, reason=reason, mission_type=kind)
