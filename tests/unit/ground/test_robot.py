"""The client of one robot, what it sends, and what it ends."""

import asyncio
import re
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import asynccontextmanager, closing
from dataclasses import replace
from typing import Any, TypeVar

import pytest

from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from ground.cli import operate
from ground.cli.observe.live_line import LiveStatus
from ground.client import robot_link
from ground.client.connection import common
from ground.client.goal import destination
from ground.client.lease_holder import operator_name
from ground.client.leases import ALIVE, TICK_NS, Leasing
from ground.client.outcomes import Accepted, GoalEnded, Refused, RefusedError
from ground.client.streams import ClosedError
from ground.client.vocabulary import PYTHON, SHELL, Remedies
from ground.commands.arm import Arm
from ground.commands.resume import Resume
from ground.robot import Robot
from protocol.topics import HEARTBEAT, LEASE, MISSION, ODOMETRY, OPERATOR, STATUS, STOP, Role
from protocol.wire.enums import Command, GoalState, LeaseAction, MissionState, Mode, Vehicle
from protocol.wire.messages import CommandRequest, GoalRequest, LeaseRequest, MissionStatus, Teleop
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S
from tests.support.each import each
from tests.support.ground.client import HELD, STANDBY, Stage, captured_output, lease_of, status
from tests.support.ground.station import ThreadAtOnce

GOAL = destination([1.0, 2.0])
DRIVING, ARM, MODE = "GUIDED", "COMPONENT_ARM_DISARM", "DO_SET_MODE"
ABORT = "SIDESTEP_ABORT_GOAL"
T = TypeVar("T")
Call = Callable[[Robot], Coroutine[Any, Any, Any]]


@pytest.fixture(autouse=True)
def _no_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_link, "Thread", ThreadAtOnce)


def played(stage: Stage, program: Coroutine[Any, Any, T]) -> T:
    """Run a program to its end; what waits in it takes no real time."""
    with closing(PlayedLoop(stage.clock)) as loop:
        return loop.run(program)


def done(stage: Stage, call: Call) -> Any:
    """Run a coroutine of the robot of the command line."""
    return stage.run(call(stage.robot))


def robot_of(stage: Stage, **how: Any) -> Robot:
    return Robot(stage.bus, stage.common, "anna", clock=stage.clock, **how)


@asynccontextmanager
async def opened(stage: Stage, **how: Any) -> AsyncIterator[Robot]:
    """Yield a robot of a program that is its operator."""
    robot = robot_of(stage, **how)
    await robot.open()
    try:
        yield robot
    finally:
        await robot.close()


def lived(stage: Stage, story: Call, **how: Any) -> Any:
    """Run a program with a robot."""

    async def program() -> Any:
        async with opened(stage, **how) as robot:
            return await story(robot)

    return played(stage, program())


def sent(stage: Stage) -> list[str]:
    return [name_of(request) for request in stage.bus.requests]


def name_of(request: LeaseRequest | GoalRequest | CommandRequest) -> str:
    if isinstance(request, LeaseRequest):
        return LeaseAction(request.action).name
    if isinstance(request, GoalRequest):
        return Mode(request.mode).name
    return Command(request.command).name


def beats(stage: Stage) -> int:
    return [key for key, _ in stage.bus.sent].count(OPERATOR.path)


def goal_of(stage: Stage) -> int:
    return [one.request_id for one in stage.bus.requests if isinstance(one, GoalRequest)][-1]


def shows(stage: Stage, state: GoalState = GoalState.DRIVING) -> None:
    """Let the robot show the newest goal in this state."""
    now_ns = stage.clock.now_ns()
    shown = status(goal_id=goal_of(stage), goal=state, time_ns=now_ns)
    stage.bus.say(STATUS, shown)


async def until(condition: Callable[[], bool]) -> None:
    for _ in range(1000):
        if condition():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("this never comes")


