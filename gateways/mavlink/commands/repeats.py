"""Repeated commands: a client or the network repeats a command, which is executed once.

A copy made by the network has the sequence number of its original. A client that received no answer
sends the command again, with a higher `confirmation` or unchanged. The same command counts as new
if the client has sent another one since, or some time later.

The earlier answer is given again only while what the command has made is still there. Otherwise a
copy has no effect and no answer, and the robot is asked again. A repetition with a `confirmation`
is no new wish of its sender: if somebody has stopped the robot since, it does not undo that.
"""

from collections import OrderedDict
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, NamedTuple

from gateways.mavlink.commands.call import Call
from gateways.mavlink.dialect import mavlink
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.enums import GoalState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from runtime.units import NS_PER_S

COPY_NS: Final = 3 * NS_PER_S
"""Age up to which a copy by the network is recognised by its sequence number, which wraps."""
CONFIRMED_NS: Final = 10 * NS_PER_S
"""Age of a command that is repeated with a `confirmation`."""
UNMARKED_NS: Final = 3 * NS_PER_S // 2
"""Age of a command that is repeated unchanged; MAVSDK repeats it up to 1.5 s later."""
MAX_KEPT: Final = 16
MAX_SENDERS: Final = 256
MAX_OF_CLIENT: Final = 8

Key = tuple[int, int, int]


UNDER_WAY: Final = (
    *(GoalState.NONE, GoalState.ACCEPTED, GoalState.DRIVING),
    *(GoalState.AVOIDING, GoalState.ALIGNING, GoalState.REACHED),
)
"""States of a goal that was not ended by somebody or something else."""


class Mark(NamedTuple):
    """Counters of what may end the effect of a command."""

    asked: int
    """Operations of all clients, and changes of control."""
    ended: int
    """Goals that were given up or aborted."""
    stopped: int
    """Stops of all operators."""


class Endings:
    """Counts what ends the effect of commands; `pressed` are the stops of clients."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._goal = self._stop_id = self.pressed = self._ended = self._stopped = 0
        self._is_armed = self._holds = False

    @property
    def mark(self) -> Mark:
        """The counters now."""
        asked = self._vehicle.control.serial
        return Mark(asked, self._ended, self._stopped)

    def due(self) -> None:
        """Read the robot's status."""
        status = self._vehicle.snapshot.status
        if status is None:
            return
        is_armed = status.vehicle == VehicleState.ACTIVE
        holds = self._vehicle.modes.mode is Mode.HOLD
        is_new_stop = status.stop_id not in (0, self._stop_id)
        self._stopped += is_new_stop or self._is_armed > is_armed or self._holds < holds
        goal = 0 if status.goal in UNDER_WAY else status.goal_id
        self._ended += goal not in (0, self._goal)
        self._is_armed, self._holds, self._stop_id, self._goal = (
            *(is_armed, holds, status.stop_id, goal),
        )


@dataclass(slots=True, eq=False)
class Kept:
    """A command that was accepted for execution; `result` is None until it is known.

    `pressed` counts the stops of clients before it, `mark` is of the time of its answer.
    `outlasts`: what it makes is not ended by a stop.
    """

    number: int
    content: bytes
    sequence: int
    at_ns: int
    pressed: int
    outlasts: bool
    result: int | None = None
    mark: Mark | None = None


class Action(Enum):
    """What to do with a command."""

    EXECUTE = auto()
    IGNORE = auto()
    ANSWER = auto()
    """Give the earlier answer again."""
    REFUSE = auto()
    """A stop has ended the effect of the command that this one repeats."""


class Repeats:
    """The newest commands of each sender."""

    def __init__(self, endings: Endings) -> None:
        self._endings = endings
        self._of: OrderedDict[Key, list[Kept]] = OrderedDict()

    def judge(self, call: Call, confirmation: int, sequence: int) -> tuple[Action, int]:
        """Return what to do with a command, and the earlier answer."""
        kept = self._of.get(key_of(call.sender), [])
        latest = True
        for one in reversed(kept):
            is_same = one.number == call.number and one.content == call.content
            age_ns = call.now_ns - one.at_ns
            is_copy = sequence == one.sequence and age_ns < COPY_NS
            is_again = latest and age_ns < (CONFIRMED_NS if confirmation else UNMARKED_NS)
            if is_same and (one.result is None or is_copy or is_again):
                action = self._judged(one, is_copy=is_copy, is_marked=confirmation > 0)
                return action, one.result or 0
            latest = False
        return Action.EXECUTE, 0

    def _judged(self, one: Kept, *, is_copy: bool, is_marked: bool) -> Action:
        """Return what to do with a repetition."""
        if one.result is None:
            return Action.IGNORE
        if one.result != mavlink.MAV_RESULT_ACCEPTED:  # the reason may be gone
            return Action.ANSWER if is_copy or is_marked else Action.EXECUTE
        mark, then = self._endings.mark, one.mark or self._endings.mark
        is_stopped = (mark.stopped, self._endings.pressed) != (then.stopped, one.pressed)
        is_over = mark.asked != then.asked
        if not one.outlasts:
            is_over = is_over or is_stopped or mark.ended != then.ended
        if not is_over:
            return Action.ANSWER
        if is_copy:
            return Action.IGNORE
        return Action.REFUSE if is_marked and is_stopped and not one.outlasts else Action.EXECUTE

    def keep(self, call: Call, sequence: int, *, outlasts: bool) -> Kept:
        """Keep a new command, and drop the oldest ones beyond the limits."""
        key = key_of(call.sender)
        if key not in self._of:
            self._make_room(key)
        kept = self._of.setdefault(key, [])
        self._of.move_to_end(key)
        pressed = self._endings.pressed
        one = Kept(call.number, call.content, sequence, call.now_ns, pressed, outlasts)
        kept.append(one)
        del kept[:-MAX_KEPT]
        return one

    def answered(self, one: Kept, result: int) -> None:
        """Note the answer to a command."""
        one.result, one.mark = result, self._endings.mark

    def _make_room(self, key: Key) -> None:
        """Drop the oldest sender of the client, or of all: none pushes out those of the others."""
        own = [other for other in self._of if other[0] == key[0]]
        if len(own) >= MAX_OF_CLIENT:
            del self._of[own[0]]
        elif len(self._of) >= MAX_SENDERS:
            self._of.popitem(last=False)

    def forget(self, client: int) -> None:
        """Drop the commands of a client that has disconnected."""
        for key in [key for key in self._of if key[0] == client]:
            del self._of[key]


def key_of(sender: Sender) -> Key:
    """Return the key that distinguishes senders."""
    return sender.client, sender.system, sender.component
