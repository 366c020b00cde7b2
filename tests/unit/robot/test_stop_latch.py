"""The latch of the emergency stop: set by any bytes, kept over restarts, cleared by an operator."""

import os
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command, Severity
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, MissionRequestList
from protocol.wire.reasons import Reason
from robot.core import states
from robot.emergency_stop import RESTORED, RETRY_NS, SAVED, TEXT, StopLatch, emergency_stop
from robot.storage import Store
from runtime import files
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.robots import Desk, HeldWriter, goal

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


def started(store: Store) -> Desk:
    desk = Desk(store)
    desk.vehicle.restore()
    return desk


def told(desk: Desk) -> list[tuple[int, str]]:
    """Return severity and words of each text, whose pieces share an id."""
    pieces: dict[tuple[int, int], str] = {}
    for at, one in enumerate(desk.vehicle.texts()):
        key = one.severity, one.id or -at
        pieces[key] = pieces.get(key, "") + one.text
    return [(severity, words) for (severity, _), words in pieces.items()]


def test_stop_holds_until_an_operator_clears_it(tmp_path: Path) -> None:
    first = started(Store(tmp_path))
    assert first.arm() == Reason.NONE
    first.vehicle.receive(emergency_stop(7), first.now_ns)
    for _ in range(2):
        desk = started(Store(tmp_path))
        assert (Severity.CRITICAL, RESTORED) in told(desk)
        assert desk.arm() == Reason.EMERGENCY_STOPPED
        assert desk.goto(2, 0) != Reason.NONE
        assert desk.vehicle.stopped
        assert desk.vehicle.brakes
    assert desk.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP) == Reason.NONE
    desk = started(Store(tmp_path))
    assert desk.arm() == Reason.NONE


def test_restored_stop_is_a_request_for_whoever_executes_the_run_again(tmp_path: Path) -> None:
    started(Store(tmp_path)).vehicle.receive(emergency_stop(7), 0)
    desk = Desk(Store(tmp_path))
    ((request, _),) = desk.vehicle.restore()
    again = Desk()
    again.vehicle.receive(request, 0)
    assert again.vehicle.state.machine.vehicle == states.EMERGENCY_STOP


def link_to(target: str) -> Callable[[Path], None]:
    return lambda path: os.symlink(target, path)


@each(
    "make",
    [
        Path.touch,
        Path.mkdir,
        os.mkfifo,
        link_to("/dev/zero"),
        link_to("nowhere"),
        lambda path: path.write_bytes(b"\xff\0" * 100_000),
    ],
)
def test_whatever_has_its_name_stops_the_robot(
    make: Callable[[Path], object], tmp_path: Path
) -> None:
    folder = Path(mkdtemp(dir=tmp_path))
    make(folder / "stop.txt")
    assert started(Store(folder)).vehicle.stopped


