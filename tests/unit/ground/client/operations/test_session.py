"""A request is repeated after a remedy: a robot in standby is armed, a stopped robot is not."""

from ground.client.operations.session import RETRY_NS, Session
from ground.client.results import Refused
from protocol.topics import STATUS
from protocol.wire.enums import Command, Vehicle
from protocol.wire.messages import CommandRequest
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.answering import AnsweringLink
from tests.support.ground.client import Notes, status

ARM = Command.COMPONENT_ARM_DISARM
START = Command.MISSION_START


def asked_until_accepted(link: AnsweringLink, *, beats: bool = False) -> tuple[int, str]:
    """Return the last reason and the notes."""

    def request() -> CommandRequest:
        return link.command(START)

    notes = Notes()
    answer, _ = Session(link.as_link(), notes).ask_until_accepted(request, beats=beats)
    reason = answer.reason if isinstance(answer, Refused) else Reason.NONE
    return reason, "".join(f"{note}\n" for note in notes.notes)


def test_what_the_robot_does_at_once_is_asked_once() -> None:
    link = AnsweringLink()
    assert asked_until_accepted(link) == (Reason.NONE, "")
    assert link.commands == [START]


def test_standby_robot_is_armed_and_request_repeated() -> None:
    link = AnsweringLink(Reason.NOT_ARMED)
    link.newest_messages[STATUS.path] = status(Vehicle.STANDBY)
    assert asked_until_accepted(link) == (Reason.NONE, "armed\n")
    assert link.commands == [START, ARM, START]
    ids = [one.request_id for one in link.asked if isinstance(one, CommandRequest)]
    assert len(set(ids)) == 3


@each("vehicle", [Vehicle.FAILSAFE, Vehicle.EMERGENCY_STOP])
def test_a_robot_that_was_stopped_for_a_reason_is_never_armed(vehicle: Vehicle) -> None:
    link = AnsweringLink(Reason.NOT_ARMED)
    link.newest_messages[STATUS.path] = status(vehicle)
    assert asked_until_accepted(link) == (Reason.NOT_ARMED, "")
    assert ARM not in link.commands


def test_robot_without_a_status_tells_why_it_cannot_be_armed() -> None:
    """Without a plant its control loop does not run; `arm` tells the cause."""
    link = AnsweringLink(Reason.NOT_ARMED, Reason.NO_SENSES)
    assert asked_until_accepted(link) == (Reason.NO_SENSES, "")
    assert link.commands == [START, ARM]


@each("vehicle", [Vehicle.STANDBY, Vehicle.BOOT])
def test_refused_arming_is_the_answer(vehicle: Vehicle) -> None:
    link = AnsweringLink(Reason.NOT_ARMED, Reason.NO_SENSES)
    link.newest_messages[STATUS.path] = status(vehicle)
    assert asked_until_accepted(link) == (Reason.NO_SENSES, "")
    assert link.commands == [START, ARM]


def test_missing_operator_is_remedied_by_a_heartbeat() -> None:
    link = AnsweringLink(Reason.NO_OPERATOR, Reason.NO_OPERATOR)
    assert asked_until_accepted(link, beats=True)[0] == Reason.NONE
    assert link.beats == 2


def test_no_heartbeat_is_sent_without_beats() -> None:
    link = AnsweringLink(Reason.NO_OPERATOR)
    assert asked_until_accepted(link)[0] == Reason.NO_OPERATOR
    assert link.beats == 0


def test_it_is_not_asked_for_ever() -> None:
    link = AnsweringLink(*[Reason.NO_OPERATOR] * 10_000)
    assert asked_until_accepted(link, beats=True)[0] == Reason.NO_OPERATOR
    assert RETRY_NS <= link.clock.now_ns() < 2 * RETRY_NS


@each("reason", [Reason.OUTSIDE_FENCE, Reason.LEASE_HELD, Reason.NO_MISSION])
def test_what_nothing_remedies_is_the_answer(reason: Reason) -> None:
    link = AnsweringLink(reason)
    assert asked_until_accepted(link, beats=True)[0] == reason
    assert link.commands == [START]
