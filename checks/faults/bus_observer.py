"""Participants on the bus beside the stack: an observer, a second robot, an impostor, a sender.

The observer receives truth at the plant and other topics at the router, despite cut links. The
sender sends extreme frames.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import zip_longest
from math import inf, isclose, nan
from pathlib import Path
from time import monotonic_ns
from typing import Any, Final, Self, TypeAlias

from checks.flood.attackers import Attacker, frames, questions, wheels
from checks.harness.in_process import InProcess
from checks.harness.observer import BusWitness, Seen
from checks.harness.processes import (
    ROBOT,
    arm_request,
    await_subscribers,
    command_request,
    free_port,
    is_accepted,
    tls_of,
)
from checks.harness.until import until
from ground.client.emergency_stop import EmergencyStop
from ground.client.requests import is_saving
from ground.missions.mission import Circle, Waypoint
from ground.missions.transfer import fence_items_of, items_of
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, Tls
from protocol.topics import (
    COMMAND,
    CYCLE,
    MISSION_SERVICE,
    OPERATOR,
    PARAMETER,
    SONAR,
    STATUS,
    STOP,
    TELEOP,
    TRUTH,
    WHEELS,
    Role,
    Service,
    Topic,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import PARAM_TYPE_REAL32, Command, Vehicle
from protocol.wire.message import LAYOUT, Field, Message
from protocol.wire.messages import (
    GroundTruth,
    MissionCount,
    MissionItemInt,
    MissionVerdict,
    NavigatorStatus,
    ParamSet,
    ParamValue,
)
from protocol.wire.reasons import Reason
from runtime.clock import WallClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_S

DIAL_S: Final = 20.0
GIVE_UP_NS: Final = 10_000_000_000
CHANGED_S: Final = 4.5
"""Time between two changes of an operator: saving on the slowest disk takes 4 s."""

TUNED: Final = "d_obs_m"
"""A parameter that an operator may set while the robot drives."""


class BusObserver(BusWitness):
    """Connects when entered, and keeps all truths, statuses and cycle reports.

    It asks once, and without a lease: what an operator's client makes good must be seen here.
    """

    def __init__(self, router: str, truth: str, tls: Tls | None = None) -> None:
        super().__init__(kept=None)
        self._endpoints = (router, truth)
        self._tls = tls
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        router, truth = self._endpoints
        self.listen(self._open(truth, Role.GROUND), TRUTH)
        self.listen(self._open(router, Role.GROUND), STATUS, CYCLE)
        self._stop = self.bus.publisher(STOP)
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    def join(self, role: Role) -> Bus:
        """Open one more bus at the router in this role."""
        return self._open(self._endpoints[0], role)

    def _open(self, endpoint: str, role: Role) -> Bus:
        network = Network(
            mode="client", connect=(endpoint,), tls=self._tls, connect_timeout_s=DIAL_S
        )
        return self._scope.enter_context(open_bus(network, role, ROBOT))

    def is_in(self, *vehicle: Vehicle) -> bool:
        """Return whether the robot reports one of these states."""
        return bool(self.statuses) and self.statuses[-1][0].vehicle in vehicle

    def known_ns(self, since_ns: int) -> int | None:
        """Return when the robot first reported, after a time, that it does not drive."""
        later = ((one, at_ns) for one, at_ns in tuple(self.statuses) if at_ns >= since_ns)
        return next((at_ns for one, at_ns in later if one.vehicle != Vehicle.ACTIVE), None)

    def seen(self, since_ns: int) -> list[Seen]:
        """Return the truths after a time and the one before, timed by the plant's stamps.

        A delayed sample is not later for that.
        """
        received = tuple(self.truths)
        early = [at_ns - one.time_ns for one, at_ns in received if at_ns < since_ns]
        offset_ns = min(early, default=0)
        return list(after(received, offset_ns, since_ns))

    def missed_ticks(self, since_ns: int) -> int:
        """Return the control periods missed since a time; RuntimeError without reports."""
        early = [one.missed for one, at_ns in tuple(self.cycles) if at_ns < since_ns]
        newest, at_ns = self.cycles[-1] if early else (None, 0)
        if newest is None or at_ns < since_ns:
            raise RuntimeError("the robot did not report its cycles")
        return newest.missed - early[-1]

    def estop(self) -> None:
        """Request the emergency stop."""
        self._ask(COMMAND, command_request(monotonic_ns(), Command.DO_FLIGHTTERMINATION, 1.0))

    def press(self) -> None:
        """Press the app's stop; RuntimeError when it is not acknowledged."""
        stop = EmergencyStop(self.bus, self._stop, ROBOT, WallClock(), self._newest)
        outcome = stop.run(give_up_ns=GIVE_UP_NS)
        if not outcome.acknowledged:
            raise RuntimeError(f"the stop was not acknowledged: {outcome.why}")

    def _newest(self) -> tuple[NavigatorStatus, int] | None:
        return self.statuses[-1] if self.statuses else None

    def is_refused_arming(self) -> bool:
        """Return whether the robot refuses to arm; RuntimeError when it arms."""
        try:
            answer = self.bus.ask(COMMAND, arm_request(monotonic_ns()), 2.0)
        except NoAnswerError:
            return False
        if is_accepted(answer):
            raise RuntimeError("the robot armed without a readable fence")
        return True

    def set(self, name: str, value: float) -> bool:
        """Set a parameter and return whether it is in force, saved or not yet."""
        request = ParamSet(param_value=value, param_id=name, param_type=PARAM_TYPE_REAL32)
        answer = self._ask(PARAMETER, request)
        return isinstance(answer, ParamValue) or is_saving(answer)

    def upload(self, items: Sequence[MissionItemInt]) -> bool:
        """Send a mission or a fence and return whether it is in force, saved or not yet."""
        kind = items[0].mission_type
        answer = self._ask(MISSION_SERVICE, MissionCount(count=len(items), mission_type=kind))
        for item in items:
            answer = self._ask(MISSION_SERVICE, item)
        accepted = isinstance(answer, MissionVerdict) and answer.reason == Reason.NONE
        return accepted or is_saving(answer)

    def _ask(self, service: Service, request: Message) -> Message | bytes:
        try:
            return self.bus.ask(service, request, 2.0)
        except NoAnswerError as error:
            raise RuntimeError(str(error)) from error


