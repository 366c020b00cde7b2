"""Several programs of one person, and two persons, on the real robot in this process."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator

import pytest

import sidestep
from sidestep import GoalState, Mode, Reason, Robot
from tests.support.bus.lively import Paced, dials
from tests.support.until import PATIENCE_S

pytestmark = pytest.mark.stack

ROUNDS = {"brief": 3, "usual": 5, "long": 100}


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Where a real robot listens; `config` is the person who connects."""
    with Paced() as stack, stack.going():
        dials(stack, monkeypatch)
        yield stack._hub


async def drives(robot: Robot) -> "asyncio.Task[sidestep.GoalEnded | sidestep.Refused]":
    """Begin a goal far ahead and wait until the robot drives."""
    pose = await anext(robot.odometry())
    going = asyncio.create_task(robot.goto(pose.x_m + 2.0, pose.y_m))
    await shown(robot, GoalState.DRIVING)
    return going


async def shown(robot: Robot, state: GoalState) -> None:
    async for status in robot.status():
        if status.goal == state and status.mode == Mode.GUIDED:
            return


def run(program: Callable[[], Awaitable[None]], rounds: int = 1) -> None:
    async def limited() -> None:
        async with asyncio.timeout(rounds * PATIENCE_S):
            await program()

    asyncio.run(limited())


def test_what_stops_needs_no_lease(hub: str) -> None:
    async def program() -> None:
        async with (
            sidestep.connect(hub, config="ada", name="ada") as ada,
            sidestep.connect(hub, config="ben", name="ben") as ben,
        ):
            for stop in (ben.hold, ben.abort, ben.disarm):
                going = await drives(ada)
                refused = await ben.arm()
                assert isinstance(refused, sidestep.Refused)
                assert (refused.reason, refused.holder) == (Reason.LEASE_HELD, "ada")
                assert "(await robot.lease.seize())" in refused.text
                assert (await stop()).ok
                going.cancel()
                await asyncio.gather(going, return_exceptions=True)
            assert (await ben.lease.seize()).ok
            assert (await ben.arm()).ok

    run(program)


def test_second_program_of_a_person_may_command_at_once(
    hub: str, pytestconfig: pytest.Config
) -> None:
    rounds = ROUNDS[pytestconfig.getoption("--examples")]

    async def program() -> None:
        async with sidestep.connect(hub, config="ada", name="first") as first:
            assert (await first.arm()).ok
            for _ in range(rounds):
                async with sidestep.connect(hub, config="ada", name="second") as second:
                    assert (await second.arm()).ok
                assert first.holds_lease
            assert (await first.lease.show()).ours

    run(program, rounds)


def test_drive_goes_on_when_another_program_of_the_person_leaves(hub: str) -> None:
    async def program() -> None:
        async with sidestep.connect(hub, config="ada") as first:
            going = await drives(first)
            async with sidestep.connect(hub, config="ada") as second:
                assert (await second.lease.take()).ok
            await asyncio.sleep(0.5)
            assert not going.done()
            assert first.holds_lease
            going.cancel()
            await asyncio.gather(going, return_exceptions=True)

    run(program)


def test_goal_of_the_second_program_replaces_that_of_the_first(hub: str) -> None:
    async def program() -> None:
        async with (
            sidestep.connect(hub, config="ada", name="first") as first,
            sidestep.connect(hub, config="ada", name="second") as second,
        ):
            going = await drives(first)
            pose = await anext(second.odometry())
            new = await second.goto(pose.x_m, pose.y_m)
            assert new.ok, new.text
            old = await going
        assert isinstance(old, sidestep.GoalEnded)
        place = f"{pose.x_m:z.1f} {pose.y_m:z.1f}"
        assert (old.outcome, old.reason) == ("replaced", f"by the goal {place} of second")

    run(program)


def test_mission_that_is_driven_by_hand_is_taken_over(hub: str) -> None:
    async def program() -> None:
        async with sidestep.connect(hub, config="ada") as robot:
            pose = await anext(robot.odometry())
            far = sidestep.Waypoint(x_m=pose.x_m + 2.0, y_m=pose.y_m)
            sidestep.agreed(await robot.mission.upload(sidestep.Mission(waypoints=(far,))))
            running = asyncio.create_task(robot.mission.run())
            async for event in robot.events():
                if isinstance(event, sidestep.MissionChanged) and event.state == RUNNING:
                    break
            assert (await robot.drive(0.1, 0.0, for_s=0.5)).ok
            ended = await running
        assert isinstance(ended, sidestep.MissionEnded)
        assert (ended.ok, ended.text) == (False, "taken over, item 1 of 1: driven by hand")

    run(program)


RUNNING = sidestep.MissionState.RUNNING
