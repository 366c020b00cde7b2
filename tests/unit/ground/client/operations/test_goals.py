"""A goal is sent, followed to its end, and aborted by every interruption."""

from typing import Any

import pytest
from msgspec.structs import replace

from ground.client.goal import destination
from ground.client.operations.goals import GoalEnded, Goto
from ground.client.results import Refused, RefusedError
from protocol.topics import LEASE, STATUS
from protocol.wire.enums import Command, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, GoalRequest, LeaseRequest
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import HELD, STANDBY, Stage, lease_of, status

GOAL = destination([1.0, 2.0, 90.0])
FRESH_NS = 2_000_000_000
ABORT = Command.SIDESTEP_ABORT_GOAL
REACHED_LATER = {"goal": GoalState.REACHED, "time_ns": 3}


def kinds(stage: Stage) -> list[str]:
    return [name_of(request) for request in stage.bus.requests]


def name_of(request: Message) -> str:
    if isinstance(request, LeaseRequest):
        return LeaseAction(request.action).name
    if isinstance(request, GoalRequest):
        return Mode(request.mode).name
    assert isinstance(request, CommandRequest)
    return Command(request.command).name


def following(stage: Stage, *ends: Any) -> None:
    """Let the robot publish these statuses of the goal, one at each poll."""
    waiting, pulse = list(ends), stage.link.pulse

    def publish() -> None:
        goals = [one for one in stage.bus.requests if isinstance(one, GoalRequest)]
        if goals and waiting:
            found = waiting.pop(0)
            if isinstance(found, BaseException):
                raise found
            stage.bus.set_newest(STATUS, status(goal_id=goals[-1].request_id, **found))

    wait = pulse.wait_until

    def wait_until(deadline_ns: int) -> None:
        publish()
        wait(deadline_ns)

    pulse.wait_until = wait_until  # type: ignore[method-assign]


def test_goal_is_followed_to_its_end_under_the_lease() -> None:
    stage = Stage()
    driving = {"goal": GoalState.DRIVING, "time_ns": 2}
    following(stage, driving, {"goal": GoalState.REACHED, "time_ns": 3})
    outcome = Goto(goal=GOAL).perform(stage.session)
    assert isinstance(outcome, GoalEnded)
    assert (outcome.ok, outcome.outcome, outcome.distance_m) == (True, "reached", 1.5)
    assert kinds(stage) == ["TAKE", "GUIDED", "LEAVE"]
    assert any("goal (1.000, 2.000) at 90.0 deg accepted" in note for note in stage.notes.notes)


def test_standing_robot_is_armed_first() -> None:
    stage = Stage(Reason.NONE, Reason.NOT_ARMED, Reason.NONE, Reason.NONE)
    stage.bus.set_newest(*STANDBY)
    following(stage, {"goal": GoalState.REACHED, "time_ns": 3})
    assert Goto(goal=GOAL).perform(stage.session).ok
    assert kinds(stage) == ["TAKE", "GUIDED", "COMPONENT_ARM_DISARM", "GUIDED", "LEAVE"]
    assert stage.notes.notes[0] == "armed"


@each("attended", [True, False])
def test_goal_that_may_not_arm_is_refused(attended: bool) -> None:
    replies = [Reason.NOT_ARMED] if attended else [Reason.NONE, Reason.NOT_ARMED]
    stage = Stage(*replies, attended=attended)
    stage.bus.set_newest(*STANDBY)
    outcome = Goto(goal=GOAL, arms=False).perform(stage.session)
    assert isinstance(outcome, Refused)
    assert outcome.reason == Reason.NOT_ARMED
    assert "COMPONENT_ARM_DISARM" not in kinds(stage)


