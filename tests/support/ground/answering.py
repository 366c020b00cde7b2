"""A link whose robot answers from a list, on a manual clock."""

from collections.abc import Callable
from io import StringIO
from typing import Any, cast

from ground.client.link import Link
from ground.client.requests import RequestIds
from ground.client.results import Accepted, Answer, Refused
from ground.text.output import Output
from protocol.wire.enums import Command
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock

MS = 1_000_000
ANSWER_NS = 10 * MS


class AnsweringLink:
    """Accepts every request once the list is empty; every answer takes 10 ms."""

    robot = "r1"

    def __init__(self, *answers: Reason) -> None:
        self.answers = list(answers)
        self.newest_messages: dict[str, Message] = {}
        """By path of the topic, what the robot output whenever somebody listens."""
        self.asked: list[Message] = []
        self.beats = 0
        self.clock = ManualClock()
        self.ids = RequestIds()

    def as_link(self) -> Link:
        return cast(Link, self)

    def command(self, command: Command, param1: float = 0.0, param2: float = 0.0) -> CommandRequest:
        return CommandRequest(
            request_id=self.ids.next(), param1=param1, param2=param2, command=command
        )

    def ask(self, request: Message, **_: Any) -> Answer:
        self.asked.append(request)
        self.clock.advance(ANSWER_NS)
        reason = self.answers.pop(0) if self.answers else Reason.NONE
        return Accepted(ANSWER_NS) if reason is Reason.NONE else Refused(reason, ANSWER_NS)

    def beat(self) -> None:
        self.beats += 1

    def newest(self, topic: Any, patience_ns: int) -> Message | None:
        if topic.path not in self.newest_messages:
            self.clock.advance(patience_ns)
        return self.newest_messages.get(topic.path)

    @property
    def commands(self) -> list[int]:
        return [one.command for one in self.asked if isinstance(one, CommandRequest)]


def captured_output() -> tuple[Output, Callable[[], tuple[str, str]]]:
    """Return an output that writes to memory, and a function that returns result and notes."""
    out, err = StringIO(), StringIO()
    return Output(as_json=False, out=out, err=err), lambda: (out.getvalue(), err.getvalue())
