"""The world and the parameters are requested until they are answered."""

from functools import partial

from ground.recording.metadata import MetadataReader
from protocol.topics import PARAMETERS, WORLD, Service
from protocol.wire.message import Message
from protocol.wire.messages import Statustext
from runtime.errors import NoAnswerError

S = 1_000_000_000


class Stage:
    """A bus that serves the given answers."""

    def __init__(self) -> None:
        self.answers: dict[str, Message | bytes] = {}
        self.requested: list[str] = []
        self.needs_s = 0.0

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        assert (message, robot) == (None, "r1")
        self.requested.append(service.path)
        if service.path not in self.answers:
            raise NoAnswerError("no process answers")
        if self.needs_s > timeout_s:
            raise NoAnswerError("no answer in time")
        return self.answers[service.path]


def test_each_fact_is_returned_once() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    assert facts.poll(0) == {}
    stage.answers[PARAMETERS.path] = b"[]"
    assert facts.poll(1 * S) == {"parameters": "[]"}
    stage.answers[WORLD.path] = b"{}"
    assert facts.poll(10 * S) == {"world": "{}"}
    stage.requested.clear()
    assert facts.poll(100 * S) == {}
    assert stage.requested == []


def test_missing_facts_are_requested_at_the_end() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    assert facts.poll(0) == {}
    stage.answers = {PARAMETERS.path: b"[]", WORLD.path: b"{}"}
    assert facts.poll(S // 10) == {}  # not due
    assert facts.request_missing() == {"parameters": "[]", "world": "{}"}
    assert facts.request_missing() == {}


def test_a_busy_machine_and_the_end_of_a_recording_get_more_time() -> None:
    for busy, needs_s in ((4.0, 0.7), (1.0, 0.9)):
        stage = Stage()
        stage.answers, stage.needs_s = {PARAMETERS.path: b"[]", WORLD.path: b"{}"}, needs_s
        facts = MetadataReader(stage, "r1", partial(float, busy))
        found = facts.poll(0)
        assert len(found) == (2 if busy > 1.0 else 0)
        assert len(found | facts.request_missing()) == 2


def test_requests_are_rate_limited() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    for tick in range(240):
        facts.poll(tick * S // 4)
    assert len(stage.requested) < 40


def test_malformed_answer_is_ignored() -> None:
    stage = Stage()
    stage.answers = {WORLD.path: b"\xff\xfe", PARAMETERS.path: Statustext(severity=1, text="no")}
    assert MetadataReader(stage, "r1").poll(0) == {}