def test_refused_goal_is_the_outcome_and_the_lease_goes_back() -> None:
    stage = Stage(Reason.NONE, Reason.OUTSIDE_FENCE)
    outcome = Goto(goal=GOAL).perform(stage.session)
    assert isinstance(outcome, Refused)
    assert outcome.reason == Reason.OUTSIDE_FENCE
    assert kinds(stage) == ["TAKE", "GUIDED", "LEAVE"]


def test_lease_of_another_operator_ends_it_before_the_goal() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.set_newest(*HELD)
    with pytest.raises(RefusedError, match="anna"):
        Goto(goal=GOAL).perform(stage.session)
    assert kinds(stage) == ["TAKE"]


@each("error", [KeyboardInterrupt(), RuntimeError("a defect")])
def test_whatever_interrupts_it_aborts_the_goal(error: BaseException) -> None:
    stage = Stage()
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, error)
    with pytest.raises(type(error)):
        Goto(goal=GOAL).perform(stage.session)
    assert kinds(stage) == ["TAKE", "GUIDED", "SIDESTEP_ABORT_GOAL", "LEAVE"]


def ended_id(stage: Stage) -> int:
    """Return the goal that the last abort ends; every abort must name one."""
    aborts = [one for one in stage.bus.requests if getattr(one, "command", 0) == ABORT]
    assert all(one.ends_id for one in aborts)
    return int(aborts[-1].ends_id)


def goal_id(stage: Stage) -> int:
    return [one.request_id for one in stage.bus.requests if isinstance(one, GoalRequest)][-1]


def test_interrupted_goal_aborts_itself_and_no_other() -> None:
    """The goal that was accepted at last is named, not one that was refused before."""
    stage = Stage(Reason.NONE, Reason.NOT_ARMED)
    stage.bus.set_newest(*STANDBY)
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        Goto(goal=GOAL).perform(stage.session)
    assert ended_id(stage) == goal_id(stage)
    assert stage.notes.notes[-1] == "interrupted: goal aborted, the robot stops"


def test_abort_of_a_goal_that_is_over_says_nothing() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, Reason.ALREADY_OVER)
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        Goto(goal=GOAL).perform(stage.session)
    assert kinds(stage)[-2:] == ["SIDESTEP_ABORT_GOAL", "LEAVE"]
    assert "abort" not in stage.notes.notes[-1]


def test_goal_that_another_one_replaces_is_replaced_and_aborts_nothing() -> None:
    stage = Stage()
    driving = {"goal": GoalState.DRIVING, "time_ns": 2}
    following(stage, driving, {"goal": GoalState.DRIVING, "time_ns": 3})
    wait = stage.link.pulse.wait_until

    def wait_until(deadline_ns: int) -> None:
        wait(deadline_ns)
        if stage.clock.now_ns() > 2_000_000_000:
            other = status(goal_id=4, goal=GoalState.DRIVING, time_ns=9, goal_x_m=1.3, goal_y_m=2.0)
            stage.bus.set_newest(STATUS, other)
            stage.bus.set_newest(LEASE, replace(lease_of("ben"), drive_id=4, driver="ben@desk:p/2"))

    stage.link.pulse.wait_until = wait_until  # type: ignore[method-assign]
    outcome = Goto(goal=GOAL).perform(stage.session)
    assert isinstance(outcome, GoalEnded)
    assert not outcome.ok
    assert outcome.text.startswith("replaced by the goal 1.3 2.0 of ben@desk:p/2 after ")
    assert outcome.as_json("goto", "r1")["outcome"] == "replaced"
    assert kinds(stage) == ["TAKE", "GUIDED", "LEAVE"]


