"""Goal runs of one robot and of several: order, restarts, end, and JSON."""

from collections.abc import Callable, Coroutine
from contextlib import closing
from dataclasses import replace
from typing import Any, Self, TypeVar, cast

import pytest
from msgspec import structs

from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from ground.client.connection import Common
from ground.client.goal import destination
from ground.client.leases import Leasing
from ground.client.requests import ATTEMPTS
from ground.client.robot_link import UnansweredError
from ground.launch.fleet_run import FleetRun, as_json, in_words
from ground.launch.goal_run import IDLE_S, READY_NS, RESTART_WAIT_NS, GoalRun, NoOutcomeError
from ground.launch.scenario import WALL, Scenario, ScenarioRobot
from ground.launch.supervisor import VoidRun
from ground.robot import Robot
from ground.text.wording import Part
from protocol.bus.network import Network
from protocol.outcome import RunOutcome
from protocol.topic import Service
from protocol.topics import LEASE, STATUS, TRUTH
from protocol.wire.enums import AckResult, Command, GoalState, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseStatus,
    NavigatorStatus,
    RunRequest,
    RunScore,
)
from protocol.wire.reasons import Reason
from protocol.world import WorldRun
from runtime.clock import Clock, ManualClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S as SECOND
from tests.support.each import each
from tests.support.ground.made_recordings import truth
from tests.support.plant import plain_world
from tests.support.played_bus import PlayedBus

T = TypeVar("T")
SILENT = "no process answers"
RUN = WorldRun(world=plain_world("open", (10.0, 10.0), (1.0, 1.0), (9.0, 9.0), shortest_path_m=1.0))
SCENARIO = Scenario(
    world="open", name="open", run=RUN, scenario_robots=(), navigator="vgm", side="left",
    seed=0, noise="none", speed="1", router=False, record=None, timeout_s=100.0,
)  # fmt: skip
OTHER = 9
SCORE = make(RunScore, time_ns=1, x_m=1.0, y_m=1.0, path_m=1.0, min_clearance_m=1.0, ticks=20)
WHY = "the plant process was killed (signal SIGKILL)"


class Wired(PlayedBus):
    """A bus whose first `serves_after` requests get no answer."""

    has_history = True

    def __init__(self, clock: ManualClock) -> None:
        super().__init__(clock)
        self.commands: list[Command] = []

    serves_after = 1000
    requests = 0
    score_until_ns: list[int] | None = None
    """The stamps for which a score was asked; None: the plant does not answer."""
    refusals: tuple[int, ...] = ()
    """Reasons for which the next goals are refused."""
    on_refusal: Callable[[], None] = staticmethod(lambda: None)

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        self.requests += 1
        if isinstance(message, RunRequest) and self.score_until_ns is not None:
            self.score_until_ns.append(message.until_ns)
            return SCORE
        if self.requests <= self.serves_after:
            raise NoAnswerError(SILENT)
        if isinstance(message, GoalRequest):
            refused, self.refusals = self.refusals[:1], self.refusals[1:]
            self.on_refusal()
            return CommandAck(
                command=Command.DO_REPOSITION,
                result=AckResult.DENIED if refused else AckResult.ACCEPTED,
                result_param2=refused[0] if refused else 0,
            )
        assert isinstance(message, CommandRequest)
        self.commands.append(Command(message.command))
        return CommandAck(command=message.command, result=AckResult.ACCEPTED)


class Dialled(Robot):
    """A robot that answers at once."""

    async def answer(
        self, service: Service, message: Message | None, timeout_s: float
    ) -> Message | bytes:
        return self.bus.ask(service, message, timeout_s)

    async def in_own_thread(self, job: Callable[[], T]) -> T:
        return job()

    async def diagnosis(self) -> str:
        return "it hangs"


def ran(work: Coroutine[Any, Any, T], clock: Clock) -> T:
    with closing(PlayedLoop(clock)) as loop:
        return loop.run(work)


