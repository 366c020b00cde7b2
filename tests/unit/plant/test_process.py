"""The plant process: bounded requests, and a report of each turn."""

import threading
from collections.abc import Callable
from math import inf
from typing import cast

import pytest

from checks.harness.until import PATIENCE_S
from plant.model.configuration import LEVELS
from plant.process import MAX_ANSWERED, MAX_WAITING, Process, RequestQueue, Wake
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.services import ServiceRequest
from protocol.wire.enums import AckResult, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, RunRequest, RunScore
from protocol.wire.reasons import Reason
from runtime.clock import WallClock
from tests.support.each import each

SCORE = RunRequest(action=RunAction.SCORE, until_ns=0)


class Question:
    """A request, and the answers to it."""

    def __init__(self, message: Message | None = SCORE) -> None:
        self.message = message
        self.answers: list[Message | bytes] = []

    def reply(self, answer: Message | bytes) -> bool:
        self.answers.append(answer)
        return True


class Asking:
    """A request queue without a loop; `nudges` counts its wake-ups of the loop."""

    def __init__(self) -> None:
        self.nudges = 0
        self.desk = RequestQueue(running=False, world={"name": "open"}, nudge=self._nudge)
        self.plant = Plant(load("open"), 0, LEVELS["none"])

    def ask(self, *questions: Question) -> None:
        for question in questions:
            self.desk.ask(0, cast(ServiceRequest, question))

    def _nudge(self) -> None:
        self.nudges += 1


@pytest.fixture
def asking() -> Asking:
    return Asking()


def test_each_cycle_answers_a_few_requests_and_the_next_continues(asking: Asking) -> None:
    """Prevent a flood of requests from stopping simulated time."""
    questions = [Question() for _ in range(2 * MAX_ANSWERED)]
    asking.ask(*questions)
    before = asking.nudges
    for answered in (MAX_ANSWERED, 2 * MAX_ANSWERED):
        asking.desk.serve(asking.plant)
        assert [len(one.answers) for one in questions] == [
            int(number < answered) for number in range(len(questions))
        ]
    assert isinstance(questions[0].answers[0], RunScore)
    assert asking.nudges == before + 1, "the loop turns again for the rest, and not without one"


def test_excess_requests_are_rejected_and_the_first_answered(asking: Asking) -> None:
    questions = [Question() for _ in range(MAX_WAITING + 2)]
    asking.ask(*questions)
    assert [len(one.answers) for one in questions] == [0] * MAX_WAITING + [1, 1]
    refused = questions[-1].answers[0]
    assert isinstance(refused, CommandAck)
    assert refused.result == AckResult.TEMPORARILY_REJECTED
    assert refused.result_param2 == Reason.TOO_MANY_REQUESTS
    asking.desk.serve(asking.plant)
    late = Question()
    asking.ask(late)
    assert late.answers == [], "there is room again"


def test_world_request_is_answered_without_the_loop(asking: Asking) -> None:
    """Let an observer ask as often as it likes, without load on the plant's loop."""
    asking.ask(*[Question() for _ in range(MAX_WAITING)])
    before = asking.nudges
    worlds = [Question(None) for _ in range(MAX_WAITING)]
    asking.ask(*worlds)
    assert [one.answers for one in worlds] == [[b'{"name": "open"}']] * MAX_WAITING
    assert asking.nudges == before


SILENT_S = 0.02
TURNS = 3
SLOW = 0.0005
"""Times real time: a hundred seconds from one tick to the next."""


class Turns:
    """Ends the loop after a number of turns."""

    def __init__(self, wake: Wake) -> None:
        self.count = 0
        self._wake = wake

    def __call__(self) -> None:
        self.count += 1
        if self.count >= TURNS:
            self._wake.stop()


def ended(*, running: bool, drive: Callable[[Process], None]) -> int:
    """Return the number of turns before the loop ended; fail if it does not end."""
    wake = Wake()
    turns = Turns(wake)
    desk = RequestQueue(running=running, world={}, nudge=wake)
    plant = Plant(load("open"), 0, LEVELS["none"])
    process = Process(plant, [], desk, wake, SILENT_S, turn=turns)
    loop = threading.Thread(target=drive, args=(process,))
    loop.start()
    loop.join(PATIENCE_S)
    stuck = loop.is_alive()
    wake.stop()
    loop.join()
    assert not stuck
    return turns.count


@each("running", [True, False])
@each("speed", [inf, SLOW])
def test_loop_reports_progress_in_lockstep_paused_or_slow(running: bool, speed: float) -> None:
    assert ended(running=running, drive=lambda process: process.run_lockstep(speed)) >= TURNS


@each("running", [True, False])
def test_loop_reports_progress_in_wall_time(running: bool) -> None:
    assert ended(running=running, drive=lambda process: process.run_wall(WallClock())) >= TURNS


def test_wake_ups_without_a_waiter_do_not_accumulate() -> None:
    """Send a wake-up per command and request in wall time, where the loop never waits."""
    wake = Wake()
    for _ in range(10_000):
        wake()
    assert wake.wait(0.0)
    assert not wake.wait(0.0)
    wake()
    assert wake.wait(0.0), "and it is not deaf afterwards"


@each("called", [True, False])
def test_stop_wakes_the_loop(called: bool) -> None:
    wake = Wake()
    if called:
        wake()
    wake.stop()
    assert wake.wait(0.0)
    assert wake.stopping
