"""The observer gives a cause only for what it has caused: requests and states are the test's."""

from typing import Any, Final

from checks.simulation.contradictions.claims import ClaimsObserver
from checks.simulation.contradictions.truth import (
    Journal,
    RequestTruth,
    RobotRow,
    Said,
    ShownText,
    Truth,
)
from checks.simulation.hosts.virtual_time import Scheduler
from protocol.wire.enums import Command, GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import CommandRequest
from tests.support.each import each

ADA, BEA = "ada-nb", "bea-t2"
STEP_NS: Final = 100_000_000
FAILED: Final = ShownText("log", "mission FAILED: bumper contact")
RUNS: Final = {"mission_state": MissionState.RUNNING, "goal_state": GoalState.DRIVING}
ENDS: Final = {"mission_state": MissionState.FAILED, "goal_state": GoalState.ABORTED}
ABORT: Final = Command.SIDESTEP_ABORT_GOAL


class Story:
    """An armed robot that accepts requests of programs, one in each step."""

    def __init__(self) -> None:
        self.scheduler = Scheduler()
        self.truth, self.journal = Truth(self.scheduler), Journal(self.scheduler)
        self.row = RobotRow(
            ns=0, vehicle=Vehicle.ACTIVE, vehicle_reason=0, mode=Mode.AUTO,
            goal_state=GoalState.NONE, goal_reason=0, goal_id=0, stop_id=0,
            mission_state=MissionState.READY, mission_reason=0, x_m=0.0, y_m=0.0, speed_m_s=0.0,
            holder="", holder_name="", op_lost_ms=1500.0,
        )  # fmt: skip
        self.becomes()

    def becomes(self, **now: Any) -> None:
        """Let a step pass, after which the robot's state is this."""
        self.scheduler.now_ns += STEP_NS
        self.row = self.row._replace(ns=self.scheduler.now_ns, **now)
        self.truth.rows.append(self.row)

    def accepts(self, program: str, command: Command, *params: float, **after: Any) -> None:
        """Let the robot accept a request of a program, which changes its state to this."""
        before, at = self.row, len(self.truth.rows)
        self.becomes(**after)
        param1, param2, *_ = (*params, 0.0, 0.0)
        asked = CommandRequest(request_id=at, command=command, param1=param1, param2=param2)
        self.truth.answered.append(
            RequestTruth(self.row.ns, program, "", asked, True, 0, before, at)
        )

    def starts_mission(self, program: str) -> None:
        """Let a program drive a mission."""
        self.journal.begin(program, "mission", (36.0, 30.0))
        self.accepts(program, Command.MISSION_START, **RUNS, goal_id=len(self.truth.rows))

    def cancels_mission(self) -> None:
        """Let a person cancel the newest mission, whose program ends it."""
        deed = self.journal.deeds[-1]
        self.journal.cancel(deed)
        self.accepts(deed.program, ABORT, **ENDS)

    def wrong_in(self, words: ShownText) -> list[str]:
        """Return what is wrong in words that are shown now."""
        said = Said(self.scheduler.now_ns, ADA, words)
        return [why for _, why in ClaimsObserver(self.truth, self.journal).judge(said)]

    def uncaused(self) -> list[str]:
        """Return the stops that have no cause."""
        return [one.words for one in ClaimsObserver(self.truth, self.journal).judge_end()]


BY_HAND: Final = (Command.DO_SET_MODE, 1.0, Mode.MANUAL)


@each(
    ("asked", "after"),
    [
        (BY_HAND, {"mode": Mode.MANUAL}),
        ((ABORT,), ENDS),
        ((Command.COMPONENT_ARM_DISARM, 0.0), {"vehicle": Vehicle.STANDBY}),
        ((Command.DO_FLIGHTTERMINATION,), {"vehicle": Vehicle.EMERGENCY_STOP}),
        ((Command.NAV_RETURN_TO_LAUNCH,), {"mode": Mode.SMART_RTL}),
    ],
)
def test_mission_that_an_operator_has_ended_has_not_failed(
    asked: tuple[Any, ...], after: dict[str, Any]
) -> None:
    story = Story()
    story.starts_mission(ADA)
    story.accepts(BEA, *asked, **after)
    story.becomes(**ENDS)
    assert [why.startswith(BEA) for why in story.wrong_in(FAILED)] == [True]


def test_drive_by_hand_after_a_failsafe_has_not_ended_the_mission() -> None:
    """Let MANUAL come in the period in which the failsafe has stopped the robot."""
    story = Story()
    story.starts_mission(ADA)
    story.becomes(vehicle=Vehicle.FAILSAFE)
    story.accepts(BEA, *BY_HAND, mode=Mode.MANUAL)
    story.becomes(**ENDS)
    assert story.wrong_in(FAILED) == []


def test_abort_of_an_own_mission_at_its_end_has_a_cause() -> None:
    story = Story()
    story.starts_mission(ADA)
    story.cancels_mission()
    assert story.uncaused() == []


@each("waits", [False, True])
def test_own_mission_that_is_over_is_no_cause_to_end_anothers(waits: bool) -> None:
    story = Story()
    story.starts_mission(ADA)
    story.cancels_mission()
    story.starts_mission(BEA)
    if waits:
        story.becomes(mission_state=MissionState.HOLDING, goal_state=GoalState.REACHED)
    story.accepts(ADA, ABORT, mission_state=MissionState.FAILED)
    (found,) = story.uncaused()
    assert found.startswith(ADA)
    assert "nobody has asked for that" in found


def test_drive_that_begins_in_the_same_tick_was_not_ended() -> None:
    story = Story()
    first = story.journal.begin(ADA, "drive", (0.2, 0.0))
    story.accepts(ADA, *BY_HAND, mode=Mode.MANUAL)
    story.journal.cancel(first)
    story.accepts(ADA, Command.DO_SET_MODE, 1.0, Mode.HOLD, mode=Mode.HOLD)
    ns = story.scheduler.now_ns
    story.accepts(BEA, *BY_HAND, mode=Mode.MANUAL)
    newest = story.truth.answered.pop()
    story.truth.answered.append(newest._replace(ns=ns))
    assert story.uncaused() == []
