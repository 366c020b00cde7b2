"""A cancelled goal, drive or mission ends itself, and not what the same person began after it."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from threading import Timer

import pytest

import sidestep
from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest, GoalRequest
from sidestep import GoalState, Mode, Reason, Robot, Vehicle
from tests.support.bus.lively import Paced, dials
from tests.support.bus.robots import PlayedRobot
from tests.support.until import PATIENCE_S

Stage = tuple[PlayedRobot, str]
Case = Callable[[Robot, Robot], Awaitable[sidestep.GoalEnded | sidestep.DriveEnded]]

HERE = (1.0, 1.0, 0.0)
FAR_M = 2.0
NEAR_S = 0.08
ROUNDS = {"brief": 3, "usual": 5, "long": 100}


@pytest.fixture
def stage(stage: Stage) -> Iterator[Stage]:
    """A robot that is soon at a goal where it stands, and never at another one."""
    played, _ = stage
    played.pose = HERE
    timers: list[Timer] = []

    def near() -> None:
        goal = played.asked[-1]
        if isinstance(goal, GoalRequest) and goal.x_mm == 1000 * HERE[0]:
            timers.append(Timer(NEAR_S, arrive, [goal.request_id]))
            timers[-1].start()

    def arrive(goal_id: int) -> None:
        if played.goal_id == goal_id and played.goal == GoalState.DRIVING:
            played.goal = GoalState.REACHED

    played.after_goal = near
    yield stage
    for timer in timers:
        timer.cancel()


@asynccontextmanager
async def two_clients(endpoint: str) -> AsyncIterator[tuple[Robot, Robot]]:
    """Two programs of one person."""
    async with sidestep.connect(endpoint) as one, sidestep.connect(endpoint) as other:
        yield one, other


async def shown(robot: Robot) -> None:
    """Wait until the robot's status shows that it drives to a goal."""
    async for status in robot.status():
        if status.goal == GoalState.DRIVING and status.mode == Mode.GUIDED:
            return


async def here(robot: Robot) -> tuple[float, float]:
    pose = await anext(robot.odometry())
    return pose.x_m, pose.y_m


async def far(robot: Robot) -> tuple[float, float]:
    x_m, y_m = await here(robot)
    return x_m + FAR_M, y_m


async def far_goal(robot: Robot) -> "asyncio.Task[sidestep.GoalEnded | sidestep.Refused]":
    going = asyncio.create_task(robot.goto(*await far(robot)))
    await shown(robot)
    return going


async def driving(robot: Robot) -> "asyncio.Task[sidestep.DriveEnded | sidestep.Refused]":
    driven = asyncio.create_task(robot.drive(0.1, 0.0))
    async for status in robot.status():
        if status.mode == Mode.MANUAL and status.vehicle == Vehicle.ACTIVE:
            break
    return driven


async def ended(old: "asyncio.Task[object]") -> None:
    await asyncio.gather(old, return_exceptions=True)
    assert old.cancelled(), old


async def goal_after_goal(robot: Robot, _: Robot) -> sidestep.GoalEnded:
    old = await far_goal(robot)
    old.cancel()
    return await new_goal(robot, old)


async def goal_after_the_end_of_a_goal(robot: Robot, _: Robot) -> sidestep.GoalEnded:
    old = await far_goal(robot)
    old.cancel()
    await ended(old)
    return await new_goal(robot)


async def goal_while_a_time_limit_ends(robot: Robot, _: Robot) -> sidestep.GoalEnded:
    place = await far(robot)

    async def limited() -> None:
        async with asyncio.timeout(0.3):
            await robot.goto(*place)

    old = asyncio.create_task(limited())
    await asyncio.sleep(0.28)
    new = await new_goal(robot)
    await asyncio.gather(old, return_exceptions=True)
    return new


async def goal_after_a_drive(robot: Robot, _: Robot) -> sidestep.GoalEnded:
    old = await driving(robot)
    old.cancel()
    return await new_goal(robot, old)


