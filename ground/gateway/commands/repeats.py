"""Repeated commands: a client or the network repeats a command, which is executed once.

A copy made by the network has the sequence number of its original. A client that received no answer
sends the command again, with a higher `confirmation` or unchanged. The same command counts as new
if the client has sent another one since, or some time later.
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from ground.gateway.commands.call import Call
from ground.gateway.traffic import Sender
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


@dataclass(slots=True, eq=False)
class Kept:
    """A command that was accepted for execution; `result` is None until it is known."""

    number: int
    content: bytes
    sequence: int
    at_ns: int
    result: int | None = None


class Repeats:
    """The newest commands of each sender."""

    def __init__(self) -> None:
        self._of: OrderedDict[Key, list[Kept]] = OrderedDict()

    def find(self, call: Call, confirmation: int, sequence: int) -> Kept | None:
        """Return the command that this one repeats, or None for a new one."""
        kept = self._of.get(key_of(call.sender), [])
        latest = True
        for one in reversed(kept):
            is_same = one.number == call.number and one.content == call.content
            age_ns = call.now_ns - one.at_ns
            is_copy = sequence == one.sequence and age_ns < COPY_NS
            is_again = latest and age_ns < (CONFIRMED_NS if confirmation else UNMARKED_NS)
            if is_same and (one.result is None or is_copy or is_again):
                return one
            latest = False
        return None

    def keep(self, call: Call, sequence: int) -> Kept:
        """Keep a new command, and drop the oldest ones beyond the limits."""
        key = key_of(call.sender)
        if key not in self._of:
            self._make_room(key)
        kept = self._of.setdefault(key, [])
        self._of.move_to_end(key)
        one = Kept(call.number, call.content, sequence, call.now_ns)
        kept.append(one)
        del kept[:-MAX_KEPT]
        return one

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