class Stage:
    """A goal run and the messages it receives."""

    def __init__(self, *, lockstep: bool = False) -> None:
        self.clock = ManualClock(SECOND)
        self.bus = Wired(self.clock)
        self.void: VoidRun | None = None
        network = Network(mode="client", connect=("tcp/127.0.0.1:1",))
        common = Common(network=network, robot="r1")
        robot = Dialled(self.bus, common, clock=self.clock, leasing=Leasing.NEVER)
        goal = destination([3.0, 2.0])
        scenario_robot = ScenarioRobot(robot="r1", start=(0.0, 0.0, 0.0), goal=goal)
        scenario = SCENARIO if lockstep else replace(SCENARIO, clock=WALL)
        self.goal_run = GoalRun(robot, scenario, scenario_robot, lambda: None, lambda: self.void)

    @classmethod
    def begun(cls, *, lockstep: bool = False) -> Self:
        stage = cls(lockstep=lockstep)
        stage.run(stage.goal_run.begin())
        return stage

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        return ran(work, self.clock)

    def receive(
        self,
        goal: GoalState,
        ended_ns: int = 0,
        vehicle: Vehicle = Vehicle.ACTIVE,
        reason: Reason = Reason.NONE,
        **changes: Any,
    ) -> None:
        status = make(
            NavigatorStatus, time_ns=self.clock.now_ns(), goal_started_ns=SECOND,
            goal_ended_ns=ended_ns, goal_x_m=3.0, goal_y_m=2.0, goal_distance_m=1.0,
            vehicle=vehicle, mode=10, goal=goal, vehicle_reason=reason,
            goal_reason=Reason.TICKS_LOST, navigator=1,
        )  # fmt: skip
        status = structs.replace(status, **changes)
        self.bus.say(STATUS, status)

    def lease(self, held: bool, **changes: Any) -> None:
        lease = LeaseStatus(time_ns=1, lapses_ms=0, held=int(held), holder="ben/1", name="ben")
        lease = structs.replace(lease, **changes)
        self.bus.say(LEASE, lease)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.clock.advance(SECOND // 10)
            self.run(self.goal_run.look())


def test_prepare_retries_until_the_robot_answers() -> None:
    stage = Stage()
    stage.bus.serves_after = 3 * ATTEMPTS
    stage.run(stage.goal_run.prepare())
    assert stage.bus.requests == 3 * ATTEMPTS + 2


def test_prepare_gives_up_on_a_silent_robot() -> None:
    stage = Stage()
    with pytest.raises(UnansweredError, match=SILENT):
        stage.run(stage.goal_run.prepare())
    assert READY_NS < stage.clock.now_ns() - SECOND < 2 * READY_NS


def sent(vehicle: Vehicle, reason: Reason, *refusals: int) -> Stage:
    """Return a stage whose robot, in this state, has refused as many goals."""
    stage = Stage()
    stage.bus.serves_after, stage.bus.refusals = 0, refusals
    stage.bus.on_refusal = lambda: stage.receive(GoalState.NONE, vehicle=vehicle, reason=reason)
    stage.run(stage.goal_run.send())
    return stage


@each("reason", [Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.NO_SENSES, Reason.BUDGET])
def test_a_robot_that_a_failsafe_disarmed_before_its_goal_is_armed_again(reason: Reason) -> None:
    stage = sent(Vehicle.FAILSAFE, reason, Reason.NOT_ARMED, Reason.NOT_ARMED)
    assert stage.goal_run.refusal == ""
    assert stage.bus.commands == [Command.COMPONENT_ARM_DISARM] * 2


@each(
    ("vehicle", "reason", "refusal"),
    [
        (Vehicle.STANDBY, Reason.NONE, Reason.NOT_ARMED),  # somebody has disarmed it
        (Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR, Reason.EMERGENCY_STOPPED),
        (Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR, Reason.NOT_ARMED),
        (Vehicle.FAILSAFE, Reason.OPERATOR_LOST, Reason.NOT_ARMED),
        (Vehicle.ACTIVE, Reason.NONE, Reason.GOAL_OUT_OF_RANGE),
    ],
)
def test_no_other_refusal_arms_a_robot(vehicle: Vehicle, reason: Reason, refusal: Reason) -> None:
    stage = sent(vehicle, reason, refusal)
    assert stage.goal_run.refusal
    assert stage.bus.commands == []


def test_run_waits_for_a_plant_restart_then_is_void() -> None:
    stage = Stage.begun()
    stage.receive(GoalState.ABORTED, ended_ns=2 * SECOND)
    stage.wait(3.0)
    stage.void = VoidRun(WHY, is_final=False)
    stage.wait(1.0)
    assert not stage.goal_run.is_over
    assert [part.text for part in stage.goal_run.line()] == [WHY]
    stage.void = VoidRun(f"{WHY}; it is back", is_final=True)
    stage.wait(0.1)
    assert stage.goal_run.is_over
    assert stage.goal_run.void_reason == f"{WHY}; it is back"
    assert stage.goal_run.outcome is None


def test_run_fails_when_the_plant_stays_away() -> None:
    stage = Stage.begun()
    stage.receive(GoalState.ABORTED, ended_ns=2 * SECOND)
    stage.wait(RESTART_WAIT_NS / SECOND)
    with pytest.raises(NoOutcomeError, match=SILENT):
        stage.wait(0.2)


def test_run_waits_for_a_restart_of_a_silent_robot() -> None:
    stage = Stage.begun()
    stage.receive(GoalState.DRIVING)
    stage.wait(3.0 + RESTART_WAIT_NS / SECOND)
    with pytest.raises(NoOutcomeError, match="no message from the robot for 3"):
        stage.wait(0.2)


def replaced_run(*, held: bool = True) -> Stage:
    """Return a stage whose goal somebody else's goal has replaced."""
    stage = Stage.begun()
    stage.bus.score_until_ns = []
    stage.receive(GoalState.DRIVING)
    stage.wait(0.2)
    driving_ns = stage.clock.now_ns()
    stage.receive(GoalState.DRIVING)
    stage.wait(0.1)
    stage.lease(held, drive_id=OTHER, driver="ben@desk:pts/2")
    stage.receive(GoalState.DRIVING, goal_id=OTHER, goal_x_m=1.26, goal_y_m=2.0)
    stage.wait(0.1)
    assert stage.goal_run.outcome is not None
    assert stage.bus.score_until_ns == [driving_ns], "judged until its own goal was replaced"
    return stage


def test_goal_that_was_replaced_before_it_was_shown_is_no_lost_robot() -> None:
    stage = Stage.begun()
    stage.bus.score_until_ns = []
    for _ in range(32):
        stage.receive(GoalState.REACHED, goal_id=OTHER)
        stage.wait(0.1)
    outcome = stage.goal_run.outcome
    assert outcome is not None
    assert (outcome.outcome, outcome.reason, outcome.time_s) == ("replaced", "by another", 0.0)


def test_goal_of_somebody_else_is_not_taken_for_ours() -> None:
    stage = replaced_run()
    outcome = stage.goal_run.outcome
    assert outcome is not None
    assert (outcome.outcome, outcome.reason) == (
        "replaced",
        "by the goal 1.3 2.0 of ben@desk:pts/2",
    )
    assert not outcome.reached
    assert outcome.text().startswith("replaced by the goal 1.3 2.0 of ben@desk:pts/2 in open with ")


def ends_after_the_idle_time(stage: Stage, line: str) -> None:
    """Two goals of a shell have nothing between them: no drive and no lease."""
    stage.wait(IDLE_S - 1.0)
    assert not stage.goal_run.is_over
    assert stage.goal_run.line()[0].text == f"{line} 1 s"
    stage.wait(1.0)
    assert stage.goal_run.is_over
    assert stage.goal_run.ending == (
        "r1: nothing driven and no lease held for 30 s, so the run ends"
    )


def test_run_goes_on_when_the_next_goal_comes_in_time() -> None:
    stage = replaced_run(held=False)
    for _ in range(3):
        stage.receive(GoalState.REACHED, goal_id=OTHER)
        stage.wait(IDLE_S - 1.0)
        assert not stage.goal_run.is_over
        stage.receive(GoalState.DRIVING, goal_id=OTHER)
        stage.wait(0.1)


def test_run_goes_on_while_an_operator_drives_or_holds_the_lease() -> None:
    stage = replaced_run()
    for goal in (GoalState.DRIVING, GoalState.REACHED):
        stage.receive(goal, goal_id=OTHER)
        stage.wait(30.0)
        assert not stage.goal_run.is_over
        assert stage.goal_run.line()[0].text == "goal replaced, an operator commands"
    stage.lease(False)
    ends_after_the_idle_time(stage, "goal replaced, ends in")
    assert stage.bus.score_until_ns is not None
    assert len(stage.bus.score_until_ns) == 1


@each(
    ("goal", "mode", "vehicle", "is_over"),
    [
        (GoalState.DRIVING, Mode.GUIDED, Vehicle.ACTIVE, False),
        (GoalState.ABORTED, Mode.MANUAL, Vehicle.ACTIVE, False),
        (GoalState.DRIVING, Mode.HOLD, Vehicle.ACTIVE, True),
        (GoalState.DRIVING, Mode.GUIDED, Vehicle.FAILSAFE, True),
        (GoalState.REACHED, Mode.GUIDED, Vehicle.ACTIVE, True),
    ],
)
def test_run_without_a_lease_goes_on_while_the_robot_is_driven(
    goal: GoalState, mode: Mode, vehicle: Vehicle, is_over: bool
) -> None:
    stage = replaced_run(held=False)
    stage.receive(goal, goal_id=OTHER, mode=mode, vehicle=vehicle)
    stage.wait(IDLE_S + 0.1)
    assert stage.goal_run.is_over == is_over


def test_run_goes_on_after_an_operator_has_taken_the_robot_by_hand() -> None:
    stage = Stage.begun()
    stage.bus.score_until_ns = []
    stage.lease(True)
    ended_ns = stage.clock.now_ns()
    stage.receive(
        GoalState.ABORTED, ended_ns=ended_ns, mode=Mode.MANUAL, goal_reason=Reason.BY_OPERATOR
    )
    stage.wait(1.0)
    outcome = stage.goal_run.outcome
    assert outcome is not None
    assert (outcome.outcome, outcome.reason) == ("aborted", "by the operator")
    assert not stage.goal_run.is_over
    stage.receive(GoalState.ABORTED, ended_ns=ended_ns, mode=Mode.HOLD)
    stage.lease(False)
    ends_after_the_idle_time(stage, "goal aborted, ends in")


@each(
    ("reason", "words", "vehicle"),
    [
        (Reason.BY_OPERATOR, "by the operator", Vehicle.ACTIVE),
        (Reason.DISARMED, "disarmed by the operator", Vehicle.STANDBY),
        (Reason.BY_EMERGENCY_STOP, "by the emergency stop", Vehicle.EMERGENCY_STOP),
    ],
)
def test_goal_that_another_person_ends_leaves_time_for_the_next(
    reason: Reason, words: str, vehicle: Vehicle
) -> None:
    """None of these needs the lease, so nobody may have it."""
    stage = Stage.begun()
    stage.bus.score_until_ns = []
    ended_ns = stage.clock.now_ns()
    stage.receive(GoalState.ABORTED, ended_ns=ended_ns, goal_reason=reason, vehicle=vehicle)
    stage.wait(0.1)
    outcome = stage.goal_run.outcome
    assert outcome is not None
    assert (outcome.outcome, outcome.reason, outcome.reached) == ("aborted", words, False)
    ends_after_the_idle_time(stage, "goal aborted, ends in")


def test_failsafe_ends_the_run_at_once() -> None:
    stage = Stage.begun()
    stage.bus.score_until_ns = []
    ended_ns = stage.clock.now_ns()
    stage.receive(
        GoalState.ABORTED, ended_ns=ended_ns, goal_reason=Reason.BUMPER, vehicle=Vehicle.FAILSAFE
    )
    stage.wait(0.1)
    assert stage.goal_run.is_over
    assert stage.goal_run.ending == ""


def test_reached_goal_ends_the_run_whoever_holds_the_lease() -> None:
    stage = Stage.begun()
    stage.bus.score_until_ns = []
    stage.lease(True)
    stage.receive(GoalState.REACHED, ended_ns=2 * SECOND, goal_reason=Reason.NONE)
    stage.wait(0.1)
    assert stage.goal_run.is_over


def test_progress_says_that_the_computer_is_busy() -> None:
    stage = Stage.begun(lockstep=True)
    said = []
    for tick in range(30):
        seen = truth(tick * SECOND // 20, 1.0)
        stage.receive(GoalState.DRIVING)
        stage.bus.say(TRUTH, seen)
        stage.wait(0.1)
        said.append(stage.goal_run.pace().text)
    assert said[0] == ""
    assert said[-1] == "SIM 0.5x, computer busy"


REACHED = RunOutcome(
    world="box",
    navigator="vgm",
    seed=0,
    noise="none",
    wall_s=1.0,
    outcome="reached",
    reason="ok",
    time_s=10.0,
    path_m=3.0,
    shortest_path_m=None,
    position_error_m=0.01,
    heading_error_rad=None,
    estimated_position_error_m=0.0,
    min_clearance_m=0.2,
    contacts=0,
    own_contacts=0,
    ticks=200,
    missed_ticks=0,
    digest="00",
)


class RecordedRun(GoalRun):
    """A goal run that records its calls and ends after some rounds."""

    def __init__(self, name: str, looks: int, calls: list[str]) -> None:
        self.name = name
        self.outcome = self._commanded_ns = None
        self.void_reason = ""
        self._looks = looks
        self._calls = calls
        self.waits = 0

    async def prepare(self, *, arms: bool = True) -> None:
        self._calls.append(f"prepare {self.name}")

    async def start(self) -> None:
        self._calls.append("start")

    async def pause(self) -> None:
        self._calls.append("pause")

    async def send(self) -> None:
        self._calls.append(f"send {self.name}")

    async def begin(self) -> None:
        self._calls.append(f"begin {self.name}")

    async def wait(self, patience_ns: int) -> None:
        self.waits += 1

    async def look(self) -> None:
        self._looks -= 1
        if self._looks == 0:
            self.outcome = replace(REACHED, path_m=float(len(self.name)))

    def line(self) -> list[Part]:
        return [Part(self.name), Part("alone")]

    def time(self) -> Part:
        return Part("3 s")

    def pace(self) -> Part:
        return Part("SIM 0.5x, computer busy" if len(self.name) > 2 else "")

    def short_line(self) -> Part:
        return Part(f"{self.name} {'there' if self.outcome else 'on its way'}")


def fleet_run(
    *looks: int, check: Callable[[], None] = lambda: None
) -> tuple[FleetRun, list[str], list[list[Part]]]:
    calls: list[str] = []
    shown: list[list[Part]] = []
    goal_runs = [RecordedRun(f"r{number + 1}", count, calls) for number, count in enumerate(looks)]
    return FleetRun(goal_runs, ManualClock(), check, shown.append), calls, shown


def ended(run: FleetRun, **how: Any) -> list[RunOutcome]:
    """Run it to its end, on its own clock."""
    return ran(run.run(**how), run._clock)


def test_lockstep_sends_all_goals_before_start() -> None:
    run, calls, _ = fleet_run(1, 1)
    ended(run, lockstep=True)
    assert calls == [
        "prepare r1",
        "prepare r2",
        "send r1",
        "send r2",
        "start",
        "begin r1",
        "begin r2",
        "pause",
    ]


def test_follows_by_the_messages_of_a_robot_that_has_not_ended() -> None:
    run, _, _ = fleet_run(1, 4)
    ended(run, lockstep=False)
    waits = [cast("RecordedRun", one).waits for one in run._goal_runs]
    assert waits == [0, 3], "each look but the last is followed by one wait"


def test_wall_time_starts_the_score_before_the_goals() -> None:
    run, calls, _ = fleet_run(1, 1)
    ended(run, lockstep=False)
    assert calls[2:5] == ["start", "send r1", "send r2"]
    assert "pause" not in calls


def test_fleet_run_ends_with_the_last_robot() -> None:
    run, _, shown = fleet_run(200, 3)
    assert len(ended(run, lockstep=True)) == 2
    assert [part.text for part in shown[0]] == ["r1 on its way", "r2 there", "3 s", ""]
    assert [part.text for part in shown[-1]] == ["r1 there", "r2 there", "3 s", ""]


def test_single_robot_uses_the_full_line() -> None:
    run, _, shown = fleet_run(1)
    ended(run, lockstep=True)
    assert [part.text for part in shown[-1]] == ["r1", "alone", ""]


def test_exit_of_a_process_ends_the_run() -> None:
    def check() -> None:
        raise NoOutcomeError("gone")

    with pytest.raises(NoOutcomeError, match="gone"):
        ended(fleet_run(5, check=check)[0], lockstep=True)


def test_restart_voids_the_trial_after_others_arrive() -> None:
    run, calls, shown = fleet_run(50, 3)
    lost = run._goal_runs[1]
    lost.void_reason = "the robot r2 process was killed (signal SIGKILL)"
    with pytest.raises(NoOutcomeError, match=r"no valid trial: .* \(signal SIGKILL\); r1 there"):
        ended(run, lockstep=False, launched=lambda: calls.append("launched"))
    assert calls[5:] == ["launched", "begin r1", "begin r2"]
    assert shown[-1][0].text == "r1 there"


def test_single_outcome_is_printed_alone() -> None:
    assert as_json(["r1"], [REACHED]) == REACHED.as_json()
    assert in_words(["r1"], [REACHED]) == REACHED.text()


def test_several_outcomes_extend_the_first() -> None:
    stuck = replace(REACHED, outcome="stuck")
    found = as_json(["r1", "r2"], [REACHED, stuck])
    robots = found.pop("robots")
    assert found == REACHED.as_json()
    assert robots == [{"robot": "r1", **REACHED.as_json()}, {"robot": "r2", **stuck.as_json()}]
    assert "r2: " in in_words(["r1", "r2"], [REACHED, stuck])
