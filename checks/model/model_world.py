"""A robot without bus and threads: vehicle, senses and programs of operators, stepped by calls.

The state of its graph of objects can be captured and restored.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar, cast

from checks.harness.messages import make
from protocol.bus.bus import Bus
from protocol.bus.mailbox import Mailbox, Sample
from protocol.topics import ENCODING, OPERATOR, SONAR, TELEOP, WHEELS, Topic
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    Heartbeat,
    MissionVerdict,
    SonarScan,
    Teleop,
    WheelTicks,
)
from robot.commands import operator_twist
from robot.core import reasons, states
from robot.core.parameters import DEFAULTS, Params
from robot.core.safety import failsafe
from robot.core.safety.failsafe import FailsafeRow, Trigger
from robot.core.state import State
from robot.core.values import Inputs, Outputs, Pose
from robot.senses import Senses
from robot.storage import Store
from robot.vehicle import Answer, RobotVehicle
from runtime.clock import Tick
from runtime.units import NS_PER_MS, PERIOD_NS

Contents: TypeAlias = list[tuple[Callable[[Any], None], Any]]
"""The content of each object at the time of capture, after the function that restores it."""

PACKAGES: Final = ("robot.", "protocol.bus.mailbox.", "checks.")
"""Modules whose classes hold state; instances of all other classes count as values."""

PERCEPTION: Final = "robot.core."
CONTROL: Final = ("robot.core.modes.", "robot.core.state.")
MAPPINGS: Final = (dict, OrderedDict)
SEQUENCES: Final = (list, deque)


class Memento(NamedTuple):
    """Captured state; `perception` changes only in a control period, `control` also otherwise."""

    control: Contents
    perception: Contents


class Shape(NamedTuple):
    """The way to capture instances of a class: by `slots`, or by fields if there are none."""

    slots: tuple[str, ...]
    perceives: bool


_shapes: dict[type, Shape | None] = {}
_values: set[type] = {bool, bytes, float, int, str, type(None)}
"""Classes whose instances hold no state, as far as they have been met."""


def capture(root: object) -> Memento:
    """Return the contents of `root` and of every object reachable from it."""
    memento = Memento([], [])
    seen: set[int] = set()
    values = _values
    pending: list[tuple[Any, bool]] = [(root, False)]
    while pending:
        one, perceives = pending.pop()
        kind = type(one)
        shape = None
        if isinstance(one, tuple):
            pending.extend([(inner, perceives) for inner in one if type(inner) not in values])
            continue
        if kind not in SEQUENCES and kind not in MAPPINGS and kind is not set:
            shape = shape_of(kind)
            if shape is None:
                values.add(kind)
                continue
            perceives = perceives or shape.perceives
        if id(one) in seen:
            continue
        seen.add(id(one))
        put, contents, inside = contents_of(one, shape)
        memento[perceives].append((put, contents))
        pending.extend([(inner, perceives) for inner in inside if type(inner) not in values])
    return memento


def contents_of(one: Any, shape: Shape | None) -> tuple[Callable[[Any], None], Any, Any]:
    """Return the function that restores an object, its content, and the objects in it."""
    if shape is None:
        contents = one.copy()
        if type(one) is list:
            return partial(one.__setitem__, slice(None)), contents, contents
        inside = contents.values() if type(one) in MAPPINGS else contents
        return partial(refill, one), contents, inside
    if shape.slots:
        values = [getattr(one, name) for name in shape.slots]
        return partial(set_slots, one, shape.slots), values, values
    fields = dict(vars(one))
    return vars(one).update, fields, fields.values()


def restore(memento: Memento, *, perception: bool) -> None:
    """Restore captured contents; objects created since then become unreachable."""
    put_back(memento.control)
    if perception:
        put_back(memento.perception)


def put_back(contents: Contents) -> None:
    """Restore the contents of some objects."""
    for put, was in contents:
        put(was)


def refill(one: Any, was: Any) -> None:
    """Restore a mapping, a set or a queue."""
    if one:
        one.clear()
    if was:
        (one.extend if type(one) is deque else one.update)(was)


def set_slots(one: Any, slots: tuple[str, ...], was: list[Any]) -> None:
    """Restore the slots of an object."""
    for name, value in zip(slots, was, strict=True):
        setattr(one, name, value)


def shape_of(kind: type) -> Shape | None:
    """Return how a class is captured; None if its instances are values."""
    if kind not in _shapes:
        _shapes[kind] = new_shape_of(kind)
    return _shapes[kind]


def new_shape_of(kind: type) -> Shape | None:
    """Determine how a class is captured."""
    module = f"{kind.__module__}."
    if not module.startswith(PACKAGES) or issubclass(kind, int | float | str | type):
        return None
    slots = tuple(getattr(kind, "__slots__", ()))
    perceives = module.startswith(PERCEPTION) and not module.startswith(CONTROL)
    has_fields = bool(slots) or bool(getattr(kind, "__dictoffset__", 0))
    return Shape(slots, perceives) if has_fields else None


M = TypeVar("M", bound=Message)

ADA: Final = "ada/1"
ADAS_OTHER: Final = "ada/2"
"""Another program of the same person."""

BOB: Final = "bob/2"
STRANGER: Final = ""
SPEED_MM_S: Final = {ADA: 100, ADAS_OTHER: 150, BOB: 200}
"""The teleop speed of each operator, which identifies the sender of a frame."""

HERE: Final = Pose(0.0, 0.0, 0.0)
FAR: Final = Pose(50.0, 0.0, 0.0)
"""Beyond every fence and every goal of the model."""

START: Final = Pose(-2.0, 0.0, 0.0)
"""The earlier place of the robot, so that there is a path back."""

PARAMS: Final = DEFAULTS._replace(
    accel_m_s2=10.0,  # any speed is reached, and any brake complete, within one tick
    op_lost_ms=60,  # an operator that leaves is lost at the next tick but one
    stuck_ms=10**9,  # a robot that is kept in one place does not give up by itself
    progress_ms=10**9,
    navigator=states.BUG,
)
GONE_NS: Final = 100 * NS_PER_MS
TICKS_PER_MRAD_S: Final = 1e-3 * PARAMS.wheel_radius_m * PARAMS.period_s / PARAMS.m_per_tick


@contextmanager
def forcible(world: "ModelWorld") -> Iterator[None]:
    """Let failsafe rows also trigger when `world.forced` is their reason."""

    def forced(row: FailsafeRow) -> Trigger:
        def trigger(state: State, inputs: Inputs, params: Params) -> bool:
            return world.forced == row.reason or row.trigger(state, inputs, params)

        return trigger

    triggers = failsafe.TRIGGERS
    failsafe.TRIGGERS = tuple((forced(row), row) for row in failsafe.ROWS)  # type: ignore[misc]
    try:
        yield
    finally:
        failsafe.TRIGGERS = triggers  # type: ignore[misc]


class CoreFaultError(Exception):
    """A defect of the core, raised inside a step."""


class MailboxBus:
    """The part of a bus that the senses need: mailboxes for frames."""

    def __init__(self) -> None:
        self.boxes: dict[str, Mailbox[Any]] = {}
        self._encoder = Encoder(1, 1)

    def mailbox(
        self,
        topic: Topic[M],
        notify: Callable[[int], None] | None = None,
        accept: Callable[[str], bool] | None = None,
        *,
        forward: bool = False,
    ) -> Mailbox[M]:
        """Create the mailbox of a topic."""
        box = self.boxes[topic.path] = Mailbox(topic, notify, accept, forward=forward)
        return box

    def put(self, topic: Topic[Any], message: Message, now_ns: int, sender: str = "") -> None:
        """Store a message in the mailbox of its topic."""
        frame = self._encoder.encode(message)
        sent_ns = now_ns if sender else None
        self.boxes[topic.path].store(Sample(ENCODING, frame, sender, sent_ns), now_ns)


class ModelWorld:
    """A robot that stays in place: encoders follow the commands, the pose is reset each tick."""

    def __init__(self) -> None:
        self.vehicle = RobotVehicle(PARAMS, Store(None), START)
        self.boxes = MailboxBus()
        accept = self.vehicle.lease.allows
        self.senses = Senses(cast(Bus, self.boxes), lockstep=False, accept=accept)
        self.now_ns = 1_000 * NS_PER_MS
        self.ticks = 0
        self.here = HERE
        self.left = self.right = 0.0
        self.present: frozenset[str] = frozenset()
        self.unread = STRANGER
        """The sender of a teleop frame that arrived since the last tick."""
        self.forced: int = reasons.OK
        """The failsafe reason whose trigger fires in this tick."""
        self.newest_id = 0

    def next_id(self) -> int:
        """Return a new request id."""
        self.newest_id += 1
        return self.newest_id

    def request(self, message: Message, operator: str) -> Answer:
        """Send a request and return its answer."""
        return self.vehicle.receive(message, self.now_ns, operator)

    def steer(self, operator: str) -> None:
        """Store a teleop frame of an operator; the next tick reads it."""
        teleop = Teleop(
            time_ns=self.now_ns,
            seq=self.ticks,
            speed_mm_s=SPEED_MM_S[operator],
            yaw_rate_mrad_s=0,
            ttl_ms=300,
        )
        if self.vehicle.lease.allows(operator):
            self.unread = operator
        self.boxes.put(TELEOP, teleop, self.now_ns, operator)

    def leave(self, operator: str) -> None:
        """End the heartbeats of an operator, early enough to be lost in the next tick."""
        self.present -= {operator}
        self.now_ns += GONE_NS

    def tick(
        self,
        *,
        wheels: bool = True,
        scan: bool = True,
        forced: int = reasons.OK,
        fault: bool = False,
    ) -> Outputs:
        """Run one control period; with `fault` the core raises CoreFaultError during it."""
        self.now_ns += PERIOD_NS
        self.ticks += 1
        self._beat()
        self._sense(wheels, scan)
        vehicle, now_ns = self.vehicle, self.now_ns
        if self.ticks > 1:
            vehicle.state.odometry.pose = self.here
        tick = Tick(self.ticks, now_ns, 0, 0)
        inputs = self.senses.read(tick, now_ns, vehicle)
        if not wheels:
            inputs = inputs._replace(wheels=None)
        if not scan:
            inputs = inputs._replace(scan=None)
        self.unread = STRANGER
        self.forced = forced
        try:
            manual = operator_twist(vehicle.teleop.newest(now_ns))
            outputs = vehicle.step(inputs, fail if fault else ignore, manual)
        finally:
            self.forced = reasons.OK
        self.left += outputs.left_mrad_s * TICKS_PER_MRAD_S
        self.right += outputs.right_mrad_s * TICKS_PER_MRAD_S
        vehicle.lease_status(now_ns, now_ns)
        vehicle.texts()
        return outputs

    def _beat(self) -> None:
        for operator in sorted(self.present):
            self.boxes.put(OPERATOR, BEAT, self.now_ns, operator)

    def _sense(self, wheels: bool, scan: bool) -> None:
        now_ns, seq = self.now_ns, self.ticks
        left, right = round(self.left), round(self.right)
        self.boxes.put(
            WHEELS,
            WheelTicks(time_ns=now_ns, seq=seq, left=left, right=right, bumper=0, expired=0),
            now_ns,
        )
        self.boxes.put(
            SONAR,
            make(SonarScan, time_ns=now_ns, seq=seq, range_mm=(0,) * 8, ping_age_us=(0,) * 8),
            now_ns,
        )


BEAT: Final = Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4)


def ignore(_stage: int) -> None:
    """Measure no times."""


def fail(_stage: int) -> None:
    """Raise a core fault at the end of the first stage."""
    raise CoreFaultError


def reason_of(answer: Answer) -> int:
    """Return the reason in an answer; 0 for an accepted request, or for the requested data."""
    if isinstance(answer, CommandAck):  # an accepted one may have a note
        return 0 if answer.result == AckResult.ACCEPTED else answer.result_param2
    return answer.reason if isinstance(answer, MissionVerdict) else reasons.OK
