"""The latch of the emergency stop: any bytes set it, and nothing fills or blocks it."""

import threading
import weakref

from hypothesis import given
from hypothesis import strategies as st

from protocol.wire.codec import Encoder
from protocol.wire.enums import Command
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, MissionRequestList
from robot.emergency_stop import StopLatch, emergency_stop
from tests.support.each import each
from tests.support.robot.vehicles import goal

ADA, BOB, STRANGER = "ada/1", "bob/2", ""


def frame(message: Message) -> bytes:
    return Encoder(1, 1).encode(message)


def stop(request_id: int) -> bytes:
    return frame(emergency_stop(request_id))


def latch(*shown: int, holder: str = ADA) -> StopLatch:
    """Return the latch of a robot whose lease an operator holds, and which has shown stops."""
    return StopLatch(lambda operator: operator == holder, lambda request_id: request_id in shown)


def taken(pressed: StopLatch) -> list[int]:
    """Return the ids of all stops that readings return."""
    return [request.request_id for request in iter(pressed.take, None)]


def test_unset_latch_returns_nothing() -> None:
    assert latch().take() is None


@each("operator", [ADA, BOB, STRANGER])
def test_any_sender_stops_and_reading_resets_the_latch(operator: str) -> None:
    pressed = latch()
    pressed.press(operator, stop(17))
    assert pressed.take() == CommandRequest(
        request_id=17, param1=1.0, param2=0.0, command=Command.DO_FLIGHTTERMINATION
    )
    assert pressed.take() is None


@each("operator", [ADA, BOB])
def test_each_of_several_stops_is_named_the_newest_first(operator: str) -> None:
    pressed = latch()
    for request_id in (1, 2, 3):
        pressed.press(operator, stop(request_id))
    assert taken(pressed) == [3, 2, 1]


@each("other", [BOB, STRANGER])
def test_a_flood_of_others_does_not_hide_the_holders_stop(other: str) -> None:
    pressed = latch()
    pressed.press(ADA, stop(7))
    for request_id in range(100, 1100):
        pressed.press(other, stop(request_id))
    assert taken(pressed) == [7, *range(1099, 1091, -1)]


@each(("copies", "new"), [(ADA, BOB), (BOB, ADA), (ADA, ADA), (BOB, BOB)])
@each("first", [True, False])
def test_copies_of_a_stop_that_was_shown_hide_no_new_one(
    copies: str, new: str, first: bool
) -> None:
    pressed = latch(7)
    for operator, request_id in [(copies, 7), (new, 8), (copies, 7)][first:]:
        pressed.press(operator, stop(request_id))
    assert pressed.take() == emergency_stop(8)


@each("operator", [ADA, BOB])
def test_copies_of_a_stop_that_was_shown_are_one_stop(operator: str) -> None:
    pressed = latch(7)
    for _ in range(3):
        pressed.press(operator, stop(7))
    assert taken(pressed) == [7]


@each(
    ("ids", "in_turn"),
    [((1, 2, 3), [1, 2, 3, 1]), ((3, 2**64 - 1, 5), [3, 5, 2**64 - 1, 3]), ((7,), [7, 7])],
)
def test_copies_of_several_stops_are_returned_in_turn(
    ids: tuple[int, ...], in_turn: list[int]
) -> None:
    """Each sender repeats its own until it sees it acknowledged."""
    pressed, found = latch(*ids), []
    for _ in in_turn:
        for request_id in ids:
            pressed.press(ADA if request_id == 3 else BOB, stop(request_id))
        copy = pressed.take()
        assert copy is not None
        found.append(copy.request_id)
        assert pressed.take() is None, "one copy stands for all of its reading"
    assert found == in_turn


def test_a_new_stop_between_does_not_change_whose_turn_it_is() -> None:
    pressed, found = latch(1, 2, 3), []
    for ids in ((1, 2, 3), (1, 2, 3, 9), (1, 2, 3)):
        for request_id in ids:
            pressed.press(ADA, stop(request_id))
        found += taken(pressed)
    assert found == [1, 9, 2, 3]


def test_sender_without_identity_is_not_the_holder() -> None:
    pressed = StopLatch(lambda _: True, lambda _: False)
    pressed.press(ADA, stop(1))
    pressed.press(STRANGER, stop(2))
    assert taken(pressed) == [1, 2]


class Name(str):
    """A name that detects when it is no longer referenced."""


@each("holder", [True, False])
def test_the_newest_eight_frames_are_kept(holder: bool) -> None:
    pressed = StopLatch(lambda _: holder, lambda _: False)
    name = Name("ada/1")
    kept = weakref.ref(name)
    pressed.press(name, stop(0))
    del name
    for request_id in range(1, 8):
        pressed.press(ADA, stop(request_id))
    assert kept() is not None
    pressed.press(ADA, stop(8))
    assert kept() is None


@each(
    ("content", "request_id"),
    [
        (b"", 1),
        (b"garbage", 1),
        (frame(MissionRequestList()), 1),
        (frame(CommandRequest(request_id=0, command=185, param1=1.0, param2=0.0)), 1),
        (frame(goal(5, 1.0, 0.0)), 1),
        (frame(CommandRequest(request_id=6, command=400, param1=1.0, param2=0.0)), 6),
    ],
)
def test_any_bytes_received_as_a_stop_are_a_stop(content: bytes, request_id: int) -> None:
    pressed = latch()
    pressed.press(ADA, content)
    assert pressed.take() == emergency_stop(request_id)


presses = st.tuples(st.sampled_from([ADA, BOB, STRANGER]), st.binary(max_size=40))


@given(st.lists(st.one_of(st.none(), presses), max_size=60), st.booleans())
def test_stop_is_returned_if_one_arrived_since_the_last_read(
    events: list[tuple[str, bytes] | None], shown: bool
) -> None:
    """Elements that are None read the latch; all others set it."""
    pressed, waiting = StopLatch(lambda operator: operator == ADA, lambda _: shown), False
    for event in [*events, None]:
        if event is None:
            assert (pressed.take() is not None) or not waiting
            waiting = False
        else:
            pressed.press(*event)
            waiting = True
    assert len(taken(pressed)) <= 16 * (not shown)


def test_no_stop_is_lost_between_threads() -> None:
    """Of a flood the newest ones are kept, so the last is among them."""
    pressed = latch()
    last = stop(10**6)

    def press() -> None:
        for request_id in range(1, 2_000):
            pressed.press(ADA, stop(request_id))
        pressed.press(ADA, last)

    thread = threading.Thread(target=press)
    thread.start()
    found: list[int] = []
    while 10**6 not in found:
        alive = thread.is_alive()
        request = pressed.take()
        assert request is not None or alive
        if request is not None:
            found.append(request.request_id)
    thread.join()
    assert len(taken(pressed)) < 8
    assert len(set(found)) == len(found)


def test_each_reading_counts_whether_it_finds_a_stop_or_not() -> None:
    pressed = latch()
    assert pressed.takes == 0
    pressed.take()
    assert pressed.takes == 1
    pressed.press(ADA, stop(1))
    assert pressed.takes == 1
    pressed.take()
    assert pressed.takes == 2