async def drive_after_a_drive(robot: Robot, _: Robot) -> sidestep.DriveEnded:
    old = await driving(robot)
    old.cancel()
    new = await robot.drive(0.1, 0.0, for_s=0.5)
    await ended(old)
    assert isinstance(new, sidestep.DriveEnded), new
    return new


async def goal_of_another_client(robot: Robot, other: Robot) -> sidestep.GoalEnded:
    old = await far_goal(robot)
    new = asyncio.create_task(new_goal(other))
    old.cancel()
    await asyncio.gather(old, return_exceptions=True)
    return await new


async def goal_after_a_mission(robot: Robot, _: Robot) -> sidestep.GoalEnded:
    x_m, y_m = await far(robot)
    mission = sidestep.Mission(waypoints=(sidestep.Waypoint(x_m=x_m, y_m=y_m),))
    sidestep.agreed(await robot.mission.upload(mission))
    old = asyncio.create_task(robot.mission.run())
    await asyncio.sleep(0.3)
    old.cancel()
    return await new_goal(robot, old)


async def new_goal(robot: Robot, old: "asyncio.Task[object] | None" = None) -> sidestep.GoalEnded:
    new = await robot.goto(*await here(robot))
    if old is not None:
        await ended(old)
    assert isinstance(new, sidestep.GoalEnded), new
    return new


CASES: list[Case] = [
    goal_after_goal,
    goal_after_the_end_of_a_goal,
    goal_while_a_time_limit_ends,
    goal_after_a_drive,
    drive_after_a_drive,
    goal_of_another_client,
    goal_after_a_mission,
]


async def lost_in(endpoint: str, case: Case, rounds: int) -> list[str]:
    """Return how the new goals and drives ended that did not come to their own end."""
    lost: list[str] = []
    async with asyncio.timeout(rounds * PATIENCE_S), two_clients(endpoint) as (one, other):
        for _ in range(rounds):
            new = await case(one, other)
            if not new.ok:
                lost.append(new.text)
    return lost


@pytest.mark.parametrize("case", CASES)
def test_cancellation_ends_nothing_else(
    stage: Stage, case: Case, pytestconfig: pytest.Config
) -> None:
    rounds = ROUNDS[pytestconfig.getoption("--examples")]
    assert asyncio.run(lost_in(stage[1], case, rounds)) == []
    cleaned = [one for one in stage[0].asked if isinstance(one, CommandRequest) and ends(one)]
    assert cleaned
    assert all(one.ends_id for one in cleaned), "each names what it ends"


@pytest.mark.stack
@pytest.mark.parametrize("case", CASES)
def test_cancellation_ends_nothing_else_on_the_real_robot(
    case: Case, monkeypatch: pytest.MonkeyPatch, pytestconfig: pytest.Config
) -> None:
    rounds = ROUNDS[pytestconfig.getoption("--examples")]
    with Paced() as stack, stack.going():
        dials(stack, monkeypatch)
        assert asyncio.run(lost_in(stack._hub, case, rounds)) == []


def ends(request: CommandRequest) -> bool:
    if request.command == Command.DO_SET_MODE:
        return request.param2 == Mode.HOLD
    return request.command in (Command.SIDESTEP_ABORT_GOAL, Command.DO_PAUSE_CONTINUE)


def test_goal_that_another_client_sets_replaces_the_old_one(stage: Stage) -> None:
    async def program() -> sidestep.GoalEnded | sidestep.Refused:
        async with two_clients(stage[1]) as (one, other):
            old = await far_goal(one)
            assert (await new_goal(other)).ok
            return await old

    outcome = asyncio.run(program())
    assert isinstance(outcome, sidestep.GoalEnded)
    assert (outcome.ok, outcome.outcome) == (False, "replaced")
    assert Command.SIDESTEP_ABORT_GOAL not in stage[0].commands