@each(
    ("goal", "reason", "outcome"),
    [
        (GoalState.REACHED, Reason.NONE, "reached"),
        (GoalState.STUCK, Reason.NO_PROGRESS, "stuck"),
        (GoalState.ABORTED, Reason.BY_OPERATOR, "aborted: no message from the robot for 3.0 s"),
    ],
)
def test_goal_that_had_ended_unheard_ends_as_it_did(
    goal: GoalState, reason: Reason, outcome: str
) -> None:
    """The robot is heard again while its goal is aborted."""
    stage = Stage()
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2})

    def heard_again(_number: int) -> None:
        if kinds(stage)[-1] == "SIDESTEP_ABORT_GOAL":
            shown = status(time_ns=9, goal=goal, goal_reason=reason, goal_id=goal_id(stage))
            stage.bus.set_newest(STATUS, shown)

    stage.bus.on_ask = heard_again
    ended = Goto(goal=GOAL).perform(stage.session)
    assert isinstance(ended, GoalEnded)
    assert ended.text.startswith(outcome)


def test_nothing_is_shown_until_the_robot_has_the_goal() -> None:
    stage = Stage()
    stage.bus.set_newest(STATUS, status(goal_id=4, goal=GoalState.REACHED))
    following(stage, {"goal": GoalState.DRIVING, "time_ns": 2}, REACHED_LATER)
    stage.notes.live = True
    assert Goto(goal=GOAL).perform(stage.session).ok
    assert stage.notes.lines
    assert not [line for line in stage.notes.lines if "waiting" in line]


def test_goal_whose_answers_were_lost_is_aborted() -> None:
    stage = Stage(Reason.NONE, None, None, None)
    with pytest.raises(RemoteError):
        Goto(goal=GOAL).perform(stage.session)
    assert ended_id(stage) == goal_id(stage)
    assert kinds(stage)[-2:] == ["SIDESTEP_ABORT_GOAL", "LEAVE"]


def test_goal_that_takes_too_long_is_aborted() -> None:
    stage = Stage()
    times = range(2, 200)
    following(stage, *({"goal": GoalState.DRIVING, "time_ns": at} for at in times))
    outcome = Goto(goal=GOAL, timeout_s=1.0).perform(stage.session)
    assert isinstance(outcome, GoalEnded)
    assert (outcome.ok, outcome.outcome, outcome.reason) == (
        False,
        "timeout",
        "goal not reached within 1 s",
    )
    assert kinds(stage)[-2:] == ["SIDESTEP_ABORT_GOAL", "LEAVE"]


def test_silent_robot_ends_the_goal() -> None:
    outcome = Goto(goal=GOAL).perform(Stage().session)
    assert isinstance(outcome, GoalEnded)
    assert outcome.outcome == "aborted"
    assert "no message" in outcome.reason


def test_attended_goal_ends_with_the_answer() -> None:
    stage = Stage(attended=True)
    assert Goto(goal=GOAL).perform(stage.session).text == "ok 14 ms"
    assert kinds(stage) == ["GUIDED"]


def test_goal_that_needs_no_operator_is_in_auto() -> None:
    stage = Stage()
    assert Goto(goal=GOAL, wait=False).perform(stage.session).ok
    assert (kinds(stage), stage.bus.sent) == (["AUTO"], [])


@each(("wait", "attended"), [(False, False), (True, True)])
def test_timeout_is_refused_without_waiting(wait: bool, attended: bool) -> None:
    stage = Stage(attended=attended)
    with pytest.raises(UserError, match="--timeout"):
        Goto(goal=GOAL, wait=wait, timeout_s=3.0).perform(stage.session)
    assert stage.bus.asked == []


def test_goal_ahead_of_a_robot_without_a_pose_is_not_sent() -> None:
    stage = Stage()
    with pytest.raises(RemoteError, match="publishes no pose"):
        Goto(goal=GOAL, seen_by_robot=True, wait=False).perform(stage.session)
    assert stage.bus.asked == []


def test_robot_in_a_failsafe_is_never_armed_by_a_goal() -> None:
    stage = Stage(Reason.NOT_ARMED, attended=True)
    stage.bus.set_newest(STATUS, status(Vehicle.FAILSAFE))
    assert not Goto(goal=GOAL).perform(stage.session).ok
    assert kinds(stage) == ["GUIDED"]
