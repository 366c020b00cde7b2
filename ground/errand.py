"""One robot sent to one goal by `up`: armed when it can be, followed, and scored by its plant."""

from collections import deque
from collections.abc import Callable
from typing import Final

from ground.destination import goal_request
from ground.link import NS_PER_S, Link
from ground.operator import Answered, GoalWatch
from ground.orders import NAVIGATORS, SIDES, why
from ground.scenario import Scenario
from ground.status_line import goal_line
from ground.telemetry import Telemetry
from protocol.codec import decode
from protocol.enums import Command, GoalState, Mode, RunAction
from protocol.errors import RemoteError
from protocol.messages import CommandAck, NavigatorStatus, PlanarOdometry, RunRequest, RunScore
from protocol.outcome import Ended, Outcome, judged
from protocol.reasons import Reason
from protocol.topics import CYCLE, ODOMETRY, RUN, STATUS

READY_NS: Final = 15 * NS_PER_S
RETRY_NS: Final = 20_000_000
LOOK_NS: Final = 100_000_000
PAUSE_NS: Final = 2_000_000
ASK_S: Final = 2.0
REMEMBERED: Final = 20_000
WORTH_WAITING: Final = (Reason.NO_SENSES, Reason.TICKS_LOST, Reason.SCAN_LOST)


class NotRun(RemoteError):
    """The run came to nothing: why."""

    exit_code = 1


class Errand:
    """`check` raises when a process has died; `show` gets a line now and then."""

    def __init__(
        self, link: Link, scenario: Scenario, check: Callable[[], None], show: Callable[[str], None]
    ) -> None:
        self._link = link
        self._scenario = scenario
        self._check = check
        self._show = show
        self._telemetry = Telemetry(link.bus, link.robot, (STATUS, ODOMETRY, CYCLE))
        self._poses: deque[bytes] = deque(maxlen=REMEMBERED)
        link.bus.stream(ODOMETRY, lambda _key, frame, _at: self._poses.append(frame), link.robot)

    def run(self) -> Outcome:
        """Raises NotRun when there is nothing to judge."""
        scenario = self._scenario
        self._prepare()
        if not scenario.lockstep:
            self._start()  # so that the score begins with the goal
        request = goal_request(scenario.goal.on_the_wire(), self._link.ids.next(), Mode.AUTO)
        answered = self._link.ask(request)
        if scenario.lockstep:
            self._start()
        begun_ns = self._link.clock.now_ns()
        if answered.ok:
            status = self._follow(request.request_id, begun_ns)
        else:
            status = self._refused(answered)
        wall_s = (self._link.clock.now_ns() - begun_ns) / NS_PER_S
        return self._judge(status, wall_s)

    def _prepare(self) -> None:
        """Choose the navigator and arm: accepted as soon as senses are there."""
        navigator = float(NAVIGATORS[self._scenario.navigator])
        side = float(SIDES[self._scenario.side])
        self._insist(Command.SIDESTEP_SET_NAVIGATOR, navigator, side)
        self._insist(Command.COMPONENT_ARM_DISARM, 1.0)

    def _insist(self, command: Command, param1: float, param2: float = 0.0) -> None:
        clock = self._link.clock
        deadline_ns = clock.now_ns() + READY_NS
        while True:
            self._check()
            answered = self._link.ask(self._link.command(command, param1, param2))
            if answered.ok:
                return
            if answered.reason not in WORTH_WAITING or clock.now_ns() > deadline_ns:
                raise NotRun(f"{command.name.lower()} was refused: {why(answered)}")
            clock.sleep_until(clock.now_ns() + RETRY_NS)

    def _start(self) -> None:
        answer = self._ask_plant(RunRequest(until_ns=0, action=RunAction.START))
        if not isinstance(answer, CommandAck) or answer.result:
            raise NotRun("the plant would not start")

    def _ask_plant(self, request: RunRequest) -> object:
        return self._link.bus.ask(RUN, request, ASK_S, robot=self._link.robot)

    def _refused(self, answered: Answered) -> NavigatorStatus:
        """A refused goal is an outcome, too."""
        self._link.wait(lambda: self._telemetry.latest(STATUS) is not None, READY_NS)
        newest = self._telemetry.latest(STATUS)
        if newest is None:
            raise NotRun(f"the goal was refused: {why(answered)}")
        return newest[0]

    def _follow(self, goal_id: int, begun_ns: int) -> NavigatorStatus:
        """The first status seen in which the goal has ended or its time is up."""
        timeout_ns = round(self._scenario.timeout_s * NS_PER_S)
        watch = GoalWatch(goal_id, begun_ns, timeout_ns, stamps_only=True)
        shown_ns = begun_ns
        while True:
            now_ns = self._link.clock.now_ns()
            newest = self._telemetry.latest(STATUS)
            if newest is not None:
                watch.receive(*newest)
            watch.due(now_ns)
            if watch.end is not None and newest is not None:
                if watch.end.outcome == "timeout" or newest[0].goal_ended_ns:
                    return newest[0]
                self._check()
                raise NotRun(f"{watch.end.reason}: {self._link.diagnosis()}")
            if now_ns - shown_ns >= LOOK_NS:
                shown_ns = now_ns
                self._check()
                self._show(goal_line(self._telemetry, now_ns, watch.silent_ns(now_ns)))
            self._link.clock.sleep_until(now_ns + PAUSE_NS)

    def _judge(self, status: NavigatorStatus, wall_s: float) -> Outcome:
        timeout_ns = round(self._scenario.timeout_s * NS_PER_S)
        ended = status.goal in tuple(GoalState) and status.goal >= GoalState.REACHED
        until_ns = status.goal_ended_ns if ended else status.goal_started_ns + timeout_ns
        score = self._ask_plant(RunRequest(until_ns=until_ns, action=RunAction.SCORE))
        if not isinstance(score, RunScore):
            raise NotRun("the plant would not score the run")
        x_m, y_m = self._believed(until_ns)
        cycle = self._telemetry.latest(CYCLE)
        account = Ended(
            goal_state=status.goal,
            goal_reason=status.goal_reason,
            time_s=(until_ns - status.goal_started_ns) / NS_PER_S,
            estimate_x_m=x_m,
            estimate_y_m=y_m,
            wall_s=wall_s,
            missed_ticks=0 if cycle is None else cycle[0].missed,
        )
        return judged(self._scenario.asked(), account, score)

    def _believed(self, at_ns: int) -> tuple[float, float]:
        """Where the robot believed to be at that stamp, or as near to it as was heard."""
        nearest = (float("nan"), float("nan"))
        for frame in reversed(tuple(self._poses)):
            message = decode(frame).message
            if isinstance(message, PlanarOdometry):
                nearest = (message.x_m, message.y_m)
                if message.time_ns <= at_ns:
                    break
        return nearest
