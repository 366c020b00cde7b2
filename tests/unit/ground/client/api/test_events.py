"""Events report changes, and ignore reordered messages."""

import asyncio
from typing import Any

from ground.client.api.events import (
    EventDetector,
    GoalChanged,
    LeaseChanged,
    MissionChanged,
    ModeChanged,
    TextReceived,
    VehicleChanged,
)
from ground.client.api.streams import Stream, TopicStreams
from protocol.topics import STATUS
from protocol.wire.enums import GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.messages import LeaseStatus, MissionStatus, Statustext
from protocol.wire.reasons import Reason, reason_text
from runtime.clock import ManualClock
from tests.support.each import each
from tests.support.ground.client import ScriptedBus, lease_of, status

S = 1_000_000_000


def test_first_status_emits_all_events_a_repeat_none() -> None:
    detector = EventDetector("open/0a")
    first = detector.receive(status(time_ns=S))
    assert first[:2] == [VehicleChanged(Vehicle.ACTIVE, ""), ModeChanged(Mode.GUIDED)]
    assert isinstance(first[2], GoalChanged)
    assert detector.receive(status(time_ns=2 * S, goal_distance_m=0.5)) == []


def test_change_events_carry_their_reason() -> None:
    detector = EventDetector("open/0a")
    detector.receive(status(time_ns=S))
    failed = status(Vehicle.FAILSAFE, time_ns=2 * S, vehicle_reason=Reason.NO_OPERATOR)
    why = reason_text(Reason.NO_OPERATOR)
    assert detector.receive(failed) == [VehicleChanged(Vehicle.FAILSAFE, why)]
    reached = status(
        Vehicle.FAILSAFE,
        time_ns=3 * S,
        vehicle_reason=Reason.NO_OPERATOR,
        goal_id=7,
        goal=GoalState.REACHED,
    )
    assert detector.receive(reached) == [GoalChanged(7, GoalState.REACHED, "", 1.5)]


def test_reordered_status_emits_nothing_a_restart_does() -> None:
    detector = EventDetector("open/0a")
    detector.receive(status(time_ns=60 * S))
    assert detector.receive(status(Vehicle.STANDBY, time_ns=60 * S - 50_000_000)) == []
    assert VehicleChanged(Vehicle.BOOT, "") in detector.receive(status(Vehicle.BOOT, time_ns=S))


def test_number_that_this_version_does_not_know_stays_a_number() -> None:
    found = EventDetector("").receive(status(time_ns=S, mode=99))
    assert ModeChanged(99) in found


def test_lease_mission_and_texts_are_events() -> None:
    detector = EventDetector("beef/2")
    assert detector.receive(lease_of("anna")) == [LeaseChanged("beef/1", "anna", True)]
    free = LeaseStatus(time_ns=2, lapses_ms=0, held=0, holder="", name="")
    assert detector.receive(free) == [LeaseChanged("", "", False)]
    running = MissionStatus(
        time_ns=1, mission_id=1, hold_left_ms=0, count=3, current=1,
        state=MissionState.RUNNING, reason=Reason.NONE,
    )  # fmt: skip
    assert detector.receive(running) == [MissionChanged(MissionState.RUNNING, 2, 3, "running")]
    text = Statustext(severity=Severity.WARNING, text="low", id=0, chunk_seq=0)
    assert detector.receive(text) == [TextReceived(Severity.WARNING, "low")]


@each(
    ("reason", "words"),
    [
        (Reason.BY_HAND, "taken over: driven by hand"),
        (Reason.DISARMED, "aborted: disarmed by the operator"),
        (Reason.BUMPER, "failed: bumper contact"),
    ],
)
def test_end_of_a_mission_is_told_in_the_words_of_the_command_line(
    reason: Reason, words: str
) -> None:
    ended = MissionStatus(
        time_ns=1, mission_id=1, hold_left_ms=0, count=3, current=1,
        state=MissionState.FAILED, reason=reason,
    )  # fmt: skip
    (event,) = EventDetector("").receive(ended)
    assert event == MissionChanged(MissionState.FAILED, 2, 3, words)


def test_stream_keeps_the_newest_and_counts_the_rest() -> None:
    async def story() -> None:
        stream: Stream[int] = Stream(3)
        for item in range(10):
            stream.offer(item)
        await stream.aclose()
        assert [item async for item in stream] == [7, 8, 9]
        assert stream.dropped == 7

    asyncio.run(story())


def test_stream_wakes_its_reader_from_another_thread() -> None:
    async def story() -> None:
        stream: Stream[int] = Stream()
        waiting = asyncio.ensure_future(anext(stream))
        await asyncio.sleep(0)
        await asyncio.to_thread(stream.offer, 7)
        assert await waiting == 7

    asyncio.run(story())


def test_topic_is_subscribed_once_for_all_its_streams() -> None:
    async def story() -> None:
        bus: Any = ScriptedBus(ManualClock(), [])
        hub = TopicStreams(bus, "r1")
        first, second = hub.stream(STATUS), hub.stream(STATUS)
        assert list(bus.boxes) == [STATUS.path]
        await first.aclose()
        assert hub.latest(STATUS) is None
        bus.set_newest(STATUS, status())
        assert hub.latest(STATUS) is not None
        await second.aclose()
        assert hub.latest(STATUS) is None, "it is unsubscribed with its last stream"

    asyncio.run(story())
