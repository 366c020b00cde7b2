"""The asyncio client over a real bus: outcomes, streams, the lease, and cancellation."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager
from math import nan
from threading import Timer
from threading import enumerate as enumerate_threads
from typing import Any

import pytest

import sidestep
from checks.harness.until import PATIENCE_S
from ground.client.outcomes import Answer
from protocol.topics import STATUS
from protocol.wire.enums import Command, LeaseAction, MissionState
from protocol.wire.messages import CommandRequest, GoalRequest
from sidestep import GoalState, Mode, Reason, Robot, Vehicle
from tests.support.played_robot import PlayedRobot
from tests.support.stacks import Paced, dials

Stage = tuple[PlayedRobot, str]

UNSEEN_S = 0.5
"""Time after which a stop is given up that no status shows."""


@asynccontextmanager
async def connected(stage: Stage) -> AsyncIterator[sidestep.Robot]:
    """Open a client of the played robot."""
    async with asyncio.timeout(PATIENCE_S), sidestep.connect(stage[1], name="anna") as robot:
        yield robot


def driven(stage: Stage, story: Callable[[sidestep.Robot], Coroutine[Any, Any, Any]]) -> Any:
    """Run a program of the API against the played robot."""

    async def program() -> Any:
        async with connected(stage) as robot:
            return await story(robot)

    return asyncio.run(program())


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.01)


def leases(robot: PlayedRobot) -> list[int]:
    return [request.action for request in robot.desk.actions]


def test_goal_is_reached_and_the_lease_given_back(stage: Stage) -> None:
    played, _ = stage
    played.reach_goals()
    outcome = driven(stage, lambda robot: robot.goto(1.0, 2.0, 90.0))
    assert isinstance(outcome, sidestep.GoalEnded)
    assert (outcome.ok, outcome.outcome, outcome.distance_m) == (True, "reached", 1.0)
    (goal,) = [asked for asked in played.asked if isinstance(asked, GoalRequest)]
    assert (goal.x_mm, goal.y_mm, goal.mode) == (1000, 2000, Mode.GUIDED)
    assert leases(played) == [LeaseAction.TAKE, LeaseAction.LEAVE]
    assert played.beats > 0


def test_goal_that_cannot_be_is_refused_before_anything_is_sent(stage: Stage) -> None:
    with pytest.raises(sidestep.UserError, match="heading 900 deg is out of range"):
        driven(stage, lambda robot: robot.goto(1.0, 2.0, 900.0))
    assert (stage[0].asked, leases(stage[0])) == ([], [])


def test_refusal_is_a_value_that_can_be_raised(stage: Stage) -> None:
    stage[0].answers = [Reason.OUTSIDE_FENCE]
    outcome = driven(stage, lambda robot: robot.goto(1.0, 2.0))
    assert isinstance(outcome, sidestep.Refused)
    assert outcome.reason == Reason.OUTSIDE_FENCE
    with pytest.raises(sidestep.RefusedError, match=r"\(await robot.fence.get\(\)\)$"):
        sidestep.agreed(outcome)


def test_other_operator_is_named_and_nothing_is_sent(stage: Stage) -> None:
    played, _ = stage
    played.desk.held = ("ben/beef", "ben")
    outcome = driven(stage, lambda robot: robot.goto(1.0, 2.0))
    assert isinstance(outcome, sidestep.Refused)
    assert outcome.holder == "ben"
    assert outcome.text.endswith("commands the robot: ben (await robot.lease.seize())")
    assert played.asked == []


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda robot: robot.goto("a", 2), "x 'a' is not a number: give it in m"),
        (lambda robot: robot.goto(1, None), "y None is not a number"),
        (
            lambda robot: robot.goto(1, 2, "north"),
            "heading 'north' is not a number: give it in deg",
        ),
        (lambda robot: robot.goto(1, 2, timeout_s="9"), "timeout '9' is not a number"),
        (lambda robot: robot.drive("fast", 0), "speed 'fast' is not a number: give it in m/s"),
        (lambda robot: robot.drive(0, 0, for_s=-1.0), "time -1 s is out of range"),
        (lambda robot: robot.parameters.set("d_obs_m", "2"), "d_obs_m '2' is not a number"),
        (
            lambda robot: robot.parameters.set("d_obs_m", nan),
            r"^d_obs_m nan is out of range: -3.4e.38 to 3.4e.38$",
        ),
        (lambda robot: robot.set_navigator("bugs"), "there is no navigator 'bugs': use one of bug"),
        (lambda robot: robot.set_navigator("bug", "up"), "there is no side 'up': use left, right"),
        (lambda robot: robot.set_mode("fast"), "there is no mode 'fast': use one of"),
    ],
)
def test_value_that_cannot_be_is_one_named_error(
    stage: Stage, call: Callable[[sidestep.Robot], Any], words: str
) -> None:
    with pytest.raises(sidestep.UserError, match=words):
        driven(stage, call)
    assert (stage[0].asked, leases(stage[0])) == ([], [])


async def test_navigator_and_mode_have_names(stage: Stage) -> None:
    async with connected(stage) as robot:
        assert (await robot.set_navigator("bug", "right")).ok
        assert (await robot.set_navigator(sidestep.Navigator.BUG, -1)).ok
        assert (await robot.set_mode("hold")).ok
    first, second, mode = (one for one in stage[0].asked if isinstance(one, CommandRequest))
    assert (first.param1, first.param2) == (second.param1, second.param2) == (1.0, -1.0)
    assert mode.param2 == Mode.HOLD


def test_robot_shows_itself_in_one_line(stage: Stage) -> None:
    async def story(robot: sidestep.Robot) -> str:
        await until(lambda: robot.streams.latest(STATUS) is not None)
        return repr(robot)

    shown = driven(stage, story)
    assert shown == f"<robot r1 at {stage[1]}: STANDBY GUIDED NONE, without its lease>"


def test_other_robot_is_named_in_the_words_of_python(stage: Stage) -> None:
    async def program() -> None:
        async with sidestep.connect(stage[1], robot="r2") as robot:
            await robot.hold()

    with pytest.raises(sidestep.UnansweredError) as caught:
        asyncio.run(program())
    assert "only r1: name one that is there, as in sidestep.connect(robot='r1')" in str(
        caught.value
    )
    assert "--id" not in str(caught.value)


async def test_cancelled_goal_is_aborted_before_the_error_goes_on(stage: Stage) -> None:
    played, _ = stage
    async with connected(stage) as robot:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.5):
                await robot.goto(1.0, 2.0)
        assert played.commands[-1] == Command.SIDESTEP_ABORT_GOAL
    assert leases(played) == [LeaseAction.TAKE, LeaseAction.LEAVE]


async def test_goal_cancelled_while_it_is_sent_is_aborted_after_it(stage: Stage) -> None:
    played, _ = stage
    played.answers = [None, Reason.NONE]
    async with connected(stage) as robot:
        assert (await robot.lease.take()).ok
        going = asyncio.ensure_future(robot.goto(1.0, 2.0))
        await until(lambda: bool(played.asked))
        for _ in range(3):
            going.cancel()
            await asyncio.sleep(0.01)
        with pytest.raises(asyncio.CancelledError):
            await going
    goal = Command.DO_REPOSITION
    assert played.commands == [goal, goal, Command.SIDESTEP_ABORT_GOAL]


def test_cancelled_drive_stops_and_holds(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> None:
        driving = asyncio.ensure_future(robot.drive(0.2, -30.0))
        await until(lambda: len(played.driven) > 3 and played.driven[-1].speed_mm_s == 200)
        driving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await driving

    driven(stage, story)
    assert played.driven[-1].speed_mm_s == 0
    assert played.mode is Mode.HOLD
    done = driven(stage, lambda robot: robot.drive(0.1, 0.0, for_s=0.2))
    assert (done.ok, done.text) == (True, "done, the robot holds")


def test_stop_waits_for_no_request(stage: Stage) -> None:
    played, _ = stage
    played.answers = [None] * 100

    async def story(robot: sidestep.Robot) -> sidestep.Stopped:
        stuck = [asyncio.ensure_future(robot.hold()) for _ in range(8)]
        await until(lambda: len(played.asked) >= 4)
        stopped = await robot.emergency_stop()
        assert not any(one.done() for one in stuck)
        await asyncio.gather(*stuck, return_exceptions=True)
        return stopped

    stopped = asyncio.run(with_robot(stage, story))
    assert stopped.ok
    assert played.vehicle is Vehicle.EMERGENCY_STOP


async def stop_and_wait(robot: sidestep.Robot) -> None:
    await robot.emergency_stop(timeout_s=UNSEEN_S)


async def stop_and_cancel(robot: sidestep.Robot) -> None:
    stopping = asyncio.ensure_future(robot.emergency_stop(timeout_s=UNSEEN_S))
    await asyncio.sleep(0)
    stopping.cancel()
    with pytest.raises(asyncio.CancelledError):
        await stopping


async def stop_all(robot: sidestep.Robot) -> None:
    await robot.emergency_stop_all(timeout_s=UNSEEN_S)


async def stop_all_and_cancel(robot: sidestep.Robot) -> None:
    stopping = asyncio.ensure_future(robot.emergency_stop_all(timeout_s=UNSEEN_S))
    await asyncio.sleep(0)
    stopping.cancel()
    with pytest.raises(asyncio.CancelledError):
        await stopping


STOPS = [stop_and_wait, stop_and_cancel, stop_all, stop_all_and_cancel]


@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("is_shown", [False, True])
def test_program_may_release_each_stop_of_its_own(
    stage: Stage, stop: Callable[[sidestep.Robot], Awaitable[None]], is_shown: bool
) -> None:
    """The newest status may still be one from before the stop."""
    played, _ = stage
    played.stale = None if is_shown else played.status()

    async def story(robot: sidestep.Robot) -> Answer:
        await until(lambda: robot.streams.latest(STATUS) is not None)
        await stop(robot)
        return await robot.clear_emergency_stop()

    answer = driven(stage, story)
    assert answer.ok, answer.text
    assert played.stop_id != 0
    assert played.vehicle is Vehicle.STANDBY, "nor does a repetition stop it again"


@pytest.mark.parametrize("stop", STOPS)
def test_program_does_not_release_a_later_stop_of_another(
    stage: Stage, stop: Callable[[sidestep.Robot], Awaitable[None]]
) -> None:
    played, _ = stage
    played.stale = played.status()

    async def story(robot: sidestep.Robot) -> Answer:
        await until(lambda: robot.streams.latest(STATUS) is not None)
        await stop(robot)
        await until(lambda: played.vehicle is Vehicle.EMERGENCY_STOP)
        played.deaf = True
        await until(lambda: all("emergency stop" not in one.name for one in enumerate_threads()))
        played.stop_id = 99
        return await robot.clear_emergency_stop()

    answer = driven(stage, story)
    assert isinstance(answer, sidestep.Refused)
    assert answer.reason == Reason.NEWER_STOP
    assert played.vehicle is Vehicle.EMERGENCY_STOP


async def with_robot(stage: Stage, story: Callable[[sidestep.Robot], Awaitable[Any]]) -> Any:
    """Run a story with a robot, without a time limit."""
    async with sidestep.connect(stage[1]) as robot:
        return await story(robot)


async def test_cancelled_stop_is_still_sent(stage: Stage) -> None:
    played, _ = stage
    played.deaf = True
    async with connected(stage) as robot:
        stopping = asyncio.ensure_future(robot.emergency_stop(timeout_s=PATIENCE_S))
        await asyncio.sleep(0)
        stopping.cancel()
        await asyncio.sleep(0.2)
        assert played.vehicle is not Vehicle.EMERGENCY_STOP
        played.deaf = False
        await until(lambda: played.vehicle is Vehicle.EMERGENCY_STOP)


async def test_blocked_loop_sends_no_heartbeat(stage: Stage) -> None:
    played, _ = stage
    async with connected(stage) as robot:
        assert (await robot.lease.take()).ok
        await until(lambda: played.beats > 3)
        loop_is_free = asyncio.Event()
        before = played.beats
        began_ns = robot.clock.now_ns()
        robot.clock.sleep_until(began_ns + 600_000_000)  # blocks the loop
        assert played.beats <= before + 1
        loop_is_free.set()
        await until(lambda: played.beats > before + 2)


async def test_lease_that_was_seized_ends_the_heartbeat(stage: Stage) -> None:
    played, _ = stage
    async with connected(stage) as robot:
        assert (await robot.lease.take()).ok
        assert (await robot.lease.show()).ours
        played.desk.held = ("ben/beef", "ben")
        await until(lambda: not robot.holds_lease)
    assert leases(played) == [LeaseAction.TAKE], "what is another operator's is not given back"


async def test_lease_that_the_robot_took_back_is_taken_for_the_next_goal(stage: Stage) -> None:
    """Its status may still be on the way when the next operation begins."""
    played, _ = stage
    played.reach_goals()
    async with connected(stage) as robot:
        assert (await robot.goto(1.0, 2.0)).ok
        played.desk.held = None
        assert robot.holds_lease
        assert (await robot.goto(1.0, 2.0)).ok
        assert played.desk.held is not None


async def test_telemetry_is_iterated_and_what_is_not_read_gives_way(stage: Stage) -> None:
    async with connected(stage) as robot:
        short = robot.status(size=3)
        stamps = []
        async for status in robot.status():
            stamps.append(status.time_ns)
            if len(stamps) == 20:
                break
        assert stamps == sorted(stamps)
        assert short.dropped > 0
        await short.aclose()
        assert len([status async for status in short]) == 3


def test_events_report_changes(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> list[sidestep.Event]:
        found: list[sidestep.Event] = []
        events = robot.events()
        going = asyncio.ensure_future(robot.goto(1.0, 2.0))
        async for event in events:
            found.append(event)
            if isinstance(event, sidestep.GoalChanged):
                if event.state == GoalState.DRIVING:
                    played.goal = GoalState.REACHED
                if event.state == GoalState.REACHED:
                    break
        assert (await going).ok
        return found

    found = driven(stage, story)
    assert sidestep.VehicleChanged(Vehicle.STANDBY, "") in found
    assert any(isinstance(event, sidestep.LeaseChanged) and event.ours for event in found)


async def test_parameters_are_typed_and_checked(stage: Stage) -> None:
    async with connected(stage) as robot:
        found = await robot.parameters.get("d_obs_m")
        assert (found.value, found.unit, found.maximum) == (0.4, "m", 3.0)
        assert [one.name for one in await robot.parameters.changed()] == ["d_obs_m"]
        changed = await robot.parameters.set("d_obs_m", 0.5)
        assert changed.ok
        with pytest.raises(sidestep.UserError, match=r"no such parameter.*parameters.list\(\)"):
            await robot.parameters.set("zzz", 1.0)
        with pytest.raises(sidestep.UserError, match=r"no parameter.*robot.parameters.list\(\)"):
            await robot.parameters.get("zzz")
        with pytest.raises(sidestep.UserError, match=r"no parameter 'zzz'.*parameters.list\(\)"):
            await robot.parameters.reset("zzz")


MISSION = sidestep.Mission(waypoints=(sidestep.Waypoint(x_m=1.0, y_m=2.0),))


async def test_mission_is_given_driven_and_fetched(stage: Stage) -> None:
    played, _ = stage
    async with connected(stage) as robot:
        assert await robot.mission.fetch() is None
        assert (await robot.mission.upload(MISSION)).ok
        assert await robot.mission.fetch() == MISSION
        running = asyncio.ensure_future(robot.mission.run())
        await until(lambda: bool(played.asked))
        played.desk.status = MissionState.RUNNING
        async for event in robot.events():
            if isinstance(event, sidestep.MissionChanged) and event.state == MissionState.RUNNING:
                break
        played.desk.status = MissionState.DONE
        ended = await running
        assert isinstance(ended, sidestep.MissionEnded)
        assert (ended.ok, ended.status.state) == (True, MissionState.DONE)


async def test_mission_that_is_cancelled_pauses(stage: Stage) -> None:
    played, _ = stage
    async with connected(stage) as robot:
        assert (await robot.mission.upload(MISSION)).ok
        played.desk.status = MissionState.RUNNING
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.4):
                await robot.mission.run()
    last = played.asked[-1]
    assert isinstance(last, CommandRequest)
    assert (last.command, last.param1) == (Command.DO_PAUSE_CONTINUE, 0.0)


async def test_fence_is_set_and_read(stage: Stage) -> None:
    circle = sidestep.Circle(x_m=0.0, y_m=0.0, radius_m=5.0)
    async with connected(stage) as robot:
        assert await robot.fence.get() is None
        assert (await robot.fence.set(circle)).ok
        assert await robot.fence.get() == circle
        assert (await robot.fence.clear()).ok


@pytest.mark.parametrize("what", ["endpoint", "robot", "config", "name"])
async def test_argument_of_another_type_is_refused(what: str) -> None:
    wrong: dict[str, Any] = {what: 5}
    with pytest.raises(sidestep.UserError, match=f"^{what} = 5: give "):
        await sidestep.connect(**wrong).__aenter__()


def test_endpoint_without_a_robot_is_unanswered() -> None:
    async def program() -> None:
        async with sidestep.connect("tcp/127.0.0.1:9"):
            raise AssertionError("nothing listens there")

    with pytest.raises(
        sidestep.UnansweredError, match=r"no robot and no router.*`sidestep up`"
    ) as it:
        asyncio.run(program())
    assert it.value.__suppress_context__, "nor is what the bus said shown again"
    frames = [
        entry
        for entry in it.traceback
        if "sidestep" in str(entry.path) or "ground" in str(entry.path)
    ]
    assert len(frames) <= 2


Case = Callable[[Robot, Robot], Awaitable[sidestep.GoalEnded | sidestep.DriveEnded]]

HERE = (1.0, 1.0, 0.0)
FAR_M = 2.0
NEAR_S = 0.08
ROUNDS = {"brief": 3, "usual": 5, "long": 100}


@pytest.fixture
def cancelled_stage(stage: Stage) -> Iterator[Stage]:
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
    cancelled_stage: Stage, case: Case, pytestconfig: pytest.Config
) -> None:
    rounds = ROUNDS[pytestconfig.getoption("--examples")]
    assert asyncio.run(lost_in(cancelled_stage[1], case, rounds)) == []
    cleaned = [
        one for one in cancelled_stage[0].asked if isinstance(one, CommandRequest) and ends(one)
    ]
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


def test_goal_that_another_client_sets_replaces_the_old_one(cancelled_stage: Stage) -> None:
    async def program() -> sidestep.GoalEnded | sidestep.Refused:
        async with two_clients(cancelled_stage[1]) as (one, other):
            old = await far_goal(one)
            assert (await new_goal(other)).ok
            return await old

    outcome = asyncio.run(program())
    assert isinstance(outcome, sidestep.GoalEnded)
    assert (outcome.ok, outcome.outcome) == (False, "replaced")
    assert Command.SIDESTEP_ABORT_GOAL not in cancelled_stage[0].commands


async def test_unanswered_abort_ends_the_heartbeat(cancelled_stage: Stage) -> None:
    """A robot without the heartbeat of the program that drives it stops by itself."""
    played, endpoint = cancelled_stage
    async with sidestep.connect(endpoint) as robot:
        old = await far_goal(robot)
        played.answers = [None] * 50
        old.cancel()
        await ended(old)
        assert not robot.holds_lease
        played.answers = []
        assert (await new_goal(robot)).ok


async def test_end_of_the_context_ends_its_goal_and_waits_for_that(cancelled_stage: Stage) -> None:
    played, endpoint = cancelled_stage
    async with sidestep.connect(endpoint) as robot:
        old = await far_goal(robot)
    assert played.commands[-1] == Command.SIDESTEP_ABORT_GOAL
    with pytest.raises(sidestep.ClosedError, match="this client is closed: use the robot"):
        await old
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
async def test_closed_client_says_so_in_one_word(
    cancelled_stage: Stage, call: Callable[[Robot], Awaitable[object]]
) -> None:
    async with sidestep.connect(cancelled_stage[1]) as robot:
        assert (await robot.lease.take()).ok
    with pytest.raises(sidestep.ClosedError, match="this client is closed: use the robot"):
        await call(robot)
    assert repr(robot) == f"<robot r1 at {cancelled_stage[1]}: closed>"


async def test_lease_that_was_taken_in_vain_is_left(cancelled_stage: Stage) -> None:
    """The request goes on in its thread when it is cancelled."""
    played, endpoint = cancelled_stage
    async with sidestep.connect(endpoint) as robot:
        taking = asyncio.create_task(robot.lease.take())
        await asyncio.sleep(0)
        taking.cancel()
        await asyncio.gather(taking, return_exceptions=True)
    assert played.desk.held is None


async def test_old_goal_that_is_still_being_sent_does_not_overtake_the_next_drive(
    cancelled_stage: Stage,
) -> None:
    played, endpoint = cancelled_stage
    async with sidestep.connect(endpoint) as robot:
        assert (await robot.lease.take()).ok
        played.answers = [None, Reason.NONE]
        first = asyncio.create_task(robot.goto(3.0, 1.0))
        while not played.asked:
            await asyncio.sleep(0.01)
        first.cancel()
        assert (await robot.return_home()).ok
        await ended(first)
    goal, home = Command.DO_REPOSITION, Command.NAV_RETURN_TO_LAUNCH
    begun = [command for command in played.commands if command in (goal, home)]
    assert begun == [goal, goal, home]


async def test_goal_that_waits_in_turn_is_not_sent_when_it_is_cancelled(
    cancelled_stage: Stage,
) -> None:
    played, endpoint = cancelled_stage
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
    goals = {one.x_mm for one in played.asked if isinstance(one, GoalRequest)}
    assert goals == {3000}
