"""The world and the parameters are asked for until somebody tells them, and then no more."""

from ground.recording.metadata import MetadataReader
from protocol.topics import PARAMETERS, WORLD, Service
from protocol.wire.message import Message
from protocol.wire.messages import Statustext
from runtime.errors import NoAnswer

S = 1_000_000_000


class Stage:
    """Answers what the test wants known by now."""

    def __init__(self) -> None:
        self.answers: dict[str, Message | bytes] = {}
        self.asked: list[str] = []

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        assert (message, robot) == (None, "r1")
        self.asked.append(service.path)
        if service.path not in self.answers:
            raise NoAnswer("nobody serves it")
        return self.answers[service.path]


def test_each_fact_is_learned_once_however_late_it_can_be_told() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    assert facts.learned(0) == {}
    stage.answers[PARAMETERS.path] = b"[]"
    assert facts.learned(1 * S) == {"parameters": "[]"}
    stage.answers[WORLD.path] = b"{}"
    assert facts.learned(10 * S) == {"world": "{}"}
    stage.asked.clear()
    assert facts.learned(100 * S) == {}
    assert stage.asked == []


def test_it_does_not_ask_at_every_turn() -> None:
    stage = Stage()
    facts = MetadataReader(stage, "r1")
    for tick in range(240):
        facts.learned(tick * S // 4)
    assert len(stage.asked) < 40


def test_an_answer_that_is_no_text_is_no_fact() -> None:
    stage = Stage()
    stage.answers = {WORLD.path: b"\xff\xfe", PARAMETERS.path: Statustext(severity=1, text="no")}
    assert MetadataReader(stage, "r1").learned(0) == {}
