"""Drive one robot of `up` to one goal: arm it, follow it, and have its plant score the run."""

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import nan
from typing import Final

from msgspec import structs

from ground.client.goal import goal_request
from ground.client.outcomes import Accepted, Refused
from ground.client.requests import GoalEnd, GoalWatch
from ground.client.robot_link import UnansweredError
from ground.client.status_line import goal_line, short_line
from ground.client.streams import Stream
from ground.client.telemetry import Telemetry
from ground.client.time_factor import TimeFactor
from ground.client.vocabulary import SIDES
from ground.launch.scenario import Scenario, ScenarioRobot
from ground.launch.supervisor import VoidRun
from ground.robot import Robot
from ground.text.wording import Part
from protocol.navigators import NAVIGATORS, is_own
from protocol.outcome import REPLACED, WANTED_ENDS, RunEnd, RunOutcome, doubt_of, evaluated
from protocol.topics import CYCLE, DECISION, LEASE, MISSION, ODOMETRY, RUN, STATUS, TEXT, TRUTH
from protocol.wire.codec import decode
from protocol.wire.enums import (
    Command,
    GoalState,
    MissionState,
    Mode,
    Navigator,
    RunAction,
    Severity,
    Vehicle,
)
from protocol.wire.limits import MAX_LEASE_MS
from protocol.wire.messages import (
    CommandAck,
    NavigatorStatus,
    PlanarOdometry,
    RunRequest,
    RunScore,
    Statustext,
)
from protocol.wire.reasons import Reason
from protocol.wire.statustext import StatustextAssembler
from runtime.errors import NoAnswerError, RemoteError
from runtime.units import NS_PER_S
from runtime.watchdog import slowdown_in

FOLLOWED: Final = (STATUS, ODOMETRY, DECISION, CYCLE, TRUTH, LEASE, MISSION)
FOLLOWED_OF_SEVERAL: Final = tuple(topic for topic in FOLLOWED if topic is not DECISION)
"""The status line of several robots has no room for decisions."""

READY_NS: Final = 60 * NS_PER_S
"""A busy computer needs many seconds to start the processes; one that ends is noticed at once."""
IDLE_S: Final = MAX_LEASE_MS // 1000
"""So long an operator who has ended the goal may leave the robot idle before the run ends."""
RETRY_NS: Final = 20_000_000
REQUEST_TIMEOUT_S: Final = 2.0
RESTART_WAIT_NS: Final = 5 * NS_PER_S
MAX_POSES: Final = 20_000
PASSING: Final = (Reason.NO_SENSES, Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.BUDGET)
"""Reasons that pass by themselves once the processes of a busy computer have started."""


class NoOutcomeError(RemoteError):
    """The run has no valid outcome."""

    exit_code = 1