class Changes:
    """Changes of parameter, mission and fence while the robot drives, in turn.

    Each change has a new value, so that each writes a file.
    """

    def __init__(self, observer: BusObserver, state: Path) -> None:
        self._observer = observer
        self._state = state
        self._count = 0
        self._wanted: dict[str, float] = {}

    def make(self, since_s: float) -> None:
        """Make the next change if it is due; RuntimeError when the robot refuses it."""
        if since_s < self._count * CHANGED_S:
            return
        further_m = self._count / 100
        name = ("parameters", "mission", "fence")[self._count % 3]
        self._count += 1
        if name == "parameters":
            self._wanted[name] = 0.31 + further_m / 10
            done = self._observer.set(TUNED, self._wanted[name])
        elif name == "mission":
            items = items_of([Waypoint(x_m=1.0 + further_m, y_m=2.0)])
            self._wanted[name] = items[0].x
            done = self._observer.upload(items)
        else:
            self._wanted[name] = 9.0 + further_m
            fence = Circle(x_m=2.0, y_m=2.0, radius_m=self._wanted[name])
            done = self._observer.upload(fence_items_of(fence))
        if not done:
            raise RuntimeError(f"the robot refused change {self._count} of {name}")

    def are_saved(self) -> bool:
        """Return whether the robot's files hold the newest value of each change."""
        return all(
            isclose(self._saved(name), wanted, rel_tol=1e-6)
            for name, wanted in self._wanted.items()
        )

    def _saved(self, name: str) -> float:
        path = self._state / f"{name}.json"
        if not path.exists():
            return nan
        found = json.loads(path.read_text(encoding="utf-8"))
        key = {"parameters": TUNED, "mission": "x", "fence": "param1"}[name]
        return float((found if name == "parameters" else found[0])[key])


