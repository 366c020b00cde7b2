"""Missions and fences over the whole stack, driven to their ends."""

from protocol.topics import MISSION, MISSION_SERVICE
from protocol.wire.enums import Command, GoalState, MissionState, MissionType, Vehicle
from protocol.wire.messages import MissionClearAll, MissionStatus
from protocol.wire.reasons import Reason
from tests.support.harness import STOPPING_S, Stack
from tests.support.operators import Operator, fence, stops


class Watched:
    """A stack whose operator uploaded a mission and left, with the mission states it publishes."""

    def __init__(self, stack: Stack, *places: tuple[float, float], hold_s: float = 0.0) -> None:
        self.stack = stack
        self.ada = Operator(stack, "ada")
        self._box = stack.ground.mailbox(MISSION)
        stack.operator = False
        stack.arm()
        if places:
            assert self.ada.upload(stops(*places, hold_s=hold_s)).reason == Reason.NONE

    @property
    def told(self) -> MissionStatus | None:
        newest = self._box.latest()
        return None if newest is None else newest[0]

    def until(self, state: MissionState, within_s: float = 60.0) -> float:
        return self.stack.until(
            lambda: self.told is not None and self.told.state == state, within_s
        )


def test_mission_runs_to_its_end_without_an_operator() -> None:
    with Stack("open") as stack:
        run = Watched(stack, (1.5, 2.0), (1.5, 1.0), (0.8, 1.0), hold_s=1.0)
        assert run.ada.command(Command.MISSION_START) == Reason.NONE
        for place in ((1.5, 2.0), (1.5, 1.0)):
            run.until(MissionState.HOLDING)
            stack.assert_near(*place)
            assert 0.9 <= run.until(MissionState.RUNNING) <= 1.1
        run.until(MissionState.DONE)
        stack.assert_near(0.8, 1.0)


def test_a_mission_is_paused_goes_on_jumps_and_is_aborted() -> None:
    with Stack("open") as stack:
        run = Watched(stack, (2.5, 2.0), (2.5, 1.0), (0.8, 1.0))
        run.ada.command(Command.MISSION_START)
        stack.until(stack.driving)
        assert run.ada.command(Command.DO_PAUSE_CONTINUE, 0) == Reason.NONE
        run.until(MissionState.PAUSED)
        stack.until(stack.standing, within_s=1.0)
        stack.forward(5.0)
        assert stack.standing()
        assert run.ada.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.NONE
        run.until(MissionState.RUNNING)
        stack.until(stack.driving)
        assert run.ada.command(Command.DO_SET_MISSION_CURRENT, 2) == Reason.NONE
        stack.until(lambda: run.told is not None and run.told.current == 2, within_s=1.0)
        stack.forward(1.0)
        assert run.ada.command(Command.SIDESTEP_ABORT_GOAL) == Reason.NONE
        run.until(MissionState.FAILED)
        assert run.told is not None
        assert run.told.reason == Reason.BY_OPERATOR
        stack.until(stack.standing, within_s=1.0)
        assert stack.state == Vehicle.ACTIVE


def test_failed_mission_carries_the_reason_of_its_goal() -> None:
    with Stack("open") as stack:
        run = Watched(stack, (2.5, 2.0))
        run.ada.command(Command.MISSION_START)
        stack.until(stack.driving)
        stack.inject("scan_stopped")
        run.until(MissionState.FAILED)
        assert run.told is not None
        assert run.told.reason == Reason.SCAN_LOST


def test_a_goal_and_a_mission_outside_of_the_fence_are_refused() -> None:
    with Stack("open") as stack:
        run = Watched(stack)
        start = stack.world.start
        x_m, y_m = start.x_m, start.y_m
        box = fence(
            (x_m - 0.5, y_m - 1), (x_m + 2, y_m - 1), (x_m + 2, y_m + 1), (x_m - 0.5, y_m + 1)
        )
        assert run.ada.upload(box).reason == Reason.NONE
        assert stack.goto(x_m + 2.5, y_m) == Reason.OUTSIDE_FENCE
        verdict = run.ada.upload(stops((x_m + 1, y_m), (x_m + 3, y_m)))
        assert (verdict.item, verdict.reason) == (1, Reason.OUTSIDE_FENCE)
        away = fence((x_m + 1, y_m), (x_m + 2, y_m), (x_m + 2, y_m + 1))
        assert run.ada.upload(away).reason == Reason.FENCE_LEAVES_ROBOT_OUT


def test_a_robot_that_leaves_its_fence_stops_there() -> None:
    with Stack("open") as stack:
        run = Watched(stack)
        x_m, y_m = stack.world.start.x_m, stack.world.start.y_m
        edge_m = x_m + 1.0
        run.ada.upload(
            fence((x_m - 1, y_m - 1), (edge_m, y_m - 1), (edge_m, y_m + 1), (x_m - 1, y_m + 1))
        )
        run.ada.beat()
        stack.forward(0.3)
        assert run.ada.manual() == Reason.NONE
        for _ in range(200):
            run.ada.beat()
            run.ada.steer(0.3)
            stack.forward(0.05)
            if stack.state == Vehicle.FAILSAFE:
                break
        assert stack.why == Reason.FENCE_BREACHED
        stack.forward(STOPPING_S)
        assert stack.standing()
        assert stack.truth.x_m - edge_m <= 0.10
        assert stack.arm() == Reason.FENCE_BREACHED
        run.ada.ask(MissionClearAll(mission_type=MissionType.FENCE), MISSION_SERVICE)
        stack.forward(0.1)
        assert stack.arm() == Reason.NONE


def test_the_robot_returns_to_its_start_along_its_own_trail() -> None:
    with Stack("u_trap") as stack:
        start = stack.world.start
        stack.arm()
        stack.goto_goal()
        stack.until(stack.reached)
        before = stack.truth
        assert stack.command(Command.NAV_RETURN_TO_LAUNCH) == Reason.NONE
        stack.operator = False
        stack.until(stack.reached)
        stack.assert_near(start.x_m, start.y_m, within_m=0.15)
        assert stack.truth.contact == 0
        assert before.x_m != stack.truth.x_m
        assert stack.goal_state == GoalState.REACHED
