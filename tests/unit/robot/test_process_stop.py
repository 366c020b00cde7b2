"""The emergency stop at the process comes before everything else and is acknowledged."""

from pathlib import Path

from protocol.topics import (
    COMMANDED,
    STATUS,
    TEXT,
)
from protocol.wire.enums import AckResult, Command, LeaseAction, Severity, Vehicle
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    Statustext,
)
from protocol.wire.reasons import Reason
from robot.core import states
from robot.emergency_stop import emergency_stop
from robot.process import SHOWN_NS
from robot.storage import Store
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.robots import (
    ADA,
    BOB,
    BRAKE,
    HeldWriter,
    Request,
    Rig,
    arm,
    ask_to_stop,
    clear,
    driving,
    goal,
    hold,
    lease,
    press,
    speeds,
)


def test_a_stop_brakes_in_the_next_period() -> None:
    rig = driving()
    press(rig)
    rig.cycle()
    assert rig.vehicle.stopped
    assert speeds(rig.command) == BRAKE
    assert rig.sent(STATUS)[-1].stop_id == 7


def test_stop_sent_as_a_command_stops() -> None:
    rig = driving()
    stop = rig.ask(emergency_stop(7), operator="", good_for_ns=None)
    rig.cycle()
    assert rig.vehicle.stopped
    assert stop.reasons == [Reason.NONE]


def test_stop_is_acted_on_before_earlier_requests() -> None:
    rig = Rig().ready()
    drive = rig.ask(goal(1, 3.0, 0.0))
    press(rig)
    rig.cycle()
    assert drive.reasons == [Reason.EMERGENCY_STOPPED]


def test_stop_bypasses_full_queues() -> None:
    rig = driving()
    for request_id in range(100):
        rig.ask(hold(request_id))
    stop = rig.ask(emergency_stop(7))
    press(rig, 8, operator="")
    rig.cycle()
    assert rig.vehicle.stopped
    assert stop.reasons == [Reason.NONE]


@each("idle", [False, True])
def test_stop_is_acknowledged_only_once_in_force(idle: bool) -> None:
    rig = driving()
    stop = ask_to_stop(rig)
    assert stop.answers == []
    if idle:
        rig.process.idle()
    else:
        rig.cycle()
    (answer,) = stop.answers
    assert isinstance(answer, CommandAck)
    assert (answer.command, answer.result) == (Command.DO_FLIGHTTERMINATION, AckResult.ACCEPTED)
    assert rig.vehicle.stopped


def test_stop_between_two_ticks_is_in_the_state_at_once() -> None:
    """Simulated time may stand still, and an operator waits for the state."""
    rig = driving()
    before = len(rig.sent(STATUS))
    rig.process.idle()
    assert len(rig.sent(STATUS)) == before
    press(rig)
    rig.process.idle()
    (status,) = rig.sent(STATUS)[before:]
    assert status.vehicle == Vehicle.EMERGENCY_STOP