def test_operator_reads_whether_it_is_saved(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    desk.vehicle.receive(emergency_stop(7), 0)
    assert desk.vehicle.stopped, "it must not wait for the disk"
    assert not any("saved" in words for _, words in told(desk))
    writer.finish()
    assert (Severity.NOTICE, SAVED) in told(desk)


FULL = OSError(28, "No space left on device")


def test_full_disk_is_reported_at_each_press(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    for _ in range(2):
        desk.vehicle.receive(emergency_stop(7), 0)
        writer.finish(FULL)
        ((severity, words),) = [one for one in told(desk) if "stop" in one[1]]
        assert severity == Severity.CRITICAL
        assert words == "emergency stop NOT saved, trying again: No space left on device"


def test_failed_write_is_tried_again_each_second_by_itself(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    desk.vehicle.receive(emergency_stop(7), 0)
    writer.finish(FULL)
    assert any("NOT saved" in words for _, words in told(desk))
    tried_ms = []
    for now_ms in range(10_000, 15_000, 50):
        desk.vehicle.retry_stop(now_ms * MS)
        if writer.waiting:
            tried_ms.append(now_ms)
            writer.finish(None if len(tried_ms) == 4 else FULL)
        if len(tried_ms) < 4:
            assert not [words for _, words in told(desk) if "saved" in words], "it is known"
    assert tried_ms == [10_000, 11_000, 12_000, 13_000]
    assert (Severity.NOTICE, SAVED) in told(desk)
    assert started(Store(tmp_path)).vehicle.stopped


def test_another_error_is_reported_while_it_is_tried_again(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    desk.vehicle.receive(emergency_stop(7), 0)
    for now_s, error in enumerate((FULL, OSError(30, "Read-only file system"), FULL), 1):
        writer.finish(error)
        assert any(str(error.strerror) in words for _, words in told(desk))
        desk.vehicle.retry_stop(now_s * RETRY_NS)


def test_folder_of_its_own_keeps_only_the_stop(tmp_path: Path) -> None:
    desk = started(Store(None, None, tmp_path / "robot r1"))
    desk.vehicle.receive(emergency_stop(7), 0)
    assert [path.name for path in tmp_path.rglob("*.*")] == ["stop.txt"]
    assert started(Store(None, None, tmp_path / "robot r1")).vehicle.stopped
    assert not started(Store(None)).vehicle.stopped


def test_stop_is_kept_although_the_core_fails_at_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the board hangs")

    desk = started(Store(tmp_path))
    monkeypatch.setattr(desk.vehicle.commands, "receive", fail)
    with pytest.raises(RuntimeError):
        desk.vehicle.receive(emergency_stop(7), 0)
    assert started(Store(tmp_path)).vehicle.stopped


def test_release_that_was_not_written_is_tried_again_by_itself(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    desk.vehicle.receive(emergency_stop(7), 0)
    writer.finish()
    told(desk)
    desk.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
    writer.finish(FULL)
    ((severity, words),) = [one for one in told(desk) if "stop.txt" in one[1]]
    assert severity == Severity.ERROR
    assert words.endswith("stop.txt not removed, trying again: No space left on device")
    assert started(Store(tmp_path)).vehicle.stopped
    desk.vehicle.retry_stop(RETRY_NS)
    writer.finish()
    assert not started(Store(tmp_path)).vehicle.stopped


def clear(desk: Desk, request_id: int) -> int:
    request = make(
        CommandRequest, request_id=request_id, command=Command.SIDESTEP_CLEAR_EMERGENCY_STOP
    )
    answer = desk.vehicle.receive(request, desk.now_ns, "ada/1")
    assert isinstance(answer, CommandAck)
    return answer.result_param2


@each("before_the_restart", [False, True])
def test_late_repetition_of_a_release_spares_a_newer_stop(
    before_the_restart: bool, tmp_path: Path
) -> None:
    """The answer of the release is lost, the process starts again, its client repeats it."""
    folder = Path(mkdtemp(dir=tmp_path))
    desk = started(Store(folder))
    desk.vehicle.receive(emergency_stop(7), 0)
    assert clear(desk, 21) == Reason.NONE
    assert not desk.vehicle.stopped
    if before_the_restart:
        desk.vehicle.receive(emergency_stop(8), 0)
    desk = started(Store(folder))
    if not before_the_restart:
        desk.vehicle.receive(emergency_stop(8), 0)
    assert clear(desk, 21) == Reason.NEWER_STOP, "not OK: the robot is stopped"
    assert desk.vehicle.stopped
    assert started(Store(folder)).vehicle.stopped
    assert clear(desk, 22) == Reason.NONE
    assert not desk.vehicle.stopped


def test_release_that_released_nothing_may_be_repeated(tmp_path: Path) -> None:
    """Only a request that was carried out is known; without a stop there was nothing to do."""
    assert clear(started(Store(tmp_path)), 21) == Reason.NOTHING_LATCHED
    desk = started(Store(tmp_path))
    desk.vehicle.receive(emergency_stop(8), 0)
    assert clear(desk, 21) == Reason.NONE
    assert not desk.vehicle.stopped


def test_newest_releases_are_known(tmp_path: Path) -> None:
    desk = started(Store(tmp_path))
    for request_id in range(1, 41):
        desk.vehicle.receive(emergency_stop(7), 0)
        clear(desk, request_id)
    kept = (tmp_path / "cleared.txt").read_text().split()
    assert [int(one, 16) for one in kept] == list(range(25, 41))


def test_damaged_list_of_releases_does_not_release(tmp_path: Path) -> None:
    (tmp_path / "cleared.txt").write_bytes(b"\xff\0 no number")
    desk = started(Store(tmp_path))
    desk.vehicle.receive(emergency_stop(8), 0)
    assert clear(desk, 21) == Reason.NONE
    assert (tmp_path / "cleared.txt").read_text() == "15\n"


def test_pipe_in_the_place_of_the_draft_holds_up_no_stop(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / ".stop.txt.part")
    desk = started(Store(tmp_path))
    desk.vehicle.receive(emergency_stop(7), 0)
    assert any("NOT saved" in words for _, words in told(desk))
    desk.vehicle.retry_stop(RETRY_NS)
    assert started(Store(tmp_path)).vehicle.stopped, "the pipe was removed"


def test_operators_read_what_is_there() -> None:
    assert (TEXT, SAVED, RESTORED) == (
        "The emergency stop holds until an operator clears it.\n",
        "emergency stop saved: it holds over a restart",
        "the emergency stop of the previous run still holds: clear it to arm",
    )


def test_without_a_folder_a_stop_is_released_all_the_same() -> None:
    desk = Desk(Store(None))
    desk.vehicle.receive(emergency_stop(7), 0)
    desk.vehicle.retry_stop(RETRY_NS)
    assert clear(desk, 21) == Reason.NONE
    assert not desk.vehicle.stopped


def test_folder_that_cannot_be_looked_up_stops_the_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Path) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files, "is_there", fail)
    assert started(Store(tmp_path)).vehicle.stopped


def test_restored_stop_is_not_written_again(tmp_path: Path) -> None:
    (tmp_path / "stop.txt").touch()
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    desk.vehicle.receive(emergency_stop(7), 0)
    assert writer.waiting == []


def test_only_a_stop_that_holds_is_reported_as_saved(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = started(Store(tmp_path, writer))
    for ends in ("released before it was written", "pressed again before it was removed"):
        desk.vehicle.receive(emergency_stop(7), 0)
        if ends.startswith("pressed"):
            writer.finish()
            told(desk)
        clear(desk, len(ends))
        if ends.startswith("pressed"):
            desk.vehicle.receive(emergency_stop(8), 0)
        writer.finish()
        assert (Severity.NOTICE, SAVED) not in told(desk), ends
        writer.finish()
        assert ((Severity.NOTICE, SAVED) in told(desk)) == ends.startswith("pressed")
    clear(desk, 1)
    writer.finish()
    assert (Severity.NOTICE, SAVED) not in told(desk)


def test_write_without_a_failure_is_not_repeated(tmp_path: Path) -> None:
    writer = HeldWriter()
    desk = Desk(Store(tmp_path, writer))
    desk.vehicle.retry_stop(RETRY_NS)
    assert writer.waiting == []