@each(
    ("call", "wire"),
    [
        (lambda robot: robot.hold(), (Command.DO_PAUSE_CONTINUE, 0.0, 0.0)),
        (lambda robot: robot.resume(), (Command.DO_PAUSE_CONTINUE, 1.0, 0.0)),
        (lambda robot: robot.abort(), (Command.SIDESTEP_ABORT_GOAL, 0.0, 0.0)),
        (lambda robot: robot.arm(), (Command.COMPONENT_ARM_DISARM, 1.0, 0.0)),
        (lambda robot: robot.disarm(), (Command.COMPONENT_ARM_DISARM, 0.0, 0.0)),
        (lambda robot: robot.return_home(), (Command.NAV_RETURN_TO_LAUNCH, 0.0, 0.0)),
        (lambda robot: robot.restart(), (Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0)),
        (lambda robot: robot.set_mode("auto"), (Command.DO_SET_MODE, 1.0, float(Mode.AUTO))),
        (lambda robot: robot.set_navigator("bug", "left"), (Command.SIDESTEP_SET_NAVIGATOR, 1, 1)),
    ],
)
def test_command_is_one_request_without_the_lease(
    call: Call, wire: tuple[int, float, float]
) -> None:
    stage = Stage()
    assert isinstance(done(stage, call), Accepted)
    (request,) = stage.bus.requests
    assert (request.command, request.param1, request.param2) == wire


@each("attended", [False, True])
def test_goal_that_is_not_followed_is_only_sent(attended: bool) -> None:
    stage = Stage(attended=attended)
    answer, goal_id = done(stage, lambda robot: robot.send_goal(GOAL, Mode.AUTO))
    (request,) = stage.bus.requests
    assert (answer.ok, request.request_id) == (True, goal_id)


def test_drive_that_another_operator_forbids_begins_nothing() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.say(*HELD)
    with pytest.raises(RefusedError, match="anna"):
        done(stage, lambda robot: robot.drive_to(GOAL))
    assert sent(stage) == ["TAKE"]


def test_drive_that_cannot_be_armed_ends_in_hold() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, Reason.NO_SENSES)
    stage.bus.say(*STANDBY)
    refused = lived(stage, lambda robot: robot.drive(0.1, 0.0))
    assert isinstance(refused, Refused)
    assert sent(stage) == ["TAKE", MODE, ARM, MODE, "LEAVE"]
    manual, hold = (one for one in stage.bus.requests if name_of(one) == MODE)
    assert (hold.param2, hold.ends_id) == (Mode.HOLD, manual.request_id)


def holding(stage: Stage, goal_id: int = 77) -> None:
    """Let the robot show a goal that it holds in GUIDED, as one whose program has ended."""
    shown = status(goal_id=goal_id, goal=GoalState.DRIVING, mode=Mode.HOLD)
    stage.bus.say(STATUS, shown)


def goes_on(stage: Stage, state: GoalState) -> Callable[[int], None]:
    """Show the goal in a state once it is resumed for the second time."""

    def shown(_number: int) -> None:
        if sent(stage).count(RESUME) == 2:
            now_ns = stage.clock.now_ns()
            stage.bus.say(STATUS, status(goal_id=77, goal=state, time_ns=now_ns))

    return shown


RESUME = "DO_PAUSE_CONTINUE"


def test_resume_from_a_shell_attends_a_goal_that_needs_it() -> None:
    stage = Stage(Reason.NO_OPERATOR)
    holding(stage)
    stage.bus.on_ask = goes_on(stage, GoalState.REACHED)
    ended = done(stage, lambda robot: robot.resume())
    assert (ended.outcome, ended.ok) == ("reached", True)
    assert sent(stage) == [RESUME, "TAKE", RESUME, "LEAVE"]
    assert beats(stage) >= 1


def test_resumed_goal_is_held_when_its_program_is_interrupted() -> None:
    stage = Stage(Reason.NO_OPERATOR)
    holding(stage)
    stage.bus.on_ask = goes_on(stage, GoalState.DRIVING)

    async def program() -> None:
        going = asyncio.ensure_future(stage.robot.resume())
        await until(lambda: sent(stage).count(RESUME) == 2)
        await asyncio.sleep(0.2)
        going.cancel()
        with pytest.raises(asyncio.CancelledError):
            await going

    stage.run(program())
    assert sent(stage) == [RESUME, "TAKE", RESUME, MODE, "LEAVE"]
    hold = stage.bus.requests[-2]
    assert (hold.param2, hold.ends_id) == (Mode.HOLD, 77)
    assert "interrupted: the robot holds" in stage.notes.notes


def test_mission_that_needs_an_operator_is_not_followed() -> None:
    stage = Stage(Reason.NO_OPERATOR)
    holding(stage)
    stage.bus.say(MISSION, make(MissionStatus, state=MissionState.PAUSED, count=2))
    refused = done(stage, lambda robot: robot.resume())
    assert (refused.reason, sent(stage)) == (Reason.NO_OPERATOR, [RESUME])