def test_stopped_robot_shows_its_stop_while_simulated_time_stands() -> None:
    """A clear names the stop, and a program that has just been started knows no status."""
    rig = driving()
    press(rig)
    rig.process.idle()
    before = len(rig.sent(STATUS))
    for _ in range(5):
        rig.clock.advance(SHOWN_NS // 2)
        rig.process.idle()
    shown = rig.sent(STATUS)[before:]
    assert {status.vehicle for status in shown} == {Vehicle.EMERGENCY_STOP}
    assert len(shown) == 2


def test_stop_request_is_answered_if_the_loop_was_faster() -> None:
    """Queue the request when the loop sleeps again; in lockstep it sleeps until a nudge."""
    rig = Rig()
    rig.process.serve(nudge=rig.process.idle)
    rig.cycle()
    press(rig)
    assert rig.vehicle.stopped
    stop = Request(emergency_stop(7))
    rig.bus.take_stop(stop)
    assert stop.reasons == [Reason.NONE]


def test_request_for_a_cleared_stop_gets_no_answer() -> None:
    rig = driving()
    late = Request(emergency_stop(7))
    rig.bus.take_stop(late)
    rig.cycle()
    assert (late.answers, late.dropped) == ([], True)


def test_the_first_64_stop_requests_are_answered() -> None:
    rig = driving()
    asked = [ask_to_stop(rig, request_id) for request_id in range(70)]
    rig.cycle()
    assert [len(one.answers) for one in asked] == [1] * 64 + [0] * 6
    assert [one.dropped for one in asked] == [False] * 64 + [True] * 6
    rig.cycle()
    assert sum(len(one.answers) for one in asked) == 64, "each once"


def test_a_release_that_came_before_a_stop_does_not_undo_it() -> None:
    """Reproduce a stop that overtook the release and was acknowledged, but did not last."""
    rig = driving()
    earlier = [rig.ask(one) for one in (clear(21), arm(22), goal(23, 3.0, 0.0))]
    rig.clock.advance(MS)
    stop = ask_to_stop(rig)
    rig.cycle()
    assert stop.reasons == [Reason.NONE]
    assert [one.reasons for one in earlier] == [
        [Reason.NEWER_STOP],
        [Reason.EMERGENCY_STOPPED],
        [Reason.EMERGENCY_STOPPED],
    ]
    assert rig.vehicle.stopped
    assert speeds(rig.command) == BRAKE


def test_a_release_without_a_stop_is_granted() -> None:
    rig = driving()
    release = rig.ask(clear(21))
    rig.cycle()
    assert release.reasons == [Reason.NONE]


@each("same_id", [False, True])
def test_a_release_that_names_the_stop_undoes_it(same_id: bool) -> None:
    rig = driving()
    early = rig.ask(clear(21))
    rig.clock.advance(MS)
    press(rig)
    rig.cycle()
    late = rig.ask(clear(21 if same_id else 22, rig.sent(STATUS)[-1].stop_id))
    rig.cycle()
    assert (early.reasons, late.reasons) == ([Reason.NEWER_STOP], [Reason.NONE])
    assert not rig.vehicle.stopped


@each("was_answered", [False, True])
def test_a_release_repeated_after_a_newer_stop_leaves_it(was_answered: bool) -> None:
    """The first attempt is lost, or its answer; another operator stops; the client repeats it."""
    rig = driving()
    press(rig, 7)
    rig.cycle()
    if was_answered:
        assert rig.ask(clear(21, 7)).reasons == []
        rig.cycle()
        assert not rig.vehicle.stopped
    press(rig, 8, operator="b0b/2")
    rig.cycle()
    repeated = rig.ask(clear(21, 7))
    rig.cycle()
    assert repeated.reasons == [Reason.NEWER_STOP]
    assert rig.vehicle.stopped
    looked = rig.ask(clear(22, rig.sent(STATUS)[-1].stop_id))
    rig.cycle()
    assert looked.reasons == [Reason.NONE]
    assert not rig.vehicle.stopped


def held() -> Rig:
    """Return a driving robot whose lease Ada holds."""
    rig = driving()
    rig.vehicle.receive(lease(LeaseAction.TAKE), rig.clock.now_ns(), ADA)
    return rig


@each("holders_first", [True, False])
def test_a_release_of_one_stop_leaves_another_of_the_same_period(holders_first: bool) -> None:
    """The holder repeats a stop that all have seen, and another operator presses one."""
    rig = held()
    press(rig, 7)
    rig.cycle()
    presses = [(7, ADA), (8, BOB)]
    for request_id, operator in presses if holders_first else reversed(presses):
        press(rig, request_id, operator=operator)
    release = rig.ask(clear(21, 7))
    rig.cycle()
    assert release.reasons == [Reason.NEWER_STOP]
    assert rig.sent(STATUS)[-1].stop_id == 8


def test_two_new_stops_of_one_period_are_shown_in_turn() -> None:
    rig = held()
    press(rig, 8, operator=BOB)
    press(rig, 7)
    rig.cycle()
    assert rig.sent(STATUS)[-1].stop_id == 7, "the holder's first"
    release = rig.ask(clear(21, 7))
    rig.cycle()
    assert release.reasons == [Reason.NEWER_STOP]
    assert rig.sent(STATUS)[-1].stop_id == 8
    looked = rig.ask(clear(22, 8))
    rig.cycle()
    assert looked.reasons == [Reason.NONE]


def test_a_release_in_the_period_of_its_stop_is_refused() -> None:
    """Nobody has seen the stop yet, and another one may wait behind it."""
    rig = held()
    press(rig, 8, operator=BOB)
    press(rig, 7)
    early = rig.ask(clear(21, 7))
    rig.cycle()
    assert early.reasons == [Reason.NEWER_STOP]


def test_a_late_copy_of_a_stop_is_not_the_newest() -> None:
    rig = driving()
    for request_id in (7, 8, 7):
        press(rig, request_id)
        rig.cycle()
    crossing = rig.ask(clear(21, 7))
    rig.cycle()
    assert crossing.reasons == [Reason.NEWER_STOP]
    assert rig.sent(STATUS)[-1].stop_id == 8


@each("idle", [False, True])
def test_a_copy_of_an_earlier_stop_is_shown_once_but_cannot_be_named(idle: bool) -> None:
    """Whoever repeats it sees it acknowledged, though another one was pressed after it."""
    rig = driving()
    for request_id in (7, 8):
        press(rig, request_id)
        rig.cycle()
    before = len(rig.sent(STATUS))
    press(rig, 7)
    if idle:
        rig.process.idle()
    else:
        rig.cycle()
    rig.cycle()
    assert [status.stop_id for status in rig.sent(STATUS)[before:]] == [7, 8]
    refused = rig.ask(clear(21, 7))
    rig.cycle()
    assert refused.reasons == [Reason.NEWER_STOP]
    assert rig.vehicle.stopped
    press(rig, 7)
    crossing = rig.ask(clear(22, 7))
    rig.cycle()
    assert crossing.reasons == [Reason.NEWER_STOP], "also in the period that shows it"
    granted = rig.ask(clear(23, 8))
    rig.cycle()
    assert granted.reasons == [Reason.NONE]
    assert not rig.vehicle.stopped


def test_stops_of_several_senders_are_shown_in_turn() -> None:
    rig = held()
    senders = {7: ADA, 8: BOB, 9: "eve/3"}
    for _ in range(9):
        for request_id, operator in senders.items():
            press(rig, request_id, operator=operator)
        rig.cycle()
    shown = [status.stop_id for status in rig.sent(STATUS)[-6:]]
    assert shown in ([7, 8, 9] * 2, [8, 9, 7] * 2, [9, 7, 8] * 2)


def test_a_copy_of_an_earlier_stop_is_recorded_as_often_as_it_is_shown() -> None:
    rig = driving()
    before = len(rig.sent(COMMANDED))
    for request_id in (7, 8, 7, 7, 8):
        press(rig, request_id)
        rig.cycle()
    recorded = rig.sent(COMMANDED)[before:]
    assert [one.request_id for one in recorded if isinstance(one, CommandRequest)] == [7, 8, 7, 7]


@each("copies", [1, 5])
def test_ones_own_stop_that_is_repeated_is_released(copies: int) -> None:
    rig = driving()
    press(rig)
    rig.cycle()
    for _ in range(copies):
        press(rig)
    release = rig.ask(clear(21, 7))
    rig.cycle()
    assert release.reasons == [Reason.NONE]
    assert not rig.vehicle.stopped


def test_a_stop_is_recorded_once_for_each_id() -> None:
    rig = driving()
    before = len(rig.sent(COMMANDED))
    for request_id in (7, 7, 8, 8):
        press(rig, request_id)
        rig.cycle()
    recorded = rig.sent(COMMANDED)[before:]
    assert [one.request_id for one in recorded if isinstance(one, CommandRequest)] == [7, 8]


def test_stop_repeated_after_a_release_is_recorded_again() -> None:
    rig = driving()
    before = len(rig.sent(COMMANDED))
    for _ in range(2):
        press(rig)
        rig.cycle()
        rig.vehicle.state.machine.vehicle = states.ACTIVE
    assert len(rig.sent(COMMANDED)) == before + 2


@each("idle", [False, True])
def test_stop_that_was_not_saved_is_saved_by_itself(idle: bool) -> None:
    """Simulated time may stand still meanwhile."""
    writer = HeldWriter()
    rig = Rig(Store(Path("state"), writer)).ready()
    press(rig)
    rig.cycle()
    assert [job.path.name for job in writer.waiting] == ["stop.txt"]
    writer.finish(OSError(28, "No space left on device"))
    for _ in range(20):
        rig.process.idle() if idle else rig.cycle()
        rig.clock.advance(100 * MS)
    assert [job.path.name for job in writer.waiting] == ["stop.txt"]


# A stop that did not come by the bus.


@each("idle", [False, True])
def test_a_stop_of_another_thread_is_acted_on_like_one_of_the_bus(idle: bool) -> None:
    rig = driving()
    number = rig.process.press("ada", 77)
    assert not rig.process.has_stopped(number)
    if idle:
        rig.process.idle()
    else:
        rig.cycle()
    assert rig.vehicle.stopped
    assert rig.process.has_stopped(number)
    assert rig.sent(STATUS)[-1].stop_id == 77
    (recorded,) = [one for one in rig.sent(COMMANDED) if isinstance(one, CommandRequest)]
    assert recorded.request_id == 77


def test_a_stop_of_another_thread_wakes_a_loop_that_waits_for_simulated_time() -> None:
    rig = Rig()
    rig.process.serve(nudge=rig.process.idle)
    rig.cycle()
    assert rig.process.has_stopped(rig.process.press("ada", 77))
    assert rig.vehicle.stopped


def test_a_press_has_not_stopped_what_was_released_since() -> None:
    rig = driving()
    number = rig.process.press("ada", 77)
    rig.cycle()
    released = rig.ask(clear(5, 77))
    rig.cycle()
    assert released.reasons == [Reason.NONE]
    assert not rig.process.has_stopped(number)


def test_an_earlier_stop_does_not_acknowledge_a_press_that_is_not_read() -> None:
    rig = driving()
    press(rig)
    rig.cycle()
    assert rig.vehicle.stopped
    assert not rig.process.has_stopped(rig.process.press("ada", 78))


def test_a_note_of_another_thread_is_told_once() -> None:
    rig = driving()
    rig.process.note("an old stop came again")
    for _ in range(3):
        rig.cycle()
    texts = [(one.severity, one.text) for one in rig.sent(TEXT) if isinstance(one, Statustext)]
    assert texts.count((Severity.WARNING, "an old stop came again")) == 1


def test_a_press_before_the_requests_are_served_stops() -> None:
    rig = Rig()
    rig.process.press("ada", 77)
    rig.cycle()
    assert rig.vehicle.stopped


def test_of_many_notes_the_newest_are_told() -> None:
    rig = driving()
    for number in range(100):
        rig.process.note(f"note {number}")
    rig.cycle()
    texts = [one.text for one in rig.sent(TEXT) if isinstance(one, Statustext)]
    assert [text for text in texts if text.startswith("note")] == [
        f"note {number}" for number in range(94, 100)
    ]
