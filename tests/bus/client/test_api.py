"""The asyncio client over a real bus: outcomes, streams, the lease, and cancellation that stops."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from threading import enumerate as enumerate_threads
from typing import Any

import pytest

import sidestep
from ground.client.results import Answer
from protocol.topics import STATUS
from protocol.wire.enums import Command, LeaseAction, MissionState
from protocol.wire.messages import CommandRequest, GoalRequest
from sidestep import GoalState, Mode, Reason, Vehicle
from tests.support.bus.robots import PlayedRobot
from tests.support.until import PATIENCE_S

Stage = tuple[PlayedRobot, str]

UNSEEN_S = 0.5
"""Time after which a stop is given up that no status shows."""


def driven(stage: Stage, story: Callable[[sidestep.Robot], Coroutine[Any, Any, Any]]) -> Any:
    """Run a program of the API against the played robot."""

    async def program() -> Any:
        async with asyncio.timeout(PATIENCE_S), sidestep.connect(stage[1], name="anna") as robot:
            return await story(robot)

    return asyncio.run(program())


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.01)


def leases(robot: PlayedRobot) -> list[int]:
    return [request.action for request in robot.desk.actions]


def arrives(robot: PlayedRobot) -> None:
    def arrive() -> None:
        robot.goal = GoalState.REACHED

    robot.after_goal = arrive


def test_goal_is_reached_and_the_lease_given_back(stage: Stage) -> None:
    played, _ = stage
    arrives(played)
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


def test_navigator_and_mode_have_names(stage: Stage) -> None:
    async def story(robot: sidestep.Robot) -> None:
        assert (await robot.set_navigator("bug", "right")).ok
        assert (await robot.set_navigator(sidestep.Navigator.BUG, -1)).ok
        assert (await robot.set_mode("hold")).ok

    driven(stage, story)
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
    assert "only r1: use sidestep.connect(robot=NAME)" in str(caught.value)
    assert "--id" not in str(caught.value)


def test_cancelled_goal_is_aborted_before_the_error_goes_on(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.5):
                await robot.goto(1.0, 2.0)
        assert played.commands[-1] == Command.SIDESTEP_ABORT_GOAL

    driven(stage, story)
    assert leases(played) == [LeaseAction.TAKE, LeaseAction.LEAVE]


def test_goal_cancelled_while_it_is_sent_is_aborted_after_it(stage: Stage) -> None:
    played, _ = stage
    played.answers = [None, Reason.NONE]

    async def story(robot: sidestep.Robot) -> None:
        assert (await robot.lease.take()).ok
        going = asyncio.ensure_future(robot.goto(1.0, 2.0))
        await until(lambda: bool(played.asked))
        for _ in range(3):
            going.cancel()
            await asyncio.sleep(0.01)
        with pytest.raises(asyncio.CancelledError):
            await going

    driven(stage, story)
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


def test_cancelled_stop_is_still_sent(stage: Stage) -> None:
    played, _ = stage
    played.deaf = True

    async def story(robot: sidestep.Robot) -> None:
        stopping = asyncio.ensure_future(robot.emergency_stop(timeout_s=PATIENCE_S))
        await asyncio.sleep(0)
        stopping.cancel()
        await asyncio.sleep(0.2)
        assert played.vehicle is not Vehicle.EMERGENCY_STOP
        played.deaf = False
        await until(lambda: played.vehicle is Vehicle.EMERGENCY_STOP)

    driven(stage, story)


def test_blocked_loop_sends_no_heartbeat(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> None:
        assert (await robot.lease.take()).ok
        await until(lambda: played.beats > 3)
        loop_is_free = asyncio.Event()
        before = played.beats
        began_ns = robot.clock.now_ns()
        robot.clock.sleep_until(began_ns + 600_000_000)  # blocks the loop
        assert played.beats <= before + 1
        loop_is_free.set()
        await until(lambda: played.beats > before + 2)

    driven(stage, story)


def test_lease_that_was_seized_ends_the_heartbeat(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> None:
        assert (await robot.lease.take()).ok
        assert (await robot.lease.show()).ours
        played.desk.held = ("ben/beef", "ben")
        await until(lambda: not robot.holds_lease)

    driven(stage, story)
    assert leases(played) == [LeaseAction.TAKE], "what is another operator's is not given back"


def test_lease_that_the_robot_took_back_is_taken_for_the_next_goal(stage: Stage) -> None:
    """Its status may still be on the way when the next operation begins."""
    played, _ = stage
    arrives(played)

    async def story(robot: sidestep.Robot) -> None:
        assert (await robot.goto(1.0, 2.0)).ok
        played.desk.held = None
        assert robot.holds_lease
        assert (await robot.goto(1.0, 2.0)).ok
        assert played.desk.held is not None

    driven(stage, story)


def test_telemetry_is_iterated_and_what_is_not_read_gives_way(stage: Stage) -> None:
    async def story(robot: sidestep.Robot) -> None:
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

    driven(stage, story)


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


def test_parameters_are_typed_and_checked(stage: Stage) -> None:
    async def story(robot: sidestep.Robot) -> None:
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

    driven(stage, story)


MISSION = sidestep.Mission(waypoints=(sidestep.Waypoint(x_m=1.0, y_m=2.0),))


def test_mission_is_given_driven_and_fetched(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> None:
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

    driven(stage, story)


def test_mission_that_is_cancelled_pauses(stage: Stage) -> None:
    played, _ = stage

    async def story(robot: sidestep.Robot) -> None:
        assert (await robot.mission.upload(MISSION)).ok
        played.desk.status = MissionState.RUNNING
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.4):
                await robot.mission.run()

    driven(stage, story)
    last = played.asked[-1]
    assert isinstance(last, CommandRequest)
    assert (last.command, last.param1) == (Command.DO_PAUSE_CONTINUE, 0.0)


def test_fence_is_set_and_read(stage: Stage) -> None:
    circle = sidestep.Circle(x_m=0.0, y_m=0.0, radius_m=5.0)

    async def story(robot: sidestep.Robot) -> None:
        assert await robot.fence.get() is None
        assert (await robot.fence.set(circle)).ok
        assert await robot.fence.get() == circle
        assert (await robot.fence.clear()).ok

    driven(stage, story)


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