def test_seized_lease_is_left_when_the_command_is_refused() -> None:
    stage = Stage(Reason.NONE, Reason.NO_SENSES)
    assert not stage.run(operate.perform(Arm(), stage.robot, seizes=True)).ok
    assert sent(stage) == ["SEIZE", ARM, "LEAVE"]


def test_resume_seizes_attends_and_drives_on() -> None:
    stage = Stage(Reason.NONE, Reason.NO_OPERATOR)
    holding(stage)
    stage.bus.on_ask = goes_on(stage, GoalState.REACHED)
    assert stage.run(operate.perform(Resume(), stage.robot, seizes=True)).ok
    assert sent(stage) == ["SEIZE", RESUME, "TAKE", RESUME, "LEAVE"]


@each(("remedies", "words"), [(SHELL, "(`sidestep teleop`"), (PYTHON, "(await robot.drive(")])
def test_mode_manual_is_led_to_a_drive_by_hand(remedies: Remedies, words: str) -> None:
    stage = Stage(Reason.NO_OPERATOR)
    stage.common = replace(stage.common, remedies=remedies)
    refused = played(stage, robot_of(stage, leasing=Leasing.DRIVES).set_mode("manual"))
    assert words in refused.text
    assert "goto" not in refused.text


def test_robot_shows_no_status_that_is_old() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        stage.bus.say(STATUS, status(Vehicle.ACTIVE))
        assert "ACTIVE" in repr(robot)
        stage.clock.advance(12 * NS_PER_S)
        assert repr(robot) == "<robot r1 at tcp/127.0.0.1:1: no status for 12 s>"

    lived(stage, story)


@each("leasing", [Leasing.DRIVES, Leasing.ALWAYS])
def test_what_is_accepted_while_time_stands_says_so(leasing: Leasing) -> None:
    stage = Stage()
    stands(stage)
    accepted = lived(stage, lambda robot: robot.arm(), leasing=leasing)
    assert accepted.ok
    assert ", but the simulated time of r1 stands still, no plant" in accepted.text


def remedies_in(words: Mapping[int, str]) -> str:
    return "\n".join(words.values())


def test_each_face_gives_remedies_in_its_own_words() -> None:
    assert not re.search("sidestep [a-z]", remedies_in(PYTHON.refusals).replace("sidestep doc", ""))
    assert "await" not in remedies_in(SHELL.refusals)
    for reason in Reason:
        assert "sidestep " not in reason_text(reason), "each face adds its own remedy"
    stage = Stage(Reason.PLACE_UNKNOWN)
    stage.common = replace(stage.common, remedies=PYTHON)
    refused = played(stage, robot_of(stage, leasing=Leasing.NEVER).return_home())
    assert "(await robot.set_pose(x_m, y_m, heading_deg), or" in refused.text


def test_refusal_names_the_robot_as_it_was_named() -> None:
    stage = Stage(Reason.NOT_ARMED)
    where = common("tcp/127.0.0.1:1", "r2", None)
    robot = Robot(stage.bus, where, clock=stage.clock, leasing=Leasing.NEVER)
    refused = stage.run(robot.return_home())
    assert refused.text.endswith("(sidestep arm --connect tcp/127.0.0.1:1 --id r2)")


def test_refusal_for_the_lease_names_its_holder() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.say(LEASE, lease_of("ben"))
    assert done(stage, lambda robot: robot.arm()).holder == "ben"


def test_stop_that_is_not_known_is_that_of_the_status() -> None:
    stage = Stage(Reason.NEWER_STOP, Reason.NONE)
    stage.bus.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=9))
    assert done(stage, lambda robot: robot.clear_emergency_stop(7, 8)).ok
    assert done(stage, lambda robot: robot.clear_emergency_stop()).ok
    assert [request.stop_id for request in stage.bus.requests] == [7, 8, 9]


def test_robot_without_a_pose_has_no_place_ahead_of_it() -> None:
    stage = Stage()
    with pytest.raises(RemoteError, match="the robot publishes no pose"):
        done(stage, lambda robot: robot.pose())
    assert ("r1", ODOMETRY.path) in stage.bus.subscribed


