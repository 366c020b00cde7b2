"""Requests to the plant: their number is bounded, and a few are answered in each cycle."""

from typing import cast

import pytest

from plant.model.configuration import LEVELS
from plant.process.loop import MAX_ANSWERED, MAX_WAITING, RequestQueue
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.bus.services import ServiceRequest
from protocol.wire.enums import AckResult, RunAction
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, RunRequest, RunScore
from protocol.wire.reasons import Reason

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
