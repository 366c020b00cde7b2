"""The lines of the UDP relay, in time that the tests own."""

import socket
from collections.abc import Sequence
from itertools import pairwise

from checks.harness.relays import OVERTAKEN_NS, PERFECT, POOR, ImpairedLine, Impairment, UdpRelay
from runtime.units import NS_PER_MS

COUNT = 2000
FAR_NS = 1 << 62


def arrivals(line: ImpairedLine, count: int = COUNT) -> list[int]:
    """Send numbered datagrams, one per millisecond; return the numbers that arrive."""
    for number in range(count):
        line.put(str(number).encode(), number * NS_PER_MS)
    return [int(data) for data in line.take(FAR_NS)]


def overtaken(numbers: Sequence[int]) -> int:
    return sum(later < earlier for earlier, later in pairwise(numbers))


def test_perfect_line_passes_everything_at_once_in_order() -> None:
    line = ImpairedLine(PERFECT, seed=1)
    line.put(b"a", 5)
    line.put(b"b", 5)
    assert line.take(5) == [b"a", b"b"]
    assert line.due_ns is None
    assert (line.passed, line.lost) == (2, 0)


def test_loss_is_the_share_that_was_asked_for() -> None:
    line = ImpairedLine(Impairment(loss=0.2), seed=1)
    found = arrivals(line)
    assert 0.17 * COUNT < line.lost < 0.23 * COUNT
    assert line.passed == len(found) == COUNT - line.lost


def test_datagram_arrives_after_the_delay_and_not_before() -> None:
    line = ImpairedLine(Impairment(delay_ns=50), seed=1)
    line.put(b"a", 100)
    assert line.due_ns == 150
    assert line.take(149) == []
    assert line.take(150) == [b"a"]


def test_jitter_changes_delays_but_not_the_order() -> None:
    line = ImpairedLine(Impairment(jitter_ns=20 * NS_PER_MS), seed=1)
    assert arrivals(line) == list(range(COUNT))


def test_jitter_stays_within_its_bound() -> None:
    due = set()
    for seed in range(200):
        line = ImpairedLine(Impairment(delay_ns=50, jitter_ns=20), seed)
        line.put(b"a", 0)
        assert line.due_ns is not None
        due.add(line.due_ns)
    assert 50 <= min(due) < 55
    assert 65 < max(due) <= 70


def test_reordered_datagrams_arrive_after_later_ones() -> None:
    line = ImpairedLine(Impairment(reordered=0.1), seed=1)
    found = arrivals(line)
    assert sorted(found) == list(range(COUNT))
    assert 0.07 * COUNT < overtaken(found) < 0.13 * COUNT
    places = {number: place for place, number in enumerate(found)}
    late_ms = OVERTAKEN_NS // NS_PER_MS
    assert max(places[number] - number for number in found) <= late_ms


def test_same_seed_has_the_same_fate_and_another_seed_another() -> None:
    first, again, other = (arrivals(ImpairedLine(POOR, seed)) for seed in (7, 7, 8))
    assert first == again
    assert first != other


def test_another_property_does_not_change_which_are_lost() -> None:
    lossy = arrivals(ImpairedLine(Impairment(loss=0.2), seed=3))
    reordered = arrivals(ImpairedLine(Impairment(loss=0.2, reordered=0.5), seed=3))
    assert lossy == sorted(reordered)


def test_relay_forwards_both_ways_for_several_clients() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        server.bind(("127.0.0.1", 0))
        for end in (server, one, other):
            end.settimeout(20.0)
        with UdpRelay(server.getsockname(), PERFECT, seed=1) as relay:
            for client in (one, other):
                client.connect(("127.0.0.1", relay.port))
                client.send(b"question")
                question, address = server.recvfrom(100)
                server.sendto(question + b" answered", address)
                assert client.recv(100) == b"question answered"
            assert len(relay.peers) == 2
