"""Trouble on a real bus: samples are lost, late, doubled and swapped on their way in."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic_ns

from protocol.bus.bus import Bus, open_bus
from protocol.bus.link_faults import LinkFaults
from protocol.bus.network import Network
from protocol.bus.publisher import Publisher
from protocol.topics import CLOCK, WHEELS, Role
from protocol.wire.codec import decode
from protocol.wire.messages import WheelTicks
from tests.support.until import PATIENCE_S, until

MS = 1_000_000


class Heard:
    """The numbers of the ticks that came through, and when."""

    def __init__(self, bus: Bus) -> None:
        self.seqs: list[int] = []
        self.at_ns: list[int] = []
        self.dealt_with: list[str] = []
        bus.faults.after = self.dealt_with.append
        bus.stream(WHEELS, self._take)

    def _take(self, _key: str, frame: bytes, arrived_ns: int) -> None:
        message = decode(frame).message
        assert isinstance(message, WheelTicks)
        self.seqs.append(message.seq)
        self.at_ns.append(arrived_ns)


@contextmanager
def pair(trouble: LinkFaults | None) -> Iterator[tuple[Bus, Heard, Publisher[WheelTicks]]]:
    hub = Network(mode="peer", listen=("tcp/127.0.0.1:0",), trouble=trouble)
    with open_bus(hub, Role.ROBOT, "r1") as robot:
        heard = Heard(robot)
        leaf = Network(mode="client", connect=(robot.locator(),))
        with open_bus(leaf, Role.PLANT, "r1") as plant:
            wheels = plant.publisher(WHEELS)
            assert plant.await_matched([wheels], PATIENCE_S) == []
            yield robot, heard, wheels


def send(heard: Heard, wheels: Publisher[WheelTicks], *seqs: int) -> None:
    """Put them and wait until the line has dealt with them."""
    before = len(heard.dealt_with)
    for seq in seqs:
        wheels.put(WheelTicks(time_ns=0, seq=seq, left=0, right=0, bumper=0, expired=0))
    until(lambda: len(heard.dealt_with) == before + len(seqs))


def test_all_samples_arrive_without_faults() -> None:
    with pair(None) as (_, heard, wheels):
        send(heard, wheels, *range(50))
        assert heard.seqs == list(range(50))


def test_what_is_lost_is_lost_for_good_and_the_trouble_can_end() -> None:
    with pair(LinkFaults(loss=1.0)) as (robot, heard, wheels):
        send(heard, wheels, 1, 2, 3)
        robot.faults.disturb(None)
        send(heard, wheels, 4)
        assert heard.seqs == [4]


def test_what_is_late_comes_by_itself_when_it_is_due() -> None:
    with pair(LinkFaults(delay_ms=60)) as (_, heard, wheels):
        began_ns = monotonic_ns()
        send(heard, wheels, 1, 2)
        assert heard.seqs == []
        until(lambda: heard.seqs == [1, 2])
        assert heard.at_ns[0] - began_ns >= 60 * MS


def test_late_samples_are_lost_with_the_bus() -> None:
    with pair(LinkFaults(delay_ms=10_000)) as (_, heard, wheels):
        send(heard, wheels, 1)
    assert heard.seqs == []


def test_copies_and_swaps() -> None:
    with pair(LinkFaults(duplicate=1.0)) as (robot, heard, wheels):
        send(heard, wheels, 1)
        robot.faults.disturb(LinkFaults(reorder=1.0))
        send(heard, wheels, 2, 3)
        assert heard.seqs == [1, 1, 3, 2]


def test_faults_affect_only_named_topics_and_never_the_clock() -> None:
    with pair(LinkFaults(loss=1.0, paths=("sense/sonar",))) as (robot, heard, wheels):
        send(heard, wheels, 1)
        assert heard.seqs == [1]
        robot.faults.disturb(LinkFaults(loss=1.0))
        clock = robot.mailbox(CLOCK)
        robot.publisher(CLOCK).put_frame(b"\xfd")
        until(lambda: f"sidestep/r1/{CLOCK.path}" in heard.dealt_with)
        assert clock.rejected == 1, "it came as far as the mailbox"


def test_in_simulated_time_nothing_comes_before_it_is_let_go() -> None:
    with pair(LinkFaults(delay_ms=100)) as (robot, heard, wheels):
        robot.faults.by_hand = True
        now_ns = monotonic_ns()
        send(heard, wheels, 1)
        robot.faults.release(now_ns + 99 * MS)
        assert heard.seqs == []
        robot.faults.release(now_ns + 5_000 * MS)
        assert heard.seqs == [1]