def test_request_is_repeated_with_its_id_until_it_is_answered() -> None:
    stage = Stage(None, None, Reason.NONE)
    assert done(stage, lambda robot: robot.hold()).ok
    assert len({request.request_id for request in stage.bus.requests}) == 1
    assert len(stage.bus.requests) == 3


def test_silence_is_explained() -> None:
    stage = Stage(*[None] * 3)
    with pytest.raises(RemoteError, match=r"no robot at tcp/127.0.0.1:1.*\(no answer within"):
        done(stage, lambda robot: robot.hold())


def test_what_moves_takes_the_lease_and_what_stops_does_not() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        for call in (robot.hold, robot.abort, robot.disarm, robot.arm, robot.return_home):
            assert (await call()).ok
        assert (await robot.set_mode("hold")).ok

    lived(stage, story)
    home = ["TAKE", "NAV_RETURN_TO_LAUNCH"]
    stops = ["DO_PAUSE_CONTINUE", ABORT, ARM]
    assert sent(stage) == [*stops, "TAKE", ARM, *home, MODE, "LEAVE"]


def test_heartbeat_follows_the_lease() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        await asyncio.sleep(1.0)
        assert beats(stage) == 0
        assert (await robot.lease.change(LeaseAction.TAKE)).ok
        assert (robot.holds_lease, beats(stage)) == (True, 1)
        await asyncio.sleep(2.0)
        assert 9 <= beats(stage) <= 12
        await robot.lease.change(LeaseAction.RELEASE)
        before = beats(stage)
        await asyncio.sleep(1.0)
        assert beats(stage) == before

    lived(stage, story)
    assert sent(stage) == ["TAKE", "RELEASE"], "what was given back is not left once more"


def test_blocked_loop_sends_no_heartbeat_and_makes_up_for_none() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        await robot.lease.change(LeaseAction.TAKE)
        await asyncio.sleep(1.0)
        before = beats(stage)
        stage.clock.advance(10 * NS_PER_S)
        assert beats(stage) == before
        await asyncio.sleep(3 * TICK_NS / NS_PER_S)
        assert beats(stage) == before + 1

    lived(stage, story)


def test_heartbeat_ends_when_another_person_has_the_lease() -> None:
    """A status from before the lease was taken may still arrive."""
    stage = Stage()

    async def story(robot: Robot) -> None:
        await robot.lease.change(LeaseAction.TAKE)
        stage.bus.say(*HELD)
        await asyncio.sleep(0.2)
        assert robot.holds_lease
        await asyncio.sleep(0.2)
        stage.bus.say(*HELD)
        await asyncio.sleep(0.1)
        assert not robot.holds_lease

    lived(stage, story)
    assert sent(stage) == ["TAKE"], "what is another operator's is not given back"


def test_goal_is_followed_and_the_lease_kept_until_the_end_of_the_program() -> None:
    stage = Stage()

    async def story(robot: Robot) -> GoalEnded | Refused:
        going = asyncio.ensure_future(robot.goto(1.0, 2.0))
        await until(lambda: DRIVING in sent(stage))
        shows(stage)
        await asyncio.sleep(0.5)
        shows(stage, GoalState.REACHED)
        outcome = await going
        assert robot.holds_lease
        return outcome

    outcome = lived(stage, story)
    assert (outcome.ok, outcome.outcome) == (True, "reached")
    assert sent(stage) == ["TAKE", DRIVING, "LEAVE"]


def test_cancelled_goal_is_aborted_by_its_own_id() -> None:
    stage = Stage(Reason.NONE, Reason.NOT_ARMED)
    stage.bus.say(*STANDBY)

    async def story(robot: Robot) -> None:
        going = asyncio.ensure_future(robot.goto(1.0, 2.0))
        await until(lambda: sent(stage).count(DRIVING) == 2)
        shows(stage)
        await asyncio.sleep(0.2)
        for _ in range(3):
            going.cancel()
            await asyncio.sleep(0)
        with pytest.raises(asyncio.CancelledError):
            await going

    lived(stage, story)
    assert sent(stage) == ["TAKE", DRIVING, ARM, DRIVING, ABORT, "LEAVE"]
    assert stage.bus.requests[-2].ends_id == goal_of(stage)


