"""An attacker on the bus of a stack: a bare session with its own frames and names."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Self

import zenoh
from zenoh.handlers import Callback

from checks.harness.in_process import InProcess
from protocol.bus.network import Network
from protocol.bus.robot_clock import time_bytes
from protocol.bus.session import open_session
from protocol.topics import COMMAND, ENCODING, Service, Topic
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import Command
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest
from protocol.wire.reasons import Reason
from tests.support.until import PATIENCE_S, until

EVE = "eve/0123456789abcdef"


class Reply:
    """Result of a request; `reason` is None until there is an answer."""

    def __init__(self) -> None:
        self.answers: list[Message] = []
        self.over = False

    def take(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self.answers.append(decode(reply.ok.payload.to_bytes()).message)

    @property
    def reason(self) -> Reason | None:
        for answer in self.answers:
            assert isinstance(answer, CommandAck)
            return Reason(answer.result_param2)
        return None


class Attacker:
    """Calls itself what it likes: keys are its own to choose on an open bus."""

    def __init__(self, network: Network, name: str = EVE) -> None:
        self.name = name
        self._session = open_session(network)
        self._encoder = Encoder(255, 190)
        self._prefix = f"{network.prefix}/r1"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        session: Any = self._session
        session.close()

    def listen(self, topic: Topic[Any]) -> list[Message]:
        """Subscribe to a topic of the robot."""
        heard: list[Message] = []

        def take(sample: zenoh.Sample) -> None:
            heard.append(decode(sample.payload.to_bytes()).message)

        key = f"{self._prefix}/{topic.path}"
        self._session.declare_subscriber(key, Callback(take, indirect=False))
        return heard

    def key(self, of: Topic[Any] | Service, name: str | None = None) -> str:
        """Return the key of a topic or service, with the name of its sender where it has one."""
        path = f"{self._prefix}/{of.path}"
        return f"{path}/{name or self.name}" if of.of_operators else path

    def put(self, topic: Topic[Any], message: Message | bytes, name: str | None = None) -> None:
        frame = message if isinstance(message, bytes) else self._encoder.encode(message)
        self._session.put(self.key(topic, name), frame, encoding=ENCODING)

    def ask(
        self,
        request: Message,
        until_ns: int | None,
        service: Service = COMMAND,
        name: str | None = None,
    ) -> Reply:
        """Ask, and go on at once; the request counts until this time of the robot's clock."""
        reply = Reply()
        self._session.get(
            self.key(service, name),
            Callback(reply.take, indirect=False),
            payload=self._encoder.encode(request),
            encoding=ENCODING,
            attachment=None if until_ns is None else time_bytes(until_ns),
            timeout=PATIENCE_S,
        )
        return reply


@contextmanager
def attacked(world: str = "open") -> Iterator[tuple[InProcess, Attacker]]:
    """Start a stack and an attacker on its bus."""
    with InProcess(world) as stack, Attacker(stack.client_network) as attacker:
        yield stack, attacker


def answered(stack: InProcess, *replies: Reply) -> None:
    """Let the robot's loop go round, without any time, until all of them have an answer."""

    def all_answered() -> bool:
        assert stack.robot is not None
        stack.robot.idle()
        return all(reply.answers for reply in replies)

    until(all_answered)


def order(request_id: int, command: Command, param1: float = 0.0) -> CommandRequest:
    return CommandRequest(request_id=request_id, param1=param1, param2=0.0, command=command)