def after(
    received: tuple[tuple[GroundTruth, int], ...], offset_ns: int, since_ns: int
) -> Iterator[Seen]:
    """Yield the truths after a time, and the last one before it."""
    last: Seen | None = None
    for message, _ in received:
        one = Seen((message.time_ns + offset_ns - since_ns) / NS_PER_S, message)
        if one.at_s > 0.0:
            if last is not None and last.at_s <= 0.0:
                yield last
            yield one
        last = one


IMPOSTOR: Final = "robot-r2"
IMPOSTOR_SENDS: Final = (frames, questions, wheels)

Turn: TypeAlias = list[tuple[Topic[Any], bytes]]
"""The frames of one tick, at most one per topic: the robot reads the newest."""

READ: Final[tuple[Topic[Any], ...]] = (SONAR, WHEELS, OPERATOR, TELEOP)
RECEIVED: Final[tuple[Topic[Any], ...]] = (*READ, STOP)
"""The topics that the robot subscribes to."""

GREATEST_FLOAT32: Final = 3.4028234e38
FLOATS: Final = (0.0, -GREATEST_FLOAT32, GREATEST_FLOAT32, nan, inf, -inf)
MATCHED_S: Final = 5.0


class Impostor:
    """Listens as a router does, without access control of its own."""

    def __init__(self, keys: Path) -> None:
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        network = Network(mode="router", listen=(self.endpoint,), tls=tls_of(keys, IMPOSTOR))
        self._attacker = Attacker(network, "ground")
        self._senders = [prepare(self._attacker) for prepare in IMPOSTOR_SENDS]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._attacker.close()

    def send(self) -> None:
        """Send one of each kind of payload that could make a robot drive."""
        for send in self._senders:
            send()


def second_robot(stack: InProcess) -> Bus:
    """Start a second robot of this name, and wait until the first has detected it."""
    second = stack.join(Role.ROBOT)
    second.announce()
    robot = stack.buses["robot"]
    until(lambda: second.zid in {peer.zid for peer in robot.present()}, "the second robot detected")
    return second


class ExtremeSender:
    """Sends frames in which one field, or all fields, have an extreme value."""

    def __init__(self, bus: Bus) -> None:
        self._publishers = {topic.path: bus.publisher(topic) for topic in RECEIVED}
        await_subscribers(bus, list(self._publishers.values()), MATCHED_S)
        self._turns = turns()
        self._turn: Turn = []

    def take_turn(self, send: Callable[[str, Callable[[], object]], object]) -> None:
        """Send the frames of the next tick; `send` publishes and waits until the robot has them."""
        self._turn = next(self._turns, [])
        self.repeat(send)

    def repeat(self, send: Callable[[str, Callable[[], object]], object]) -> None:
        """Send the frames of this tick again, so that one is the newest when the robot reads."""
        for topic, frame in self._turn:
            publisher = self._publishers[topic.path]
            send(publisher.key, partial(publisher.put_frame, frame))


def turns() -> Iterator[Turn]:
    """Yield the frames of each tick, stops last: a stopped robot ignores the other frames."""
    for topics in (READ, (STOP,)):
        for turn in zip_longest(*map(extremes, topics)):
            yield [(topic, frame) for topic, frame in zip(topics, turn, strict=True) if frame]


def extremes(topic: Topic[Any]) -> Iterator[bytes]:
    """Yield frames of a topic with each field, and all fields, at each extreme."""
    encoder = Encoder(255, 190)
    for kind in topic.messages:
        for message in extremes_of(kind):
            yield encoder.encode(message)


def extremes_of(kind: type[Message]) -> Iterator[Message]:
    """Yield messages with all fields, then with one field, at each extreme; others are 1."""
    fields = LAYOUT[kind.__name__].fields
    plain = {field.name: shaped(field, 1) for field in fields}
    for pick in (0, -1):
        yield kind(**{field.name: shaped(field, values(field)[pick]) for field in fields})
    for field in fields:
        for value in values(field):
            yield kind(**plain | {field.name: shaped(field, value)})


def values(field: Field) -> tuple[float, ...]:
    """Return the extreme values of a field."""
    return FLOATS if field.limits is None else field.limits


def shaped(field: Field, value: float) -> Any:
    """Return a value in the shape of a field: a number, a tuple, or a text of full length."""
    if field.is_text:
        return "x" * field.length
    return (value,) * field.length if field.length else value