def test_goal_cancelled_while_it_is_sent_is_aborted_after_its_answer() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        held: list[Callable[[], None]] = []
        stage.bus.on_ask = lambda _: setattr(stage.bus, "held", held)  # from the lease on
        going = asyncio.ensure_future(robot.drive_to(GOAL))
        await until(lambda: bool(held))
        going.cancel()
        await asyncio.sleep(0.1)
        assert len(held) == 1, "the abort waits for the answer"
        stage.bus.on_ask, stage.bus.held = (lambda _: None), None
        held.pop()()
        await asyncio.gather(going, return_exceptions=True)
        assert going.cancelled()

    lived(stage, story)
    assert sent(stage)[-3:] == [DRIVING, ABORT, "LEAVE"]
    assert stage.bus.requests[-2].ends_id == goal_of(stage)


def test_drive_that_waits_in_turn_is_not_sent_when_it_is_cancelled() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        await robot.lease.change(LeaseAction.TAKE)
        held = stage.bus.held = []
        first = asyncio.ensure_future(robot.in_turn(lambda: robot.ask(home(robot))))
        await until(lambda: len(held) == 1)
        second = asyncio.ensure_future(robot.in_turn(lambda: robot.ask(home(robot))))
        third = asyncio.ensure_future(robot.in_turn(lambda: robot.ask(home(robot))))
        await asyncio.sleep(0.1)
        second.cancel()
        await asyncio.sleep(0.1)
        assert len(held) == 1
        stage.bus.held = None
        held.pop()()
        assert (await first).ok
        assert (await third).ok

    lived(stage, story)
    assert sent(stage) == ["TAKE", *["NAV_RETURN_TO_LAUNCH"] * 2, "LEAVE"]


def home(robot: Robot) -> CommandRequest:
    return robot.request(Command.NAV_RETURN_TO_LAUNCH)


def test_only_some_requests_are_under_way_at_once() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        held = stage.bus.held = []
        holding = [asyncio.ensure_future(robot.hold()) for _ in range(8)]
        await asyncio.sleep(0.1)
        assert len(held) == 4
        stage.bus.held = None
        for answer in held:
            answer()
        assert all(one.ok for one in await asyncio.gather(*holding))

    lived(stage, story)


def test_request_that_was_sent_goes_on_when_it_is_cancelled() -> None:
    stage = Stage(None, Reason.NONE)

    async def story(robot: Robot) -> None:
        holding = asyncio.ensure_future(robot.hold())
        await until(lambda: bool(stage.bus.requests))
        holding.cancel()
        await asyncio.gather(holding, return_exceptions=True)
        await asyncio.sleep(1.0)

    lived(stage, story)
    assert sent(stage) == ["DO_PAUSE_CONTINUE"] * 2


def test_abort_without_an_answer_ends_the_heartbeat() -> None:
    """Then the robot stops by itself."""
    stage = Stage(Reason.NONE, Reason.NONE, *[None] * 3)

    async def story(robot: Robot) -> None:
        going = asyncio.ensure_future(robot.goto(1.0, 2.0))
        await until(lambda: DRIVING in sent(stage))
        shows(stage)
        await asyncio.sleep(0.1)
        going.cancel()
        await asyncio.gather(going, return_exceptions=True)
        assert not robot.holds_lease

    lived(stage, story)
    assert sent(stage) == ["TAKE", DRIVING, *[ABORT] * 3]


def test_drive_by_hand_is_ended_by_its_own_id() -> None:
    stage = Stage()
    stage.bus.say(STATUS, status(mode=Mode.MANUAL))

    async def story(robot: Robot) -> None:
        driving = asyncio.ensure_future(robot.drive(0.2, -30.0))
        await asyncio.sleep(1.0)
        driving.cancel()
        await asyncio.gather(driving, return_exceptions=True)

    lived(stage, story)
    speeds = [frame.speed_mm_s for _, frame in stage.bus.sent if isinstance(frame, Teleop)]
    assert (speeds[0], speeds[-1]) == (200, 0)
    assert 19 <= len(speeds) <= 22, "twenty a second"
    manual, hold = (one for one in stage.bus.requests if name_of(one) == MODE)
    assert (hold.param2, hold.ends_id) == (Mode.HOLD, manual.request_id)


