"""What a station needs of a bus: to look it must hear, to command it must also speak."""

from collections.abc import Callable, Iterable
from typing import Any, Protocol, TypeVar, runtime_checkable

from ground.client.emergency_stop import MessagePublisher as MessagePublisher
from ground.client.emergency_stop import ServiceCaller
from ground.client.telemetry import FrameHandler
from protocol.bus.mailbox import Mailbox
from protocol.bus.network import Hub
from protocol.topics import Topic
from protocol.wire.message import Message

M = TypeVar("M", bound=Message)


class Token(Protocol):
    """Somebody's liveliness token."""

    @property
    def robot(self) -> str: ...
    @property
    def role(self) -> str: ...
    @property
    def zid(self) -> str: ...


class ReadableBus(ServiceCaller, Protocol):
    """A bus that can be listened to: a live one, or one that plays a log."""

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: FrameHandler | None = None,
    ) -> Mailbox[M]: ...
    def present(self) -> Iterable[Token]: ...


@runtime_checkable
class LiveBus(ReadableBus, Protocol):
    """A live bus: who has it can be an operator."""

    @property
    def zid(self) -> str: ...
    @property
    def operator(self) -> str | None: ...
    def publisher(self, topic: Topic[M], robot: str | None = None) -> MessagePublisher[M]: ...
    def announce(self, robot: str | None = None) -> None: ...
    def watch(self, handler: Callable[[Any, bool], None]) -> None: ...
    def hub(self) -> Hub: ...
    def kept_out(self) -> str: ...
