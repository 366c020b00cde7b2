"""Changes of a robot's state, as typed events derived from its telemetry."""

from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, Self, TypeAlias, TypeVar

from ground.client.lease_holder import is_ours
from ground.client.streams import Stream, TopicStreams
from protocol.outcome import joined, mission_state, reason_words
from protocol.topics import LEASE, MISSION, STATUS, TEXT, Topic
from protocol.wire.enums import GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    LeaseStatus,
    MissionStatus,
    NavigatorStatus,
    Statustext,
)
from protocol.wire.reasons import reason_text
from protocol.wire.statustext import StatustextAssembler
from runtime.cli.terminal import printable
from runtime.sequence import MAX_LATE_NS, Order, SequenceTracker

E = TypeVar("E", bound=IntEnum)
M = TypeVar("M", bound=Message)
EVENT_TOPICS: Final[tuple[Topic[Any], ...]] = (STATUS, LEASE, MISSION, TEXT)


@dataclass(frozen=True, slots=True)
class VehicleChanged:
    """The vehicle state has changed; `reason` explains it, empty if there is no reason."""

    vehicle: Vehicle | int
    reason: str


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """The mode has changed."""

    mode: Mode | int


@dataclass(frozen=True, slots=True)
class GoalChanged:
    """A goal began, changed its state or ended.

    `distance_m` is the remaining distance to the goal.
    """

    goal_id: int
    state: GoalState | int
    reason: str
    distance_m: float


@dataclass(frozen=True, slots=True)
class LeaseChanged:
    """The lease has a new holder, or none (`holder` empty); `ours`: our person holds it."""

    holder: str
    name: str
    ours: bool


@dataclass(frozen=True, slots=True)
class MissionChanged:
    """The mission changed its state or its `item` (from 1; None without a mission).

    `words` tells the state with its reason, as in `taken over: driven by hand`. FAILED is every
    early end, also one that an operator wanted; its words are `failed` only if nobody did.
    """

    state: MissionState | int
    item: int | None
    count: int
    words: str


@dataclass(frozen=True, slots=True)
class TextReceived:
    """The robot sent a text message."""

    severity: Severity | int
    text: str


Event: TypeAlias = (
    VehicleChanged | ModeChanged | GoalChanged | LeaseChanged | MissionChanged | TextReceived
)


class EventDetector:
    """Compares each message with the one before; the first of a kind counts as a change."""

    def __init__(self, operator: str) -> None:
        self._operator = operator
        self._texts = StatustextAssembler()
        self._known: dict[type[object], Event] = {}
        self._stamps = SequenceTracker(MAX_LATE_NS)

    def receive(self, message: Message) -> list[Event]:
        """Return the events of a message in order; a reordered status has none."""
        if isinstance(message, NavigatorStatus):
            return self._changes(self._of_status(message))
        if isinstance(message, LeaseStatus):
            ours = is_ours(message, self._operator)
            name = printable(message.name)
            holder = printable(message.holder) if message.held else ""
            return self._changes([LeaseChanged(holder, name if message.held else "", ours)])
        if isinstance(message, MissionStatus):
            item = message.current + 1 if message.count else None
            words = mission_state(message.state, message.reason).lower()
            if message.reason:
                words = joined(words, reason_words(message.reason, message.stopped_by))
            state = known(MissionState, message.state)
            return self._changes([MissionChanged(state, item, message.count, words)])
        text = self._texts.receive(message)
        if text and isinstance(message, Statustext):
            return [TextReceived(known(Severity, message.severity), text)]
        return []

    def _of_status(self, status: NavigatorStatus) -> list[Event]:
        if self._stamps.take(status.time_ns) is Order.LATE:
            return []
        goal = GoalChanged(
            status.goal_id,
            known(GoalState, status.goal),
            reason_words(status.goal_reason, status.ended_by) if status.goal_reason else "",
            status.goal_distance_m,
        )
        why = reason_text(status.vehicle_reason) if status.vehicle_reason else ""
        vehicle = VehicleChanged(known(Vehicle, status.vehicle), why)
        return [vehicle, ModeChanged(known(Mode, status.mode)), goal]

    def _changes(self, events: list[Event]) -> list[Event]:
        changed = [event for event in events if not is_same(event, self._known.get(type(event)))]
        self._known.update({type(event): event for event in changed})
        return changed


class EventStream:
    """An asynchronous iterator over the events of one robot.

    At most `size` messages wait to be compared. When more arrive, the oldest are dropped and
    counted in `dropped`.
    """

    def __init__(self, streams: TopicStreams, operator: str, size: int) -> None:
        self._streams = streams
        self._detector = EventDetector(operator)
        self._events: deque[Event] = deque()
        self._messages: Stream[Message] = Stream(size, self._unsubscribe)
        for topic in EVENT_TOPICS:
            streams.add(topic, self._messages)

    @property
    def dropped(self) -> int:
        """The number of messages dropped from the full queue."""
        return self._messages.dropped

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Event:
        while not self._events:
            self._events.extend(self._detector.receive(await anext(self._messages)))
        return self._events.popleft()

    async def aclose(self) -> None:
        """End the stream; messages that wait can still be read."""
        self._messages.close()

    def _unsubscribe(self) -> None:
        for topic in EVENT_TOPICS:
            self._streams.remove(topic, self._messages)


def is_same(event: Event, before: Event | None) -> bool:
    """Return whether nothing but the distance to the goal has changed."""
    if isinstance(event, GoalChanged) and isinstance(before, GoalChanged):
        now, then = event, before
        return (now.goal_id, now.state, now.reason) == (then.goal_id, then.state, then.reason)
    return event == before


def known(kind: type[E], number: int) -> E | int:
    """Return the member of an enumeration; an unknown number stays a number."""
    return kind(number) if number in kind.__members__.values() else number