class GoalRun:
    """One robot's part in a run; `outcome` is set when it has ended.

    `check` raises when a process has exited. `void` returns the reason when a process was
    restarted: then `void_reason` is set instead of `outcome`. A goal that an operator has ended or
    replaced is judged at once, but the run goes on until nobody has commanded the robot for IDLE_S.
    """

    def __init__(
        self,
        robot: Robot,
        scenario: Scenario,
        scenario_robot: ScenarioRobot,
        check: Callable[[], None],
        void: Callable[[], VoidRun | None] = lambda: None,
    ) -> None:
        self.robot = robot
        self._poses: deque[bytes] = deque(maxlen=MAX_POSES)
        self.telemetry = Telemetry(
            robot.bus,
            robot.name,
            FOLLOWED if len(scenario.robots) == 1 else FOLLOWED_OF_SEVERAL,
            robot.note_arrival,
            taker=lambda path: self._keep_pose if path == ODOMETRY.path else None,
        )
        self.outcome: RunOutcome | None = None
        self.void_reason = ""
        self._waiting = ""
        self._time_factor = TimeFactor(scenario.pace)
        self._scenario = scenario
        self._goal = scenario_robot.goal
        self._check = check
        self._void = void
        self._goal_id = 0
        self._begun_ns = self._lost_ns = 0
        self._commanded_ns: int | None = None
        """When an operator last commanded the robot, once the goal has ended."""

        self._of_goal: NavigatorStatus | None = None
        """The newest status of the goal of this run."""

        self._refusal: Refused | None = None
        self._watch: GoalWatch | None = None
        self._texts: Stream[Statustext] | None = None
        """The robot's texts, which name the fault of a navigator of the user's own."""

    def _keep_pose(self, _key: str, frame: bytes, _at_ns: int) -> None:
        self._poses.append(frame)

    async def prepare(self, *, arms: bool = True) -> None:
        """Choose the navigator and arm; arming is accepted as soon as the robot has sensor data."""
        chosen = self._scenario.navigator
        if is_own(chosen) and self._texts is None:
            self._texts = self.robot.stream(TEXT)
        navigator = float(Navigator.OWN if is_own(chosen) else NAVIGATORS[chosen])
        side = float(SIDES[self._scenario.side])
        await self._request_until_accepted(Command.SIDESTEP_SET_NAVIGATOR, navigator, side)
        if arms:
            await self._request_until_accepted(Command.COMPONENT_ARM_DISARM, 1.0)

    async def _request_until_accepted(
        self, command: Command, param1: float, param2: float = 0.0
    ) -> None:
        """Repeat a command until accepted: a robot that starts may not answer or lack data."""
        clock = self.robot.clock
        deadline_ns = clock.now_ns() + READY_NS
        while True:
            self._check()
            try:
                answer = await self.robot.ask(self.robot.request(command, param1, param2))
            except UnansweredError:
                if clock.now_ns() > deadline_ns:
                    raise
            else:
                if isinstance(answer, Accepted):
                    return
                if answer.reason not in PASSING or clock.now_ns() > deadline_ns:
                    raise NoOutcomeError(
                        f"the robot refused {command.name.lower()}: {answer.words}"
                    )
            await self.robot.sleep_until(clock.now_ns() + RETRY_NS)

    async def start(self) -> None:
        """Start the plant's time in lockstep; otherwise start the score of all robots."""
        deadline_ns = self.robot.clock.now_ns() + READY_NS
        while True:
            self._check()
            try:
                answer = await self._ask_plant(RunRequest(until_ns=0, action=RunAction.START))
                break
            except NoAnswerError:  # a robot that need not be armed is ready before the plant
                if self.robot.clock.now_ns() > deadline_ns:
                    raise
        if not isinstance(answer, CommandAck) or answer.result:
            raise NoOutcomeError("the plant did not start the run")

    async def pause(self) -> None:
        """Stop simulated time, if the plant still answers."""
        with suppress(NoAnswerError):
            await self._ask_plant(RunRequest(until_ns=0, action=RunAction.PAUSE))

    async def send(self) -> None:
        """Send the goal. A refusal is an outcome, too, but is kept until time has started.

        On a busy computer a failsafe may have disarmed the robot since `prepare`, for example
        because it lost ticks: then it is armed again.
        """
        deadline_ns = self.robot.clock.now_ns() + READY_NS
        while True:
            request = goal_request(self._goal.on_the_wire(), self.robot.ids.next(), Mode.AUTO)
            self._goal_id = request.request_id
            asked_ns = self.robot.clock.now_ns()
            answer = await self.robot.ask(request)
            self._refusal = answer if isinstance(answer, Refused) else None
            if self._refusal is None or not await self._was_disarmed(self._refusal, asked_ns):
                return
            if self.robot.clock.now_ns() > deadline_ns:
                return
            await self._request_until_accepted(Command.COMPONENT_ARM_DISARM, 1.0)

    async def _was_disarmed(self, refusal: Refused, asked_ns: int) -> bool:
        """Return whether a goal was refused because of a failsafe whose cause passes by itself."""

        def newest() -> NavigatorStatus | None:
            found = self.telemetry.latest(STATUS)
            return None if found is None or found[1] < asked_ns else found[0]

        if refusal.reason != Reason.NOT_ARMED or not await self.robot.wait(
            lambda: newest() is not None, NS_PER_S
        ):
            return False
        status = newest()
        return (
            status is not None
            and status.vehicle == Vehicle.FAILSAFE
            and status.vehicle_reason in PASSING
        )

    async def begin(self) -> None:
        """Follow the goal from now on; call it after `start`."""
        self._begun_ns = self.robot.clock.now_ns()
        if self._refusal is not None:
            await self._end(await self._refused(self._refusal))
            if self.outcome is not None and self.outcome.outcome == "timeout":  # the goal before
                reason = self._refusal.words
                self.outcome = replace(self.outcome, outcome="aborted", reason=reason)
            return
        timeout_ns = round(self._scenario.timeout_s * NS_PER_S)
        self._watch = GoalWatch(self._goal_id, self._begun_ns, timeout_ns, stamps_only=True)

    @property
    def is_judged(self) -> bool:
        """True when the run has an outcome, or when it is void."""
        return bool(self.void_reason) or self.outcome is not None

    @property
    def is_over(self) -> bool:
        """True when the run is judged, and nobody else drives on."""
        return bool(self.void_reason) or (
            self.outcome is not None and not self._is_commanded and not self._left_s
        )

    @property
    def ending(self) -> str:
        """Why a run has gone on after its goal and now ends; empty if it has not gone on."""
        if self._commanded_ns is None:
            return ""
        robot = self.robot.name
        return f"{robot}: nothing driven and no lease held for {IDLE_S} s, so the run ends"

    @property
    def _left_s(self) -> int:
        """Time in which an operator who has commanded the robot may go on."""
        if self._commanded_ns is None:
            return 0
        idle_ns = self.robot.clock.now_ns() - self._commanded_ns
        return max(0, -((idle_ns - IDLE_S * NS_PER_S) // NS_PER_S))

    async def wait(self, patience_ns: int) -> None:
        """Wait for the next message of the robot, at most so long."""
        await self.robot.arrival(self.robot.clock.now_ns() + patience_ns)

    async def look(self) -> None:
        """Check whether the goal has ended; NoOutcomeError when the robot is lost."""
        if self.is_over or self._watch is None:
            return
        if self.outcome is not None:
            self._check()
            if self._is_commanded:
                self._commanded_ns = self.robot.clock.now_ns()
            return
        truth = self.telemetry.latest(TRUTH)
        if truth is not None:
            self._time_factor.take(truth[0].time_ns, truth[1])
        void = self._void()
        if void is not None:
            self._waiting = void.why
            self.void_reason = void.why if void.is_final else ""
            return
        newest = self.telemetry.latest(STATUS)
        if newest is not None and newest[0].goal_id == self._goal_id:
            self._of_goal = newest[0]
        self._watch.look(self.telemetry.latest)
        self._watch.due(self.robot.clock.now_ns())
        end, of_goal = self._watch.end, self._of_goal
        if end is None:
            return
        if of_goal is None and newest is not None and end.outcome == REPLACED:
            of_goal = never_shown(newest[0])
        is_judged = end.outcome in ("timeout", REPLACED) or (of_goal and of_goal.goal_ended_ns)
        if of_goal is None or not is_judged:
            if self._is_lost():
                raise NoOutcomeError(f"{end.reason}: {await self.robot.diagnosis()}")
            return
        try:
            await self._end(of_goal, end)
        except NoAnswerError as error:
            if self._is_lost():
                raise NoOutcomeError(str(error)) from error

    def _is_lost(self) -> bool:
        """Return whether the time for a restart is over."""
        now_ns = self.robot.clock.now_ns()
        self._lost_ns = self._lost_ns or now_ns
        self._check()
        return now_ns - self._lost_ns > RESTART_WAIT_NS

    @property
    def _is_commanded(self) -> bool:
        """True while an operator commands the robot whose goal he has ended: he may go on."""
        if self.outcome is None or self.outcome.outcome not in ("aborted", REPLACED):
            return False
        lease, newest = self.telemetry.latest(LEASE), self.telemetry.latest(STATUS)
        if lease is not None and lease[0].held:
            return True
        if newest is None or newest[0].vehicle != Vehicle.ACTIVE or newest[0].mode == Mode.HOLD:
            return False
        mission = self.telemetry.latest(MISSION)
        on_mission = mission is not None and mission[0].state == MissionState.HOLDING
        drives_to_goal = GoalState.NONE < newest[0].goal < GoalState.REACHED
        return on_mission or drives_to_goal or newest[0].mode == Mode.MANUAL

    def line(self) -> list[Part]:
        """Return the status line of this run."""
        if self._waiting:
            return [Part(self._waiting)]
        now_ns = self.robot.clock.now_ns()
        if self.outcome is not None and not self.is_over:
            parts = goal_line(self.telemetry, now_ns, 0)
            on = "an operator commands" if self._is_commanded else f"ends in {self._left_s} s"
            return [Part(f"goal {self.outcome.outcome}, {on}"), *parts]
        watch = self._watch if self.outcome is None else None  # at the end it is not fed any more
        silent_ns = 0 if watch is None else watch.silent_ns(now_ns)
        unseen = self._goal_id if self._of_goal is None else None
        return goal_line(self.telemetry, now_ns, silent_ns, unseen)

    def short_line(self) -> Part:
        """Return a short status, for a line that covers several robots."""
        if self.outcome is not None:
            return Part(f"{self.robot.name} {self.outcome.outcome}")
        return short_line(self.telemetry, self.robot.name, self.robot.clock.now_ns())

    def time(self) -> Part:
        """Return the time since the goal was set, by the robot's clock."""
        newest = self.telemetry.latest(STATUS)
        if newest is None or not newest[0].goal_id:
            return Part("")
        return Part(f"{(newest[0].time_ns - newest[0].goal_started_ns) / NS_PER_S:.0f} s")

    def pace(self) -> Part:
        """Return how slowly simulated time runs; empty when it is as fast as chosen."""
        now_ns = self.robot.clock.now_ns()
        hint, words = self._time_factor.hint(now_ns), self._time_factor.words(now_ns)
        return Part(f"{words}, {hint}", words) if hint else Part("")

    def close(self) -> None:
        """End the subscriptions."""
        for mailbox in self.telemetry.boxes().values():
            self.robot.bus.unsubscribe(mailbox)

    @property
    def refusal(self) -> str:
        """Why the robot refused the goal; empty if it did not."""
        return "" if self._refusal is None else self._refusal.words

    async def _end(self, status: NavigatorStatus, end: GoalEnd | None = None) -> None:
        wall_s = (self.robot.clock.now_ns() - self._begun_ns) / NS_PER_S
        replaced = end is not None and end.outcome == REPLACED
        self.outcome = await self._judge(status, wall_s, status.time_ns if replaced else None)
        if end is not None and replaced and self.outcome.outcome == "timeout":
            self.outcome = replace(self.outcome, outcome=REPLACED, reason=end.reason)
        if status.goal_reason == Reason.NAVIGATOR_FAILED and (fault := await self._fault()):
            self.outcome = replace(self.outcome, reason=f"{self.outcome.reason}: {fault}")
        is_wanted = self.outcome.outcome == "aborted" and status.goal_reason in WANTED_ENDS
        if self.outcome.outcome == REPLACED or is_wanted:
            self._commanded_ns = self.robot.clock.now_ns()

    async def _fault(self) -> str:
        """Return what the robot has said of the failure of its navigator; empty if it is late."""
        if self._texts is None:
            return ""
        assembler = StatustextAssembler()
        with suppress(TimeoutError):
            async with asyncio.timeout(REQUEST_TIMEOUT_S):
                async for piece in self._texts:
                    text = assembler.receive(piece)
                    if text and piece.severity == Severity.ERROR:
                        return text
        return ""

    async def _ask_plant(self, request: RunRequest) -> object:
        timeout_s = REQUEST_TIMEOUT_S * slowdown_in(self.robot.clock)()
        robot = self.robot
        return await robot.in_own_thread(
            lambda: robot.bus.ask(RUN, request, timeout_s, robot=robot.name)
        )

    async def _refused(self, refusal: Refused) -> NavigatorStatus:
        await self.robot.wait(lambda: self.telemetry.latest(STATUS) is not None, READY_NS)
        newest = self.telemetry.latest(STATUS)
        if newest is None:
            raise NoOutcomeError(f"the goal was refused: {refusal.words}")
        return newest[0]

    async def _judge(
        self, status: NavigatorStatus, wall_s: float, until_ns: int | None = None
    ) -> RunOutcome:
        """Have the plant score the run until this stamp, else until its goal or its time ended."""
        timeout_ns = round(self._scenario.timeout_s * NS_PER_S)
        ended = status.goal in tuple(GoalState) and status.goal >= GoalState.REACHED
        if until_ns is None:
            until_ns = status.goal_ended_ns if ended else status.goal_started_ns + timeout_ns
        score = await self._ask_plant(RunRequest(until_ns=until_ns, action=RunAction.SCORE))
        if not isinstance(score, RunScore):
            raise NoOutcomeError("the plant did not return a score")
        pose = self._estimate(until_ns)
        cycle = self.telemetry.latest(CYCLE)
        account = RunEnd(
            goal_state=status.goal,
            goal_reason=status.goal_reason,
            by=status.ended_by,
            time_s=(until_ns - status.goal_started_ns) / NS_PER_S,
            estimate_x_m=nan if pose is None else pose.x_m,
            estimate_y_m=nan if pose is None else pose.y_m,
            wall_s=wall_s,
            missed_ticks=0 if cycle is None else cycle[0].missed,
            doubt_m=None if pose is None else doubt_of(pose),
        )
        return evaluated(self._scenario.asked(self._goal), account, score)

    def _estimate(self, at_ns: int) -> PlanarOdometry | None:
        """Return the robot's pose at that stamp, or the nearest one received."""
        nearest = None
        for frame in reversed(tuple(self._poses)):
            message = decode(frame).message
            if isinstance(message, PlanarOdometry):
                nearest = message
                if message.time_ns <= at_ns:
                    break
        return nearest


def never_shown(now: NavigatorStatus) -> NavigatorStatus:
    """Return the status of a goal that was replaced before a status showed it, to be judged now."""
    return structs.replace(
        now, goal_started_ns=now.time_ns, goal=GoalState.ACCEPTED, goal_reason=Reason.NONE
    )