def test_end_of_the_program_ends_its_drive_before_it_leaves() -> None:
    stage = Stage()

    async def program() -> None:
        async with opened(stage) as robot:
            going = asyncio.ensure_future(robot.goto(1.0, 2.0))
            await until(lambda: DRIVING in sent(stage))
            shows(stage)
            await asyncio.sleep(0.1)
        assert sent(stage) == ["TAKE", DRIVING, ABORT, "LEAVE"]
        with pytest.raises(ClosedError):
            await going
        for call in (robot.hold, robot.arm, robot.emergency_stop, robot.emergency_stop_all):
            with pytest.raises(ClosedError):
                await call()

    played(stage, program())


def test_lease_that_was_taken_in_vain_is_left() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        held = stage.bus.held = []
        taking = asyncio.ensure_future(robot.lease.change(LeaseAction.TAKE))
        await until(lambda: bool(held))
        taking.cancel()
        await asyncio.gather(taking, return_exceptions=True)
        stage.bus.held = None
        held.pop()()

    lived(stage, story)
    assert sent(stage) == ["TAKE", "LEAVE"]


def stopping(stage: Stage) -> list[CommandRequest]:
    return [one for key, one in stage.bus.sent if key == STOP.path]  # type: ignore[misc]


def acknowledges(stage: Stage) -> None:
    """Let the status show the newest stop that the robot is asked for."""

    def show(_: int) -> None:
        if stops := stopping(stage):
            shown = status(Vehicle.EMERGENCY_STOP, stop_id=stops[-1].request_id)
            stage.bus.say(STATUS, shown)

    stage.bus.on_ask = show


def test_stop_is_sent_before_anything_is_awaited() -> None:
    stage = Stage()
    acknowledges(stage)

    async def story(robot: Robot) -> None:
        robot.press_stop()
        assert stopping(stage)
        before = len(stopping(stage))
        stop = robot.emergency_stop()
        stop.send(None)
        assert len(stopping(stage)) > before
        stop.close()

    lived(stage, story)


def test_a_robot_that_nobody_has_opened_can_be_stopped() -> None:
    stage = Stage()
    acknowledges(stage)

    async def story() -> None:
        robot = robot_of(stage).to("r1")
        assert (await robot.emergency_stop()).ok
        await robot.close()
        await robot_of(stage).close()

    played(stage, story())
    assert stopping(stage)


def test_stop_waits_for_no_request() -> None:
    stage = Stage()
    acknowledges(stage)

    async def story(robot: Robot) -> None:
        held = stage.bus.held = []
        holding = [asyncio.ensure_future(robot.hold()) for _ in range(8)]
        await until(lambda: len(held) == 4)
        assert (await robot.emergency_stop()).ok
        assert not any(one.done() for one in holding)
        stage.bus.held = None
        for answer in held:
            answer()
        await asyncio.gather(*holding)

    lived(stage, story)


def test_stop_stands_though_no_thread_can_repeat_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class NoThread(ThreadAtOnce):
        def start(self) -> None:
            raise RuntimeError("can't start new thread")

    stage = Stage()

    async def story(robot: Robot) -> None:
        monkeypatch.setattr(robot_link, "Thread", NoThread)
        pressed = robot.press_stop()
        monkeypatch.setattr(robot_link, "Thread", ThreadAtOnce)
        with pytest.raises(RuntimeError, match="can't start"):
            await pressed

    lived(stage, story)
    assert len(stopping(stage)) == 1


def test_program_releases_the_stop_that_is_shown_then_its_own() -> None:
    stage = Stage()
    acknowledges(stage)

    async def story(robot: Robot) -> Any:
        await robot.emergency_stop()
        own = stopping(stage)[-1].request_id
        stage.bus.on_ask = lambda _: None
        stage.bus.say(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=9))
        stage.bus.script = [Reason.NONE, Reason.NEWER_STOP]
        assert (await robot.clear_emergency_stop()).ok
        cleared = [one.stop_id for one in stage.bus.requests if getattr(one, "stop_id", 0)]
        assert cleared == [9, own]

    lived(stage, story)


def test_all_robots_are_stopped_though_none_is_present() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        with pytest.raises(RemoteError, match="no robot is present"):
            await robot.emergency_stop_all(timeout_s=0.2)

    lived(stage, story)
    assert stopping(stage)


def test_robot_on_the_same_bus_has_its_own_name() -> None:
    stage = Stage()

    async def story(robot: Robot) -> None:
        other = robot.to("r2")
        assert (other.name, other.clock, other.bus) == ("r2", robot.clock, robot.bus)

    lived(stage, story)