def test_unanswered_abort_ends_the_heartbeat(stage: Stage) -> None:
    """A robot without the heartbeat of the program that drives it stops by itself."""
    played, endpoint = stage

    async def program() -> None:
        async with sidestep.connect(endpoint) as robot:
            old = await far_goal(robot)
            played.answers = [None] * 50
            old.cancel()
            await ended(old)
            assert not robot.holds_lease
            played.answers = []
            assert (await new_goal(robot)).ok

    asyncio.run(program())


def test_end_of_the_context_ends_its_goal_and_waits_for_that(stage: Stage) -> None:
    played, endpoint = stage

    async def program() -> None:
        async with sidestep.connect(endpoint) as robot:
            old = await far_goal(robot)
        assert played.commands[-1] == Command.SIDESTEP_ABORT_GOAL
        with pytest.raises(sidestep.ClosedError, match="this client is closed: use the robot"):
            await old

    asyncio.run(program())
    assert played.goal == GoalState.ABORTED
    assert played.desk.held is None


@pytest.mark.parametrize(
    "call",
    [
        lambda robot: robot.goto(1.0, 1.0),
        lambda robot: robot.drive(0.1, 0.0, for_s=1.0),
        lambda robot: robot.hold(),
        lambda robot: robot.arm(),
        lambda robot: robot.mission.run(),
        lambda robot: robot.parameters.list(),
        lambda robot: robot.lease.take(),
        lambda robot: robot.emergency_stop(),
        lambda robot: robot.emergency_stop_all(),
        lambda robot: anext(robot.status()),
        lambda robot: anext(robot.events()),
    ],
)
def test_closed_client_says_so_in_one_word(
    stage: Stage, call: Callable[[Robot], Awaitable[object]]
) -> None:
    async def program() -> None:
        async with sidestep.connect(stage[1]) as robot:
            assert (await robot.lease.take()).ok
        with pytest.raises(sidestep.ClosedError, match="this client is closed: use the robot"):
            await call(robot)
        assert repr(robot) == f"<robot r1 at {stage[1]}: closed>"

    asyncio.run(program())


def test_lease_that_was_taken_in_vain_is_left(stage: Stage) -> None:
    """The request goes on in its thread when it is cancelled."""
    played, endpoint = stage

    async def program() -> None:
        async with sidestep.connect(endpoint) as robot:
            taking = asyncio.create_task(robot.lease.take())
            await asyncio.sleep(0)
            taking.cancel()
            await asyncio.gather(taking, return_exceptions=True)

    asyncio.run(program())
    assert played.desk.held is None


def test_old_goal_that_is_still_being_sent_does_not_overtake_the_next_drive(stage: Stage) -> None:
    played, endpoint = stage

    async def program() -> None:
        async with sidestep.connect(endpoint) as robot:
            assert (await robot.lease.take()).ok
            played.answers = [None, Reason.NONE]
            first = asyncio.create_task(robot.goto(3.0, 1.0))
            while not played.asked:
                await asyncio.sleep(0.01)
            first.cancel()
            assert (await robot.return_home()).ok
            await ended(first)

    asyncio.run(program())
    goal, home = Command.DO_REPOSITION, Command.NAV_RETURN_TO_LAUNCH
    begun = [command for command in played.commands if command in (goal, home)]
    assert begun == [goal, goal, home]


def test_goal_that_waits_in_turn_is_not_sent_when_it_is_cancelled(stage: Stage) -> None:
    played, endpoint = stage

    async def program() -> None:
        async with sidestep.connect(endpoint) as robot:
            assert (await robot.lease.take()).ok
            played.answers = [None, Reason.NONE]
            first = asyncio.create_task(robot.goto(3.0, 1.0))
            while not played.asked:
                await asyncio.sleep(0.01)
            second = asyncio.create_task(robot.goto(2.0, 2.0))
            await asyncio.sleep(0.05)
            second.cancel()
            await ended(second)
            await shown(robot)
            first.cancel()
            await ended(first)

    asyncio.run(program())
    goals = {one.x_mm for one in played.asked if isinstance(one, GoalRequest)}
    assert goals == {3000}
