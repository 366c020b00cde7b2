"""Sees the truth at the plant itself, and the rest at the router: what is cut off is still seen."""

from collections.abc import Iterator
from contextlib import ExitStack
from time import monotonic_ns
from typing import Any, Final, NamedTuple, Self

from ground.client.emergency_stop import EmergencyStop
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, Tls
from protocol.topics import COMMAND, PARAMETER, STATUS, STOP, TRUTH, Role, Service, Topic
from protocol.wire.codec import decode
from protocol.wire.enums import PARAM_TYPE_REAL32, AckResult, Command, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GroundTruth,
    NavigatorStatus,
    ParamSet,
)
from runtime.clock import WallClock
from runtime.errors import NoAnswer, RemoteError
from runtime.units import NS_PER_S
from verification.harness.motion import Seen

DIAL_S: Final = 20.0
GIVE_UP_NS: Final = 10_000_000_000
ROBOT: Final = "r1"


class Heard(NamedTuple):
    """A message and when it arrived, by the monotonic clock."""

    message: Any
    at_ns: int


class Witness:
    """Dials when it is entered; keeps all there is."""

    def __init__(self, router: str, truth: str, tls: Tls | None = None) -> None:
        self._endpoints = (router, truth)
        self._tls = tls
        self._scope = ExitStack()
        self.truths: list[Heard] = []
        self.statuses: list[Heard] = []

    def __enter__(self) -> Self:
        router, truth = self._endpoints
        self._bus = self._listen(router, STATUS, self.statuses)
        self._stop = self._bus.publisher(STOP)
        self._listen(truth, TRUTH, self.truths)
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    def join(self, role: Role) -> Bus:
        """One more at the router."""
        return self._open(self._endpoints[0], role)

    def _open(self, endpoint: str, role: Role) -> Bus:
        network = Network(
            mode="client", connect=(endpoint,), tls=self._tls, connect_timeout_s=DIAL_S
        )
        return self._scope.enter_context(open_bus(network, role, ROBOT))

    def _listen(self, endpoint: str, topic: Topic[Any], into: list[Heard]) -> Bus:
        bus = self._open(endpoint, Role.GROUND)

        def keep(_key: str, frame: bytes, arrived_ns: int) -> None:
            try:
                into.append(Heard(decode(frame).message, arrived_ns))
            except RemoteError:
                return

        bus.stream(topic, keep)
        return bus

    @property
    def status(self) -> NavigatorStatus | None:
        newest: NavigatorStatus | None = self.statuses[-1].message if self.statuses else None
        return newest

    @property
    def speed_m_s(self) -> float:
        return float(self.truths[-1].message.speed_m_s) if self.truths else 0.0

    def is_in(self, *vehicle: Vehicle) -> bool:
        """Does the robot say that it is in one of these states?"""
        return self.status is not None and self.status.vehicle in vehicle

    def known_ns(self, since_ns: int) -> int | None:
        """When it was first heard, after a moment, that the robot does not drive any more."""
        heard = (one for one in tuple(self.statuses) if one.at_ns >= since_ns)
        return next((one.at_ns for one in heard if one.message.vehicle != Vehicle.ACTIVE), None)

    def seen(self, since_ns: int) -> list[Seen]:
        """The truth from a moment on and the one before it, by the plant's own stamps: a truth
        that was long on its way is no later for that."""
        heard = tuple(self.truths)
        early = [one for one in heard if one.at_ns < since_ns]
        offset_ns = min((one.at_ns - one.message.time_ns for one in early), default=0)
        return list(after(heard, offset_ns, since_ns))

    def estop(self) -> None:
        self._ask(
            COMMAND,
            CommandRequest(
                request_id=monotonic_ns(),
                param1=1.0,
                param2=0.0,
                command=Command.DO_FLIGHTTERMINATION,
            ),
        )

    def press(self) -> None:
        """The app's stop. Raises RuntimeError when it is not acknowledged."""
        stop = EmergencyStop(self._bus, self._stop, ROBOT, WallClock(), self._newest)
        outcome = stop.run(give_up_ns=GIVE_UP_NS)
        if not outcome.acknowledged:
            raise RuntimeError(f"the stop was not acknowledged: {outcome.why}")

    def _newest(self) -> tuple[NavigatorStatus, int] | None:
        return self.statuses[-1] if self.statuses else None

    def is_refused_arming(self) -> bool:
        """Try to arm the robot; False while nobody answers. RuntimeError when it is armed."""
        request = CommandRequest(
            request_id=monotonic_ns(),
            param1=1.0,
            param2=0.0,
            command=Command.COMPONENT_ARM_DISARM,
        )
        try:
            answer = self._bus.ask(COMMAND, request, 2.0)
        except NoAnswer:
            return False
        if isinstance(answer, CommandAck) and answer.result == AckResult.ACCEPTED:
            raise RuntimeError("it was armed")
        return True

    def set(self, name: str, value: float) -> None:
        self._ask(
            PARAMETER, ParamSet(param_value=value, param_id=name, param_type=PARAM_TYPE_REAL32)
        )

    def _ask(self, service: Service, request: Message) -> None:
        try:
            self._bus.ask(service, request, 2.0)
        except NoAnswer as error:
            raise RuntimeError(str(error)) from error


def after(heard: tuple[Heard, ...], offset_ns: int, since_ns: int) -> Iterator[Seen]:
    """With the last one before it, for the way since then."""
    last: Seen | None = None
    for message, _ in heard:
        assert isinstance(message, GroundTruth)
        one = Seen((message.time_ns + offset_ns - since_ns) / NS_PER_S, message)
        if one.at_s > 0.0:
            if last is not None and last.at_s <= 0.0:
                yield last
            yield one
        last = one