def test_work_in_a_thread_outlives_the_cancellation_of_its_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    jobs: list[Callable[[], object]] = []

    class ThreadLater(ThreadAtOnce):
        def start(self) -> None:
            jobs.append(self._target)

    async def program() -> None:
        waiting = robot_link.in_own_thread(lambda: 1, "job")
        waiting.cancel()
        await asyncio.sleep(0)
        jobs[0]()

    monkeypatch.setattr(robot_link, "Thread", ThreadLater)
    asyncio.run(program())


def stands(stage: Stage, *, heard: bool = True) -> None:
    """Let a robot in lockstep be there whose plant has ended."""
    stage.bus.come(Role.ROBOT)
    if heard:
        stage.bus.say(HEARTBEAT, ALIVE)


@each(
    "call",
    [
        lambda robot: robot.drive_to(GOAL),
        lambda robot: robot.drive(0.1, 0.0),
        lambda robot: robot.set_mode("guided"),
        lambda robot: robot.mission.start(),
    ],
)
def test_refusal_without_simulated_time_names_that_cause(call: Call) -> None:
    """The operator's heartbeat does arrive, but no cycle reads it."""
    stage = Stage(Reason.NONE, *[Reason.NO_OPERATOR] * 10_000)
    stands(stage)
    refused = lived(stage, call)
    assert refused.text.startswith(
        "refused: the simulated time of r1 stands still, no plant steps it: start one "
    )
    assert "heartbeat" not in refused.text


def test_lost_goal_is_not_denied_while_time_stands() -> None:
    stage = Stage(Reason.NO_GOAL)
    stands(stage)
    refused = done(stage, lambda robot: robot.resume())
    assert refused.text.startswith("refused: the simulated time of r1 stands still")


def test_what_no_simulated_time_keeps_back_names_that_cause() -> None:
    for call in (
        lambda robot: robot.lease.show(),
        lambda robot: robot.mission.status(),
        lambda robot: robot.set_true_pose(),
        lambda robot: robot.clear_emergency_stop(),
    ):
        stage = Stage()
        stands(stage)
        with pytest.raises(RemoteError, match="the simulated time of r1 stands still"):
            lived(stage, call)


def test_goal_in_simulated_time_that_stops_ends_with_that_cause() -> None:
    stage = Stage(attended=True)

    def drives(number: int) -> None:
        if isinstance(stage.bus.requests[number - 1], GoalRequest):
            stands(stage)
            shows(stage)

    stage.bus.on_ask = drives
    ended = lived(stage, lambda robot: robot.drive_to(GOAL))
    assert ended.outcome == "aborted"
    assert "the simulated time of r1 stands still" in ended.reason


@each("remark", ["", "  ", "\n"])
def test_remark_that_is_empty_is_refused_and_asks_nothing(remark: str) -> None:
    stage = Stage()
    with pytest.raises(UserError, match="the remark is empty"):
        lived(stage, lambda robot: robot.mark(remark))
    assert "TAKE" not in sent(stage)


def test_names_that_are_empty_are_refused() -> None:
    for name in ("", " ", "\t"):
        with pytest.raises(UserError, match="not a valid operator name"):
            operator_name(name)
    with pytest.raises(UserError, match="robot name ''"):
        common("tcp/127.0.0.1:1", "", None)


def test_load_of_the_machine_is_no_cause_for_a_wrong_name() -> None:
    for has_robot in (True, False):
        stage = Stage()
        if has_robot:
            stage.bus.come(Role.ROBOT)

        async def asks(robot: Robot) -> str:
            robot._slowdown = lambda: 4.0
            return await robot.diagnosis()

        assert ("this machine is busy" in lived(stage, asks)) is has_robot


def test_live_watch_says_once_that_simulated_time_stands() -> None:
    """The robot sends its heartbeat all the time, so it is not silent."""
    stage = Stage()
    output, printed = captured_output()
    robot = robot_of(stage)

    async def watched() -> None:
        watching = asyncio.create_task(LiveStatus(robot, output).run(beats=False))
        until_ns = stage.clock.now_ns() + 10 * NS_PER_S
        while stage.clock.now_ns() < until_ns:
            stands(stage)
            await robot.sleep_until(stage.clock.now_ns() + NS_PER_S // 5)
        watching.cancel()

    played(stage, watched())
    assert printed()[1].count("the simulated time of r1 stands still, no plant steps it") == 1
