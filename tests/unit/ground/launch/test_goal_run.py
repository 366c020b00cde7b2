"""One robot's run when somebody it needs is gone: it waits whether they come back, and says so."""

from dataclasses import replace
from typing import Any, Self

import pytest

from ground.client.connection import Common
from ground.client.goal import destination
from ground.client.link import Link, Unanswered
from ground.client.requests import ATTEMPTS
from ground.launch.goal_run import PATIENCE_NS, READY_NS, GoalRun, NotRun
from ground.launch.scenario import Scenario, ScenarioRobot
from ground.launch.supervisor import InvalidRun
from protocol.bus.network import Network
from protocol.topic import Service
from protocol.topics import STATUS
from protocol.wire.enums import AckResult, GoalState
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest, NavigatorStatus
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import NoAnswer
from tests.support.boxes import Wireless

SECOND = 1_000_000_000
SILENT = "nobody serves it"
SCENARIO = Scenario(
    world="open", name="open", facts={}, entrants=(), navigator="vgm", side="left", seed=0,
    noise=None, speed="1", router=False, record=None, timeout_s=100.0,
)  # fmt: skip
WHY = "the plant process was killed (signal SIGKILL)"


class Wired(Wireless):
    """No frames come; nobody answers before `serves_after` questions."""

    holder = None
    serves_after = 1000
    asked = 0

    def stream(self, *_: Any) -> None:
        """Nothing comes."""

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        self.asked += 1
        if self.asked <= self.serves_after:
            raise NoAnswer(SILENT)
        assert isinstance(message, CommandRequest)
        return CommandAck(command=message.command, result=AckResult.ACCEPTED)


class Dialled(Link):
    def diagnosis(self) -> str:
        return "it hangs"


class Stage:
    """An errand, and what it hears."""

    def __init__(self, *, lockstep: bool = False) -> None:
        self.bus, self.clock = Wired(), ManualClock(SECOND)
        self.void: InvalidRun | None = None
        network = Network(mode="client", connect=("tcp/127.0.0.1:1",))
        link = Dialled(self.bus, Common(network=network, robot="r1"), self.clock)
        goal = destination([3.0, 2.0])
        entrant = ScenarioRobot(robot="r1", start=(0.0, 0.0, 0.0), goal=goal)
        scenario = replace(SCENARIO, speed="max") if lockstep else SCENARIO
        self.errand = GoalRun(link, scenario, entrant, lambda: None, lambda: self.void)

    @classmethod
    def begun(cls, *, lockstep: bool = False) -> Self:
        stage = cls(lockstep=lockstep)
        stage.errand.begin()
        return stage

    def hear(self, goal: GoalState, ended_ns: int = 0) -> None:
        status = NavigatorStatus(
            time_ns=self.clock.now_ns(), goal_started_ns=SECOND, goal_ended_ns=ended_ns, goal_id=0,
            goal_x_m=3.0, goal_y_m=2.0, goal_heading_rad=0.0, goal_distance_m=1.0, vehicle=2,
            mode=10, goal=goal, vehicle_reason=0, goal_reason=Reason.TICKS_LOST, navigator=1,
            side=1,
        )  # fmt: skip
        self.bus.boxes[STATUS.path].newest = (status, self.clock.now_ns())

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.clock.advance(SECOND // 10)
            self.errand.look()


def test_a_robot_that_starts_slowly_is_asked_until_it_serves() -> None:
    stage = Stage()
    stage.bus.serves_after = 3 * ATTEMPTS
    stage.errand.prepare()
    assert stage.bus.asked == 3 * ATTEMPTS + 2


def test_a_robot_that_never_serves_is_not_asked_for_ever() -> None:
    stage = Stage()
    with pytest.raises(Unanswered, match=SILENT):
        stage.errand.prepare()
    assert READY_NS < stage.clock.now_ns() - SECOND < 2 * READY_NS


def test_a_plant_that_does_not_score_may_come_back_and_then_the_run_is_void() -> None:
    stage = Stage.begun()
    stage.hear(GoalState.ABORTED, ended_ns=2 * SECOND)
    stage.wait(3.0)
    stage.void = InvalidRun(WHY, over=False)
    stage.wait(1.0)
    assert not stage.errand.over
    assert [part.text for part in stage.errand.line()] == [WHY]
    stage.void = InvalidRun(f"{WHY}; it is back", over=True)
    stage.wait(0.1)
    assert stage.errand.over
    assert stage.errand.spoilt == f"{WHY}; it is back"
    assert stage.errand.outcome is None


def test_one_that_does_not_come_back_is_not_waited_for_for_ever() -> None:
    stage = Stage.begun()
    stage.hear(GoalState.ABORTED, ended_ns=2 * SECOND)
    stage.wait(PATIENCE_NS / SECOND)
    with pytest.raises(NotRun, match=SILENT):
        stage.wait(0.2)


def test_a_silent_robot_is_given_the_time_to_be_started_again() -> None:
    stage = Stage.begun()
    stage.hear(GoalState.DRIVING)
    stage.wait(3.0 + PATIENCE_NS / SECOND)
    with pytest.raises(NotRun, match="silent for 3"):
        stage.wait(0.2)


def test_in_lockstep_nobody_comes_back_and_nobody_waits() -> None:
    stage = Stage.begun(lockstep=True)
    stage.hear(GoalState.ABORTED, ended_ns=2 * SECOND)
    with pytest.raises(NotRun, match=SILENT):
        stage.wait(0.1)
